"""The coordinator's process on the bus: the frame algorithm's ears, mouth and clock."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Collection, Generator, Mapping, Sequence
from concurrent.futures import TimeoutError as NoAnswer
from dataclasses import replace
from typing import Any, cast

import zenoh

from minerva_bus.errors import BusError, Followed, MinervaError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm, Phase
from minerva_bus.frame.description import World
from minerva_bus.frame.diary import Diary
from minerva_bus.frame.members import MemberState
from minerva_bus.frame.overruns import Overruns, real_period
from minerva_bus.frame.pacing import Glances, Pace
from minerva_bus.frame.schema import Wire
from minerva_bus.runtime.audit import Denials
from minerva_bus.runtime.control import answer
from minerva_bus.runtime.gate import STRANGERS
from minerva_bus.runtime.greetings import Greetings
from minerva_bus.runtime.guard import Guard, Place, Security
from minerva_bus.runtime.inbox import HubInbox, Question, Tick, question
from minerva_bus.runtime.large import LARGE, MOST_BEHIND, LargeMessages, Letter, Opened
from minerva_bus.runtime.links import Linked
from minerva_bus.runtime.outbox import Outbox
from minerva_bus.runtime.presence import Successor, presence, successor
from minerva_bus.runtime.questions import Questions
from minerva_bus.runtime.restraint import GUESTS, Restraint
from minerva_bus.runtime.session import LOOPBACK
from minerva_bus.runtime.system import REAL, System, run_through
from minerva_bus.runtime.totals import Totals
from minerva_bus.runtime.turned_away import TurnedAway
from minerva_bus.runtime.waiting import FEW, Deadlines, Waits
from minerva_bus.runtime.watchers import Asked, Printed, Started, Status, Watchers
from minerva_bus.security.credentials import covers
from minerva_bus.wire.codec import Decoder, declaration, encode
from minerva_bus.wire.epochs import stamped
from minerva_bus.wire.keys import COORDINATOR, Keys, who_asks
from minerva_bus.wire.limits import DEFAULT, Limits, check
from minerva_bus.wire.plain import as_map, on_screen, pack, unpack
from minerva_bus.wording import named_some

STATUS_EVERY = 0.1
NAP = 0.01
BLINK = 0.001
AT_ONCE = 500
"""Messages that are taken before a frame that is due begins."""
WATCHED_FOR = 5.0
ANSWERED_WITHIN = 2.0
SMOOTHING = 0.3
BACK_WITHIN = 6.0
REPORTS_WITHIN = 10.0
"""Seconds that members have after the last frame to show their last view and to report."""
HURRIED_REPORTS_WITHIN = 0.5
"""The same where a person ends the world, or a failure."""
_BEGIN = s.Begin()


class BusCoordinator:
    """Runs a world's frame algorithm over Zenoh."""

    def __init__(
        self,
        world: World,
        watchers: Watchers,
        *,
        rate: float = 0.0,
        listen: str = LOOPBACK,
        deadlines: Deadlines | None = None,
        shared: bool = False,
        routers: tuple[str, ...] = (),
        limits: Limits = DEFAULT,
        security: Security | None = None,
        epoch: int = 0,
        algorithm: FrameAlgorithm | None = None,
        queued: Collection[str] = (),
        system: System = REAL,
    ) -> None:
        self._system = system
        self.algorithm = FrameAlgorithm(world) if algorithm is None else algorithm
        self.epoch = epoch
        self._guests: frozenset[str] = self.algorithm.members.expected() - world.expected
        self.keys = Keys(world.name)
        self.inbox = HubInbox(STATUS_EVERY, system)
        self._outbox = Outbox(self.keys, epoch)
        self._stamp = self._outbox.stamp
        self._watch = watchers
        self.pace = Pace(rate)
        self.diary = Diary()
        self.hz = 0.0
        self.waited = 0.0
        self._glances = Glances()
        self.overruns = Overruns()
        self._ready = False
        self._watched_until = 0.0
        self._place = Place(listen, shared, routers)
        self.guard = Guard(self.keys, limits, security, self._say, system)
        self.limits = limits
        self._restraint = Restraint()
        self._waits = Waits(deadlines or Deadlines(), queued)
        self._decoder: Decoder = Decoder(world.vocabulary, limits)
        beside = Decoder(world.vocabulary, limits)
        self._large = LargeMessages(beside, system, self.inbox.put)
        self._questions = Questions(limits.questions, self._answer, world.name, system)
        self.algorithm.inbox.max_single_events = limits.single_events
        self._ticked: int = -1
        self._empty_reply = b""
        self._begin_at: float | None = None
        self._evolving_since = 0.0
        self._greetings = Greetings()
        self._status_at = 0.0
        self._status_frame: int = 0
        self._has_time = False
        self._reports_within = REPORTS_WITHIN
        self.last_frame_at = 0.0
        self.most_members = 0
        self.ended: s.Ended | None = None

    def run(self) -> s.Ended:
        """Run the world to its end. Raises BusError where the bus cannot be set up."""
        return run_through(self.life())

    def life(self) -> Generator[None, None, s.Ended]:
        """The same, turn by turn: whoever drives it decides when the next one comes."""
        with self.guard.session(self._place, self.inbox.put) as (session, endpoint):
            declared = self._declare(session)
            self._watch.listening(endpoint)
            self._status_at = self._system.monotonic()
            while self.ended is None:
                self._step()
                yield
            self.inbox.close()
            for one in declared:
                one.undeclare()
        return replace(self.ended, figures={**self.ended.figures, **self.overruns.figures()})

    def profile(self) -> Mapping[str, Mapping[str, float]]:
        """What was measured of the frames: nothing, here."""
        return {}

    def measured(self) -> Mapping[str, float]:
        """What was measured of the last frames: nothing, here."""
        self._watched_until = self._system.monotonic() + WATCHED_FOR
        return {}

    def counted(self) -> Totals:
        """What was counted of the frames: nothing, here."""
        self.measured()
        return Totals()

    def refused(self) -> Mapping[str, int]:
        """How much was refused, by whose it was."""
        return dict(sorted(self.guard.gate.refused.items()))

    def ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """The answer to a question that another thread asks. Raises BusError as a client does."""
        asked = Asked({"ask": question, **details})
        self.inbox.put(asked)
        try:
            found = asked.later.result(ANSWERED_WITHIN)
        except NoAnswer:
            raise BusError(f"it has not answered for {ANSWERED_WITHIN:g} s") from None
        if "error" in found:
            raise BusError(str(found["error"]))
        return found

    @property
    def watched(self) -> bool:
        """Whether somebody has asked how the world is doing lately."""
        return self.last_frame_at < self._watched_until

    def repace(self) -> None:
        """The pace has changed: the next frame may begin now, later, or not at all."""
        if self._ready:
            self._begin_at = self.pace.due(self._system.monotonic())

    def restart(self, member: str) -> str:
        """Ask for a process to be started anew; why that cannot be, or the empty text."""
        return self._watch.restart(member)

    def _declare(self, session: zenoh.Session) -> list[Any]:
        handler, keys = self.inbox.handler, self.keys
        liveliness = session.liveliness()
        return [
            *self._outbox.open(session),
            *self._watch.opened(session),
            *self.inbox.open(session, keys.sent_by("*"), keys.sent_by(COORDINATOR)),
            session.declare_queryable(f"{keys.control}/**", handler(self._asked_by)),
            session.declare_queryable(f"{keys.base}/ask/*", handler(self._asked_by)),
            liveliness.declare_token(keys.alive(COORDINATOR)),
            liveliness.declare_token(keys.epoch(self.epoch)),
            liveliness.declare_subscriber(keys.epoch("*"), handler(successor), history=True),
            liveliness.declare_subscriber(keys.alive("*"), handler(presence), history=True),
        ]

    def _asked_by(self, query: zenoh.Query) -> Question | None:
        return self._questions.hear(question(query))

    # --- one turn of the loop ---

    def _step(self) -> None:
        self._questions.answer_due()
        due = self._begin_at
        if due is None:
            self._use_time()
            self._take(self._next())
            return
        if self.algorithm.at_rest and self._system.monotonic() < (until := self._rest_until()):
            self._rest(until)
            return
        self._take_all_until(due)
        if self._begin_at is not None and self._system.monotonic() >= self._begin_at:
            self._begin_at, self._ready = None, False
            self.pace.began()
            period = real_period(self.pace.rate, self.algorithm.world)
            self.overruns.began(period, self._system.monotonic())
            self.tell(self._begin())

    def _rest_until(self) -> float:
        rates = self.algorithm.members.index.rates
        return self.pace.rest(self.last_frame_at, self._glances.next(rates))

    def _rest(self, until: float) -> None:
        """Take what comes next; where views are due by the clock, after a nap at the latest."""
        if self.algorithm.members.index.rates:
            self._take_all_until(until)
        else:
            self._use_time()
            self._take(self._next())

    def _next(self) -> Any:
        """What comes next; while questions wait, nothing where it is time for one of them."""
        while self._questions:
            item = self.inbox.ready()
            if item is not None or (wait := self._questions.wait) <= 0:
                return item
            self._system.sleep(min(wait, BLINK))
        return self.inbox.wait()

    def _begin(self) -> s.Begin:
        rates = self.algorithm.members.index.rates
        if not rates:
            return _BEGIN
        return s.Begin(self._glances.due(self._system.monotonic(), rates))

    def _take_all_until(self, due: float) -> None:
        """Take what there is, but not for ever: of a flood there is always more.

        What is still to come may take a nap's time to be heard, a blink's while somebody asks.
        """
        for _ in range(AT_ONCE):
            item = self.inbox.ready()
            if item is None:
                break
            self._take(item)
        wait = due - self._system.monotonic()
        if wait > 0:
            self._use_time()
            self._system.sleep(min(wait, BLINK if self._questions else NAP))

    def _use_time(self) -> None:
        """Others are waited for now: what nobody waits for may be done."""
        if self._has_time:
            self._has_time = False
            self._watch.idle()

    def _take(self, item: Any) -> None:
        if isinstance(item, tuple):
            self._heard(*cast("tuple[str, bytes]", item))
        elif isinstance(item, Tick):
            self._look_at_the_clock()
        elif isinstance(item, Printed | Started):
            self._hear_launcher(item)
        elif isinstance(item, Question | Asked):
            self._take_question(item)
        elif isinstance(item, Successor):
            self._meet(item.epoch)
        elif isinstance(item, Linked | TurnedAway | Denials):
            self.guard.notice(item)
        elif isinstance(item, s.Appeared) and self._keeps_out(item.member):
            pass
        elif isinstance(item, Opened):
            self._take_opened(item)
        elif item is not None:
            self.tell(item)

    def _take_question(self, item: Question | Asked) -> None:
        if isinstance(item, Question):
            self._questions.add(item)
        else:
            item.later.set_result(self._answered(item.question))

    def _hear_launcher(self, item: Printed | Started) -> None:
        if isinstance(item, Printed):
            self._log(item.member, item.line, item.level)
        else:
            self._waits.started(item.member, self._system.monotonic())

    def _answer(self, question: Question) -> None:
        who, orders, key = who_asks(question.key, self.keys.world)
        try:
            check("a question", len(question.data), self.limits.small_bytes, "bytes")
            asked = as_map(unpack(question.data), "a question")
            objection = self.guard.objection_to_question(who, orders, asked.get("ask"))
            found = {"error": objection} if objection else self._answered(asked)
        except MinervaError as error:
            found = {"error": str(error)}
        self._watch.operated()  # What is confirmed has been written down.
        question.reply(key, pack(found))

    def _answered(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a question. Raises MinervaError where there is none."""
        return answer(asked, self)

    def _log(self, member: str, text: str, level: str) -> None:
        self.diary.said(self._system.time(), member, text, self.algorithm.frame, level)

    def _say(self, member: str, text: str, details: str = "") -> None:
        """Log a word about a member, with its details, and show it without them."""
        members = self.algorithm.members
        guest = members.knows(member) and not members.get(member).expected
        if self._restraint.lets(GUESTS if guest else member, self._system.monotonic()):
            self._put_down(member, text, details)

    def _put_down(self, member: str, text: str, details: str = "") -> None:
        text, details = on_screen(text), on_screen(details)
        self._log(member, f"{text}\n{details}" if details else text, "warning")
        self._watch.said(member, text, details)

    def _heard(self, member: str, data: bytes) -> None:
        # Most replies to a tick are empty: equal bytes need neither limits nor decoding, which
        # would cost a world of a thousand members several milliseconds a frame.
        if data == self._empty_reply and self.algorithm.awaits_tick(member):
            self.tell(m.TickReply(member, self._ticked))
            return
        if self.guard.keeps_out(member):
            return
        room = self.guard.gate.has_room(self._name_of(member), len(data))
        wire = declaration(data, len(self._stamp))
        if room and data and not self.algorithm.members.knows(member):
            self.tell(m.Leaving(member))  # It is a stranger's, whatever it says.
            return
        if not data or (wire.awaited and self.algorithm.awaits(member)):
            self._heard_in_full(member, data)
        elif not (room and self._within_limits(member, data, wire)):
            self._pass_over(member)
        elif wire.awaited and len(data) > LARGE:
            self._pass_late(member)
        else:
            began = self._system.monotonic()
            self._heard_in_full(member, data)
            self.guard.gate.spent(self._name_of(member), self._system.monotonic() - began)

    def _within_limits(self, member: str, data: bytes, wire: Wire) -> bool:
        """Whether a message that no frame waits for is within its member's limits per second."""
        gate, name = self.guard.gate, self._name_of(member)
        if wire is m.Hello.WIRE and not gate.has_hello(name):
            return False
        return gate.has_values(name, data[len(self._stamp) :])

    def _heard_in_full(self, member: str, data: bytes) -> None:
        """Hear a message: a small one now, a large one when it is decoded."""
        members = self.algorithm.members
        try:
            if not data.startswith(self._stamp):
                if data:
                    stamped(data)
                    self._pass_late(member)
                return
            body = data[len(self._stamp) :]
            if len(body) > LARGE or self._large.behind(member):
                if self._large.behind(member) < MOST_BEHIND:
                    self._large.add(Letter(member, members.get(member).joins, body))
                else:
                    self._pass_over(member)
                return
            message = self._decoder.from_member(member, body)
        except (ProtocolError, SceneError) as error:
            self.tell(s.Violation(member, str(error)))
            return
        self._understood(member, body, message)

    def _take_opened(self, opened: Opened) -> None:
        """Hear a large message, unless who said it has come anew since."""
        letter = opened.letter
        self._large.taken(opened)
        self._decoded_in(opened.seconds)
        members = self.algorithm.members
        if not members.knows(letter.member) or members.get(letter.member).joins != letter.life:
            return
        if opened.message is None:
            self.tell(s.Violation(letter.member, opened.problem))
        else:
            self._understood(letter.member, letter.body, opened.message)
        if not isinstance(opened.message, m.TickReply | m.EvolveReply):
            self.guard.gate.spent(letter.member, opened.seconds)

    def _decoded_in(self, seconds: float) -> None:
        """To decode a large message has taken so long."""

    def _understood(self, member: str, body: bytes, message: m.FromMember) -> None:
        if isinstance(message, m.EvolveReply):
            elapsed = self._system.monotonic() - self._evolving_since
            message = replace(message, elapsed=elapsed, received=body)
        elif isinstance(message, m.TickReply):
            message = replace(message, received=body)
        reason = ""
        if isinstance(message, m.Hello):
            self._greetings.answered(member)
            if self._waits.came(member, self._system.monotonic()):
                self._watch.came(member)
            reason = self.guard.gate.objection(message)
        self.tell(s.Violation(member, reason) if reason else message)

    def _keeps_out(self, member: str) -> bool:
        """Whether one that has appeared is not greeted: shut out, or one too many."""
        if self.guard.keeps_out(member):
            return True
        members, most = self.algorithm.members, self.limits.members
        if members.knows(member) or members.count < most:
            return False
        self.guard.too_many(f"{most} members are there already; more are not greeted")
        return True

    def _name_of(self, member: str) -> str:
        """Its name, if it is known: of strangers there may be any number."""
        return member if self.algorithm.members.knows(member) else STRANGERS

    def _pass_over(self, member: str) -> None:
        """Hear nothing of what is too much."""
        who = self._name_of(member)
        told = self.guard.gate.too_much(who)
        if told:
            self._say(who, told)

    def _pass_late(self, member: str) -> None:
        """A message was for another coordinator: it counts as a late one."""
        members = self.algorithm.members
        if members.knows(member):
            members.get(member).late += 1

    def _meet(self, epoch: int) -> None:
        """There is a coordinator of this epoch. Raises Followed where it has come later."""
        if epoch > self.epoch:
            raise Followed(
                f"another coordinator runs the world {self.keys.world!r} now, of epoch {epoch};"
                f" this one, of epoch {self.epoch}, stops in frame {self.algorithm.frame}"
            )

    def tell(self, stimulus: s.Stimulus) -> None:
        """Give the algorithm a stimulus, and do what it says."""
        self._look_at(stimulus)
        for instruction in self.algorithm.receive(stimulus):
            self._do(instruction)

    def _look_at(self, stimulus: s.Stimulus) -> None:
        """Note who has answered, and whether the end is urgent."""
        if isinstance(stimulus, m.TickReply):
            self.overruns.heard("events", stimulus.member, self._system.monotonic())
        elif isinstance(stimulus, m.EvolveReply):
            self.overruns.heard("evolution", stimulus.member, self._system.monotonic())
        elif isinstance(stimulus, s.End) and (stimulus.failed or stimulus.hurried):
            self._reports_within = HURRIED_REPORTS_WITHIN

    def _do(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.Send):
            self._send(instruction)
        elif isinstance(instruction, s.FrameDone):
            self._end_frame(instruction)
        elif isinstance(instruction, s.Ready):
            self._ready = True
            self._begin_at = self.pace.due(self._system.monotonic())
            if instruction.frame == 0:
                self.most_members = len(self.algorithm.members.active())
        elif isinstance(instruction, s.Show):
            data = self._encode(instruction.message)
            self._outbox.show(instruction.event_type, data, instruction.to)
        elif isinstance(instruction, s.Stopping):
            self._watch.stopping(instruction.reason)
        elif isinstance(instruction, s.Notify):
            self._say(instruction.member, instruction.text, instruction.details)
        else:
            self.ended = instruction

    def _end_frame(self, instruction: s.FrameDone) -> None:
        self.last_frame_at = self._system.monotonic()
        self._has_time = True
        late = self.overruns.done(instruction.frame, self.last_frame_at)
        if late:
            self._say("coordinator", late)
        if self.watched:
            self.diary.frame(instruction.frame, instruction.events)
        self._watch.frame_done(instruction)
        if self._outbox.observed:
            self._outbox.record(self._encode(instruction.record))

    def _send(self, instruction: s.Send) -> None:
        if isinstance(instruction.message, m.Refused):
            self.guard.gate.count(instruction.to)
        elif isinstance(instruction.message, m.Greet):
            self._greetings.sent(instruction.to, self._system.monotonic())
        data = self._encode(instruction.message)
        if instruction.to == s.TICKED:
            self._ticked = self.algorithm.frame
            self._empty_reply = self._stamp + encode(m.TickReply("", self._ticked))
        elif isinstance(instruction.message, m.EvolveRequest) and not instruction.message.part:
            self._evolving_since = self._system.monotonic()
        self._outbox.send(instruction.to, data)
        self._has_time = True

    def _encode(self, message: m.ToMember | m.FrameRecord) -> bytes:
        return encode(message)

    # --- the clock ---

    def _look_at_the_clock(self) -> None:
        now = self._system.monotonic()
        if now < self._status_at + STATUS_EVERY / 2:
            return  # After a long frame the clock has knocked several times.
        for name in self.guard.look(now):
            self._part_from(name)
        self._greet_again(now)
        for subject, text in self._restraint.left_out(now):
            self._put_down(COORDINATOR if subject == GUESTS else subject, text)
        algorithm = self.algorithm
        waiting = algorithm.waiting_for()
        step = algorithm.frame, algorithm.phase
        self.waited = self._waits.look(step, algorithm.in_frame, waiting, now)
        self._watch.status(self._status(now, tuple(waiting), self.waited))
        if self.waited:
            self._wait_aloud(waiting, now)

    def _part_from(self, common_name: str) -> None:
        """A certificate was revoked: whoever has come in by it is out."""
        for member in self.algorithm.members:
            if covers(common_name, member.name) and member.state is not MemberState.LEFT:
                self.tell(s.Violation(member.name, self.guard.gate.shut_out(member.name)))

    def _greet_again(self, now: float) -> None:
        for name in self._greetings.unanswered(now):
            if self.algorithm.members.get(name).state is MemberState.JOINING:
                self._send(s.Send(name, m.Greet()))

    def _status(self, now: float, waiting: tuple[str, ...], waited: float) -> Status:
        frame = self.algorithm.frame
        rate = (frame - self._status_frame) / max(now - self._status_at, 1e-9)
        self.hz = rate if self.pace.paused else self.hz + SMOOTHING * (rate - self.hz)
        self._status_at, self._status_frame = now, frame
        here = len(self.algorithm.members.active())
        self.most_members = max(self.most_members, here)
        return Status(
            frame, rate, here, self.algorithm.phase.value, self.pace.paused, waiting, waited
        )

    def _wait_aloud(self, waiting: list[str], now: float) -> None:
        """Say for whom the world waits, ever more seldom; then do what is to be done."""
        if self.algorithm.phase is Phase.STOPPING:
            self.tell(s.Silent())
            self._wait_for_reports(now)
            return
        unsaid = self._waits.unsaid(now)
        if unsaid:
            self.tell(s.Silent())
            frame = f"frame {self.algorithm.frame} ({self.algorithm.phase.value}) has been waiting"
            guests = [one for one in unsaid if not self.algorithm.members.get(one).expected]
            for name, text in self._waits.told(unsaid, guests, now):
                self._say(name or COORDINATOR, f"{frame} for {text}")
        if self.waited >= BACK_WITHIN and self._guests:
            self._let_go(waiting)
        for name, then in self._waits.overdue(now):
            self._wait_no_longer(name, then, now)

    def _wait_for_reports(self, now: float) -> None:
        """Log whose report is missing after the last frame; after the time-out go on without it."""
        left = self._reports_within - self.waited
        waiting = f"the world has ended; waiting for {{}} for {left:.0f} s"
        self._say_of(self._waits.unsaid(now), waiting, "its last output", "the last output")
        if left > 0:
            return
        late = sorted(self.algorithm.waiting_for())
        for name in late:
            self._watch.stalled(name, self.waited)
        missing = "after the last frame, {} did not come in time and may be missing"
        self._say_of(late, missing, "its output", "the output")
        self.tell(s.End("no report in time"))

    def _say_of(self, names: Sequence[str], text: str, its: str, the: str) -> None:
        """Log a text about each of a few members, or about many together."""
        if len(names) > FEW:
            self._say(COORDINATOR, text.format(f"{the} of {named_some(names, FEW)}"))
            return
        for name in names:
            self._say(name, text.format(its))

    def _wait_no_longer(self, name: str, then: str, now: float) -> None:
        waited = self._waits.since(name, now)
        if then == "skip":
            self.tell(s.Skip(name))
        elif then == "stop":
            silence = f"did not answer for {waited:.1f} s in frame {self.algorithm.frame}"
            self._say(name, f"{silence}; the world stops")
            self.tell(s.End(f"{name} {silence}", failed=True))
        else:
            self._waits.again(name, now)
            self._watch.stalled(name, waited)
            if not self.algorithm.members.get(name).expected:
                self.tell(s.Violation(name, f"it did not answer for {waited:.0f} s"))

    def _let_go(self, waiting: list[str]) -> None:
        """Wait no longer for guests of the coordinator before, who have not come back."""
        for name in sorted(self._guests.intersection(waiting)):
            self.tell(s.Abandoned(name))
        self._guests = frozenset[str]()
