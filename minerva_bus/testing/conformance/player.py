"""Plays the coordinator in one case, and compares the member with the reference."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Final

from minerva_bus.errors import MinervaError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame.instructions import plain_form
from minerva_bus.frame.member import Member, Refusal
from minerva_bus.runtime.inbox import KeyedSample
from minerva_bus.runtime.scripted import ScriptedHub, ScriptedWorld
from minerva_bus.testing.conformance.case import (
    AwaitEnd,
    Break,
    Case,
    CaseOutcome,
    CaseResult,
    CutLink,
    Deliver,
    Disappear,
    Enter,
    Interrupt,
    PublishReadings,
    Reappear,
    SendIgnored,
    StartAgain,
    Step,
    Succeed,
    Tier,
)
from minerva_bus.testing.conformance.launching import RunningMember, StartMember
from minerva_bus.testing.conformance.texts import KnownState, text_of
from minerva_bus.testing.conformance.world import (
    DT,
    MEMBER,
    SEED,
    VOCABULARY,
    MemberRole,
    reference,
    roles_of,
)
from minerva_bus.testing.proxy import Proxy
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.epochs import stamp, stamped
from minerva_bus.wire.plain import pack, unpack

FIRST_EPOCH: Final = 5
POLL_SECONDS: Final = 0.2
"""Interval in seconds between checks whether the member still runs, and for an interruption."""

GONE_SECONDS: Final = 0.5
"""Seconds in which the last messages of a member arrive whose token has vanished."""


@dataclass(frozen=True, slots=True)
class TimeLimits:
    """Time limits in seconds: until a member has joined, for an answer, and until it has ended."""

    join: float = 30.0
    answer: float = 10.0
    end: float = 30.0


class CaseFailure(MinervaError):
    """The member has violated a requirement."""

    def __init__(self, problem: str, expected: Sequence[str] = (), received: Sequence[str] = ()):
        super().__init__(problem)
        self.expected = tuple(expected)
        self.received = tuple(received)


class NotJoined(MinervaError):
    """The member has not come as far as the case begins."""


def play(
    case: Case,
    role: MemberRole,
    start: StartMember,
    hub: ScriptedHub,
    world: str,
    capabilities: frozenset[str],
    limits: TimeLimits,
) -> CaseResult:
    """Play a case in a world of this name."""
    with ScriptedWorld(hub, world, MEMBER) as stage:
        player = _Player(case, role, start, stage, hub.endpoint, capabilities, limits)
        try:
            player.play()
        except CaseFailure as failure:
            return _result(player, CaseOutcome.FAILED, failure)
        except NotJoined as reason:
            outcome = CaseOutcome.BLOCKED if case.joined else CaseOutcome.FAILED
            return _result(player, outcome, CaseFailure(str(reason)))
        finally:
            player.close()
    return CaseResult(case, role, CaseOutcome.PASSED, sent=tuple(player.sent))


def probe(
    role: MemberRole | None,
    start: StartMember,
    hub: ScriptedHub,
    world: str,
    limits: TimeLimits,
) -> m.Hello:
    """The hello of a member, which is started without a role if `role` is None.

    Raises NotJoined if there is none.
    """
    case = Case("probe", "", (), Tier.JOINS, ())
    with ScriptedWorld(hub, world, MEMBER) as stage:
        player = _Player(case, role, start, stage, hub.endpoint, frozenset(), limits)
        try:
            return player.greeted()
        except CaseFailure as failure:
            raise NotJoined(str(failure)) from None
        finally:
            player.close()


def _result(player: _Player, outcome: CaseOutcome, failure: CaseFailure) -> CaseResult:
    problem = f"{failure}\n{player.process.output()}".strip()
    return CaseResult(
        player.case,
        player.role,
        outcome,
        problem,
        tuple(player.sent),
        failure.expected,
        failure.received,
    )


def _shown(data: bytes) -> str:
    """A message as plain data, without the vocabulary."""
    plain = unpack(data)
    if plain[0] == "welcome":
        plain[2] = "the vocabulary"
    return str(plain)


class _Player:
    """State of one case: the member's process, the reference, and what both have sent."""

    def __init__(
        self,
        case: Case,
        role: MemberRole | None,
        start: StartMember,
        stage: ScriptedWorld,
        endpoint: str,
        capabilities: frozenset[str],
        limits: TimeLimits,
    ) -> None:
        self.case = case
        # The probe of a member without a role compares nothing.
        self.role = role or MemberRole.HOST
        self.sent: list[str] = []
        self._stage = stage
        self._limits = limits
        self._capabilities = capabilities
        self._epoch = FIRST_EPOCH
        self._present = False
        # As a step of the case allows.
        self._ended = False
        self._member: Member = reference(self.role)
        self._states = KnownState(), KnownState()
        self._saved: list[m.Saved] = [None, None]
        self._decoder = Decoder(VOCABULARY)
        self._closing = ExitStack()
        if any(isinstance(step, CutLink) for step in case.steps):
            port = int(endpoint.rpartition(":")[2])
            self._proxy = self._closing.enter_context(Proxy(port, lambda: 0.0))
            endpoint = f"tcp/127.0.0.1:{self._proxy.port}"
        environment = {
            "MINERVA_WORLD": stage.keys.world,
            "MINERVA_CONNECT": endpoint,
            "MINERVA_NAME": MEMBER,
            **({} if role is None else {"MINERVA_ROLE": role.value}),
        }
        self._start = lambda: start(environment)
        if case.name_taken:
            stage.hold(stage.keys.alive(MEMBER))
        stage.appear(self._epoch)
        self.process: RunningMember = self._start()

    def close(self) -> None:
        """End the member's process."""
        self.process.kill()
        self._closing.close()

    def play(self) -> None:
        """Run all steps. Raises CaseFailure, and NotJoined if the case could not begin."""
        if self.case.name_taken:
            self._await_refusal()
            return
        if self.case.joined:
            self._join(self.case.frame)
        else:
            self._await_token(self._limits.join)
        for step in self.case.steps:
            self._step(step)
            if self._ended:
                return

    # --- joining ---

    def _await_token(self, seconds: float) -> None:
        until = self._stage.now() + seconds
        while not self._present:
            sample = self._next_sample(until)
            if sample is not None:
                self._message(sample)
            elif self._stage.now() >= until:
                raise NotJoined(f"no token alive/{MEMBER} within {seconds:g} s")
            elif (code := self.process.code(0.0)) is not None:
                raise NotJoined(f"it ended with exit code {code} before it declared its token")

    def greeted(self) -> m.Hello:
        """Wait for the member and greet it. Raises NotJoined and CaseFailure."""
        self._await_token(self._limits.join)
        self._put("to", m.Greet())
        hello = self._next_message(self._limits.answer)
        if not isinstance(hello, m.Hello):
            shown = "nothing" if hello is None else self._text(hello)
            raise NotJoined(f"no hello after a greeting: {shown}")
        return hello

    def _join(self, frame: int) -> None:
        """Greet and welcome the member."""
        try:
            hello = self.greeted()
        except CaseFailure as failure:
            raise NotJoined(str(failure)) from None
        if self.role not in roles_of(hello):
            raise NotJoined(f"no hello of the role {self.role}: {self._text(hello)}")
        self._welcome(frame, saved=True)

    def _enter(self, frame: int, *, more: bool) -> None:
        if not more:
            self._welcome(frame, saved=False)
            return
        plain = unpack(encode(self._welcome_at(frame)))
        plain[2]["later"] = ["a key of a later version"]
        self._welcome(frame, saved=False, data=pack(plain))

    def _welcome_at(self, frame: int, seed: int = SEED) -> m.Welcome:
        return m.Welcome(self._stage.keys.world, VOCABULARY, seed, DT, frame, self.case.policy)

    def _welcome(self, frame: int, *, saved: bool, seed: int = SEED, data: bytes = b"") -> None:
        welcome = self._welcome_at(frame, seed)
        own, theirs = self._saved if saved else (None, None)
        self._put("to", replace(welcome, saved=theirs), data)
        for state in self._states:
            state.sent(welcome)
        self._member.receive(replace(welcome, saved=own))

    def _await_refusal(self) -> None:
        """The member ends without an answer to greetings, which are for the holder of its name."""
        until = self._stage.now() + self._limits.end
        while (code := self.process.code(POLL_SECONDS)) is None and self._stage.now() < until:
            self._put("to", m.Greet(), quiet=True)
            self._check_silence()
        self._check_silence()
        if code is None:
            raise CaseFailure("it still runs, although another member has its name")
        if code == 0:
            raise CaseFailure("it ended with exit code 0, although its name was taken")

    def _check_silence(self) -> None:
        while (sample := self._stage.next(0.0)) is not None:
            if self._message(sample) is not None:
                raise CaseFailure("it sent a message under a name that another member has")

    # --- steps ---

    def _step(self, step: Step) -> None:
        match step:
            case Deliver():
                self._deliver(step)
            case PublishReadings(readings):
                data = encode(readings)
                key = f"topic/{readings.topic}/{readings.member}"
                self._put_bytes(key, data, _shown(data))
                self._compare(self._receive(readings))
            case SendIgnored():
                self._send_ignored(step)
            case Enter(frame, more):
                self._enter(frame, more=more)
            case Break(message):
                self._break(message)
            case AwaitEnd(failed):
                self._await_end(failed)
            case _:
                self._happen(step)

    def _happen(
        self, step: Succeed | Disappear | Reappear | CutLink | Interrupt | StartAgain
    ) -> None:
        """Something happens to the coordinator, the link or the member's process."""
        match step:
            case Succeed():
                self._epoch += 1
                self.sent.append(f"(the coordinator's epoch is {self._epoch} from here on)")
            case Disappear():
                self._stage.vanish()
                self.sent.append("(the coordinator's token vanishes)")
                self._await_absence()
            case Reappear():
                self._reappear(step)
            case CutLink(frame):
                self._cut_link(frame)
            case Interrupt():
                self._interrupt()
            case StartAgain(frame):
                self._start_again(frame)

    def _deliver(self, step: Deliver) -> None:
        message = self._for_member(step.message)
        self._put(step.on, message, step.data)
        for state in self._states:
            state.sent(step.message)
        try:
            expected = self._receive(step.message)
        except Refusal:
            return  # The member ends; the script says how.
        self._compare(expected)

    def _for_member(self, message: m.ToMember) -> m.ToMember:
        """The message as the coordinator sends it to a member that declines columns."""
        if "plain" not in self._capabilities:
            return message
        if isinstance(message, m.EvolveRequest) and MEMBER in message.asked:
            only = message.only or tuple(self._states[0].fragments)
            message = replace(message, asked=(MEMBER,), only=only)
        return plain_form(message)

    def _send_ignored(self, step: SendIgnored) -> None:
        data = step.data if step.epoch is None else stamp(self._epoch + step.epoch) + step.data
        self._put_bytes(step.on, data, f"{step.data.hex()[:200]}, which it must ignore")
        if not step.checked:
            return
        if step.may_end:
            self._put("to", m.Greet())
            answer = self._next_message(self._limits.answer)
            if isinstance(answer, m.Failed):
                self._await_end(failed=True)
                self._ended = True
            elif not isinstance(answer, m.Hello):
                shown = "nothing" if answer is None else self._text(answer)
                raise CaseFailure("it answered a message that it must drop", (), [shown])
            return
        self._fence()

    def _reappear(self, step: Reappear) -> None:
        self._epoch += step.later
        self._stage.appear(self._epoch)
        self.sent.append(f"(the token of a coordinator of epoch {self._epoch} appears)")
        self._return_to(step.frame, saved=step.saved, seed=SEED if step.seed is None else step.seed)

    def _return_to(self, frame: int, *, saved: bool, seed: int) -> None:
        """Wait for the member's token, greet it and welcome it again."""
        try:
            self._await_token(self._limits.join)
        except NotJoined as reason:
            raise CaseFailure(str(reason)) from None
        self._deliver(Deliver(m.Greet()))
        self._welcome(frame, saved=saved, seed=seed)

    def _cut_link(self, frame: int) -> None:
        self._proxy.cut()
        self.sent.append("(its link is cut)")
        self._await_absence()
        self._return_to(frame, saved=True, seed=SEED)

    def _interrupt(self) -> None:
        self.process.interrupt()
        self.sent.append("(its process is asked to end)")
        has_left = False
        while (message := self._next_message(self._limits.end)) is not None:
            if has_left:
                raise CaseFailure("it sent a message after `leaving`", (), [self._text(message)])
            has_left = isinstance(message, m.Leaving)
        self._await_absence()
        code = self._exit_code()
        if code is None:
            raise CaseFailure("it has not ended")
        if has_left and code != 0:
            raise CaseFailure(f"it has left, but its exit code is {code}")

    def _break(self, message: m.ToMember) -> None:
        self._put("", self._for_member(message))
        answer = self._next_message(self._limits.answer)
        if not isinstance(answer, m.Failed):
            shown = [] if answer is None else [self._text(answer)]
            raise CaseFailure("it did not send `failed`", ["failed"], shown)
        self._await_end(failed=True)

    def _start_again(self, frame: int) -> None:
        self.process.kill()
        self._await_absence()
        self.sent.append("(its process is killed and started again)")
        self.process = self._start()
        self._member = reference(self.role)
        self._join(frame)

    def _await_absence(self) -> None:
        until = self._stage.now() + self._limits.end
        while self._present:
            sample = self._next_sample(until)
            if sample is not None:
                self._message(sample)
            elif self._stage.now() >= until:
                raise CaseFailure("it has not undeclared its token")

    def _await_end(self, failed: bool | None) -> None:
        # A member may keep its session until the coordinator has gone.
        self._stage.vanish()
        code = self._exit_code()
        if code is None:
            raise CaseFailure("it has not ended")
        if failed is not None and failed != (code != 0):
            wanted = "other than 0" if failed else "0"
            raise CaseFailure(f"its exit code is {code}; expected {wanted}")
        self._await_absence()

    # --- the member against the reference ---

    def _receive(self, message: m.ToMember | m.Readings) -> list[m.FromMember | m.Readings]:
        """What the reference answers to a message."""
        try:
            answers = self._member.receive(message)
        except Refusal:
            raise
        except Exception as error:
            error.add_note(f"in the reference of the case {self.case.id!r}")
            raise
        for answer in answers:
            if isinstance(answer, m.TickReply):
                self._saved[0] = answer.saved
        silent = "publishes" not in self._capabilities
        return [a for a in answers if not (silent and isinstance(a, m.Readings))]

    def _compare(self, expected: Sequence[m.FromMember | m.Readings]) -> None:
        """Compare the next messages of the member with those of the reference, in order.

        Without any, another greeting shows that the member has sent nothing: its hello is next.
        """
        if not expected:
            self._fence()
            return
        wanted: list[str] = []
        received: list[str] = []
        for message in expected:
            figures = message.figures if isinstance(message, m.Report) else ()
            wanted.append(text_of(message, self._states[0], figures))
            answer = self._next_message(self._limits.answer)
            if answer is None:
                limit = f"within {self._limits.answer:g} s"
                raise CaseFailure(f"no answer {limit}", wanted, received)
            if isinstance(answer, m.TickReply):
                self._saved[1] = answer.saved
            received.append(text_of(answer, self._states[1], figures))
            if received[-1] != wanted[-1]:
                raise CaseFailure("another answer than expected", wanted, received)

    def _fence(self) -> None:
        self._put("to", m.Greet(), quiet=True)
        answer = self._next_message(self._limits.answer)
        if answer is None:
            raise CaseFailure("no hello as the answer to another greeting")
        if not isinstance(answer, m.Hello):
            raise CaseFailure("it sent a message that was not due", (), [self._text(answer)])

    def _text(self, message: m.FromMember | m.Readings) -> str:
        return text_of(message, KnownState(), ())

    # --- the bus ---

    def _put(self, on: str, message: m.ToMember, data: bytes = b"", *, quiet: bool = False) -> None:
        key = on or self._usual_key(message)
        body = data or encode(message)
        shown = "" if quiet else _shown(body)
        self._put_bytes("to/" + MEMBER if key == "to" else key, stamp(self._epoch) + body, shown)

    def _put_bytes(self, key: str, data: bytes, shown: str) -> None:
        if shown:
            self.sent.append(f"{key}: {shown[:300]}")
        self._stage.put(key, data)

    def _usual_key(self, message: m.ToMember) -> str:
        plain = "plain" in self._capabilities
        if isinstance(message, m.TickRequest):
            return "to" if self.role is MemberRole.AHEAD else "tick"
        if isinstance(message, m.EvolveRequest):
            return "to" if plain else "evolve"
        if isinstance(message, m.ViewShown):
            observes = self.role is MemberRole.OBSERVER and not plain
            return f"view/{message.event_type}" if observes else "to"
        return "all" if isinstance(message, m.Stop) else "to"

    def _next_message(self, seconds: float) -> m.FromMember | m.Readings | None:
        """The member's next message, without its metrics; None after `seconds`.

        Raises CaseFailure for one that cannot be read.
        """
        until = self._stage.now() + seconds
        while True:
            sample = self._next_sample(until)
            message = None if sample is None else self._message(sample)
            if message is not None:
                return message
            if self._stage.now() >= until:
                return None
            if not self._present:  # Its token may have overtaken its last messages.
                until = min(until, self._stage.now() + GONE_SECONDS)

    def _next_sample(self, until: float) -> KeyedSample | None:
        """The next sample; None at `until`, and often before it, so that it can be interrupted."""
        return self._stage.next(min(until, self._stage.now() + POLL_SECONDS))

    def _exit_code(self) -> int | None:
        """The member's exit code, once it has ended; None if it does not end in time."""
        until = self._stage.now() + self._limits.end
        while (code := self.process.code(POLL_SECONDS)) is None and self._stage.now() < until:
            self._stage.check()
        return code

    def _message(self, sample: KeyedSample) -> m.FromMember | m.Readings | None:
        """The message in a sample; None for a change of the token, and for metrics."""
        keys = self._stage.keys
        if sample.key == keys.alive(MEMBER):
            self._present = sample.there
            return None
        try:
            if keys.kind(sample.key) == "topic":
                return self._decoder.readings(sample.key.split("/")[3], MEMBER, sample.data)
            epoch, body = stamped(sample.data)
            message = self._decoder.from_member(MEMBER, body)
        except (ProtocolError, SceneError) as error:
            raise CaseFailure(
                f"an invalid message: {error}", (), [sample.data.hex()[:400]]
            ) from None
        if epoch != self._epoch:
            raise CaseFailure(f"a message of epoch {epoch} instead of {self._epoch}")
        return None if isinstance(message, m.MemberMetrics) else message
