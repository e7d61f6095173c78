"""Plays the coordinator in one case, and compares the member with the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from minerva_bus.errors import MinervaError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Refusal
from minerva_bus.wire.codec import encode, stamp
from minerva_bus.wire.plain import pack, unpack
from minerva_bus.world.evolution import Policy
from minerva_conformance.case import (
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
from minerva_conformance.comparison import ComparedMember
from minerva_conformance.launching import StartMember
from minerva_conformance.link import (
    FIRST_EPOCH,
    POLL_SECONDS,
    CaseFailure,
    MemberLink,
    NotJoined,
    TimeLimits,
)
from minerva_conformance.scripted_world import ScriptedHub, ScriptedWorld
from minerva_conformance.texts import KnownState, text_of
from minerva_conformance.world import (
    DT,
    MEMBER,
    SEED,
    VOCABULARY,
    MemberRole,
    roles_of,
)


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
        except _PolicyUnknown as reason:
            return CaseResult(case, role, CaseOutcome.NOT_APPLICABLE, str(reason))
        except CaseFailure as failure:
            return _result(player, CaseOutcome.FAILED, failure)
        except NotJoined as reason:
            outcome = CaseOutcome.BLOCKED if case.joined else CaseOutcome.FAILED
            return _result(player, outcome, CaseFailure(str(reason)))
        finally:
            player.link.close()
    return CaseResult(case, role, CaseOutcome.PASSED, sent=tuple(player.link.sent))


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
            player.link.close()


def _result(player: _Player, outcome: CaseOutcome, failure: CaseFailure) -> CaseResult:
    problem = f"{failure}\n{player.link.process.output()}".strip()
    return CaseResult(
        player.case,
        player.role,
        outcome,
        problem,
        tuple(player.link.sent),
        failure.expected,
        failure.received,
    )


class _PolicyUnknown(MinervaError):
    """The member ends instead of joining, as it may under any policy but the usual one."""


def _shown(data: bytes) -> str:
    """A message as plain data, without the vocabulary."""
    plain = unpack(data)
    if plain[0] == "welcome":
        plain[2] = "the vocabulary"
    return str(plain)


class _Player:
    """State of one case: the link to the member, and what it is compared with."""

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
        self._compared = ComparedMember(self.role, case.id, capabilities)
        # As a step of the case allows.
        self._ended = False
        if case.name_taken:
            stage.hold(stage.keys.alive(MEMBER))
        stage.appear(FIRST_EPOCH)
        cuttable = any(isinstance(step, CutLink) for step in case.steps)
        self.link = MemberLink(stage, start, endpoint, role, limits, cuttable=cuttable)

    def play(self) -> None:
        """Run all steps. Raises CaseFailure, and NotJoined if the case could not begin."""
        if self.case.name_taken:
            self._await_refusal()
            return
        if self.case.joined:
            self._join(self.case.frame)
        else:
            self.link.await_token(self.link.limits.join)
        for step in self.case.steps:
            self._step(step)
            if self._ended:
                return

    # --- joining ---

    def greeted(self) -> m.Hello:
        """Wait for the member and greet it. Raises NotJoined and CaseFailure."""
        self.link.await_token(self.link.limits.join)
        self._put("to", m.Greet())
        hello = self.link.next_message(self.link.limits.answer)
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
        if self.case.policy != Policy.SEQUENTIAL.value:
            self._check_policy()

    def _check_policy(self) -> None:
        """Wait until the member knows the policy, which it need not. Raises _PolicyUnknown."""
        self._put("to", m.Greet(), quiet=True)
        answer = self.link.next_message(self.link.limits.answer)
        if not isinstance(answer, m.Hello):
            if self.link.exit_code():
                raise _PolicyUnknown(f"it does not know the policy {self.case.policy}")
            raise CaseFailure("no hello as the answer to a greeting after its welcome")

    def _enter(self, frame: int, *, more: bool) -> None:
        if not more:
            self._welcome(frame, saved=False)
            return
        plain = unpack(encode(self._welcome_at(frame)))
        plain[2]["later"] = ["a key of a later version"]
        self._welcome(frame, saved=False, data=pack(plain))

    def _welcome_at(self, frame: int, seed: int = SEED) -> m.Welcome:
        return m.Welcome(self.link.stage.keys.world, VOCABULARY, seed, DT, frame, self.case.policy)

    def _welcome(self, frame: int, *, saved: bool, seed: int = SEED, data: bytes = b"") -> None:
        welcome = self._welcome_at(frame, seed)
        own, theirs = self._compared.saved if saved else (None, None)
        self._put("to", replace(welcome, saved=theirs), data)
        self._compared.sent(welcome)
        self._compared.receive(replace(welcome, saved=own))

    def _await_refusal(self) -> None:
        """The member ends without an answer to greetings, which are for the holder of its name."""
        until = self.link.stage.now() + self.link.limits.end
        while (
            code := self.link.process.code(POLL_SECONDS)
        ) is None and self.link.stage.now() < until:
            self._put("to", m.Greet(), quiet=True)
            self._check_silence()
        self._check_silence()
        if code is None:
            raise CaseFailure("it still runs, although another member has its name")
        if code == 0:
            raise CaseFailure("it ended with exit code 0, although its name was taken")

    def _check_silence(self) -> None:
        while (sample := self.link.stage.next(0.0)) is not None:
            if self.link.message(sample) is not None:
                raise CaseFailure("it sent a message under a name that another member has")

    # --- steps ---

    def _step(self, step: Step) -> None:
        match step:
            case Deliver():
                self._deliver(step)
            case PublishReadings(readings):
                data = encode(readings)
                key = f"topic/{readings.topic}/{readings.member}"
                self.link.put(key, data, _shown(data))
                self._compare(self._compared.receive(readings))
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
                self.link.epoch += 1
                self.link.sent.append(
                    f"(the coordinator's epoch is {self.link.epoch} from here on)"
                )
            case Disappear():
                self.link.stage.vanish()
                self.link.sent.append("(the coordinator's token vanishes)")
                self.link.await_absence()
            case Reappear():
                self._reappear(step)
            case CutLink(frame):
                self._cut_link(frame)
            case Interrupt():
                self._interrupt()
            case StartAgain(frame):
                self._start_again(frame)

    def _deliver(self, step: Deliver) -> None:
        message = self._compared.in_its_form(step.message)
        self._put(step.on, message, step.data)
        self._compared.sent(step.message)
        try:
            expected = self._compared.receive(step.message)
        except Refusal:
            return  # The member ends; the script says how.
        self._compare(expected)

    def _send_ignored(self, step: SendIgnored) -> None:
        data = step.data if step.epoch is None else stamp(self.link.epoch + step.epoch) + step.data
        self.link.put(step.on, data, f"{step.data.hex()[:200]}, which it must ignore")
        if not step.checked:
            return
        if step.may_end:
            self._put("to", m.Greet())
            answer = self.link.next_message(self.link.limits.answer)
            if isinstance(answer, m.Failed):
                self._await_end(failed=True)
                self._ended = True
            elif not isinstance(answer, m.Hello):
                shown = "nothing" if answer is None else self._text(answer)
                raise CaseFailure("it answered a message that it must drop", (), [shown])
            return
        self._fence()

    def _reappear(self, step: Reappear) -> None:
        self.link.epoch += step.later
        self.link.stage.appear(self.link.epoch)
        self.link.sent.append(f"(the token of a coordinator of epoch {self.link.epoch} appears)")
        if step.later:
            self._compared.succeed()
        self._return_to(step.frame, saved=step.saved, seed=SEED if step.seed is None else step.seed)

    def _return_to(self, frame: int | None, *, saved: bool, seed: int) -> None:
        """Wait for the member's token, greet it and welcome it again, unless `frame` is None."""
        try:
            self.link.await_token(self.link.limits.join)
        except NotJoined as reason:
            raise CaseFailure(str(reason)) from None
        self._deliver(Deliver(m.Greet()))
        if frame is not None:
            self._welcome(frame, saved=saved, seed=seed)

    def _cut_link(self, frame: int) -> None:
        self.link.cut()
        self.link.sent.append("(its link is cut)")
        self.link.await_absence()
        self._return_to(frame, saved=True, seed=SEED)

    def _interrupt(self) -> None:
        self.link.process.interrupt()
        self.link.sent.append("(its process is asked to end)")
        has_left = False
        while (message := self.link.next_message(self.link.limits.end)) is not None:
            if has_left:
                raise CaseFailure("it sent a message after `leaving`", (), [self._text(message)])
            has_left = isinstance(message, m.Leaving)
        self.link.await_absence()
        code = self.link.exit_code()
        if code is None:
            raise CaseFailure("it has not ended")
        if has_left and code != 0:
            raise CaseFailure(f"it has left, but its exit code is {code}")

    def _break(self, message: m.ToMember) -> None:
        self._put("", self._compared.in_its_form(message))
        answer = self.link.next_message(self.link.limits.answer)
        if not isinstance(answer, m.Failed):
            shown = [] if answer is None else [self._text(answer)]
            raise CaseFailure("it did not send `failed`", ["failed"], shown)
        self._await_end(failed=True)

    def _start_again(self, frame: int) -> None:
        self.link.start_again()
        self._compared.start_again()
        self._join(frame)

    def _await_end(self, failed: bool | None) -> None:
        # If it vanished at once, a member that has to fail might notice that first.
        if failed:
            self.link.exit_code()
        # A member may keep its session until the coordinator has gone.
        self.link.stage.vanish()
        code = self.link.exit_code()
        if code is None:
            raise CaseFailure("it has not ended")
        if failed is not None and failed != (code != 0):
            wanted = "other than 0" if failed else "0"
            raise CaseFailure(f"its exit code is {code}; expected {wanted}")
        self.link.await_absence()

    # --- answers ---

    def _compare(self, expected: Sequence[m.FromMember | m.Readings]) -> None:
        """Compare the next messages of the member with those of the reference, in order.

        Without any, another greeting shows that the member has sent nothing: its hello is next.
        """
        if expected:
            self._compared.compare(expected, self.link)
        else:
            self._fence()

    def _fence(self) -> None:
        self._put("to", m.Greet(), quiet=True)
        answer = self.link.next_message(self.link.limits.answer)
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
        self.link.put("to/" + MEMBER if key == "to" else key, stamp(self.link.epoch) + body, shown)

    def _usual_key(self, message: m.ToMember) -> str:
        plain = self._compared.is_plain
        if isinstance(message, m.TickRequest):
            return "tick"
        if isinstance(message, m.EvolveRequest):
            return "to" if plain else "evolve"
        if isinstance(message, m.ViewShown):
            observes = self.role is MemberRole.OBSERVER and not plain
            return f"view/{message.event_type}" if observes else "to"
        return "all" if isinstance(message, m.Stop) else "to"
