"""The coordinator of a world on Zenoh: one loop around a runner, its inbox and its clock."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import zenoh
from zenoh.handlers import Callback

from minerva_bus.errors import Followed
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm, Phase
from minerva_bus.frame.member_table import MemberState
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.admission import Admission, Linked, ListenConfig
from minerva_bus.runtime.metrics import Status
from minerva_bus.runtime.questions import COMMANDS, Answers, Command, LocalQuestion, WorldRun
from minerva_bus.runtime.receiver import Decoded, Receiver, Successor, TokensChanged, successor
from minerva_bus.runtime.runner import Notice, Runner, Sink
from minerva_bus.runtime.session import REAL, System, run_through
from minerva_bus.runtime.session_inbox import HubInbox, Question, TimerTick
from minerva_bus.runtime.timeouts import MAX_NAMED, Deadlines, Waits
from minerva_bus.runtime.transport import ZenohTransport
from minerva_bus.security.credentials import covers
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.keys import COORDINATOR, Keys
from minerva_bus.wire.plain import DEFAULT, Limits
from minerva_bus.wording import duration, named_some
from minerva_bus.world.operator import FileStatus, PersonOperation

if TYPE_CHECKING:
    from minerva_bus.collect.collector import SeriesHistory

# --- what a coordinator reports to its launcher, and gets from it ---


@fast_dataclass
class Printed:
    """A line that a member's process printed, or that the launcher logged about it."""

    member: str
    line: str
    level: str = "info"


@fast_dataclass
class Started:
    """The launcher starts a member's process."""

    member: str


@dataclass(slots=True, kw_only=True)
class Watchers:
    """Callbacks of a coordinator; it calls them in its main thread."""

    said: Callable[[str, str, str], None]
    """A warning: member, text, and details for the log only."""
    status: Callable[[Status], None]
    listening: Callable[[str], None]
    stalled: Callable[[str, float], None]
    came: Callable[[str], None] = field(default=lambda _: None)
    """A member whose process the launcher has started sent its `hello`."""
    frame_done: Callable[[s.FrameDone], None] = field(default=lambda _: None)
    idle: Callable[[], None] = field(default=lambda: None)
    """The coordinator is about to wait for members: deferred work may be done."""
    operated: Callable[[], None] = field(default=lambda: None)
    """Events wait for a frame, or belong to it, which only this coordinator knows."""
    stopping: Callable[[s.Stopping], None] = field(default=lambda _: None)
    """No frame follows."""
    restart: Callable[[str], str] = field(default=lambda _: "no launcher restarts its processes")
    stack: Callable[[str], str] = field(default=lambda _: "no launcher started its processes")
    noted: Callable[[PersonOperation], None] = field(default=lambda _: None)
    """A person has operated the world."""
    opened: Callable[[zenoh.Session], list[Any]] = field(default=lambda _: list[Any]())
    """Returns further declarations on the hub's session."""
    files: Callable[[], tuple[FileStatus, ...]] = field(default=lambda: ())
    """What the launcher writes in this process: the record and the journal."""
    collected: SeriesHistory | None = None
    """Collected series, for dashboards."""


# --- the members that a frame waits for ---

STATUS_EVERY: Final = 0.1
"""Seconds between two reports of a world's status."""

GREETED_AGAIN: Final = 1.0
"""Seconds after which a member that has not answered its greeting is greeted once more."""

# Longer than the time after which such a member ends by itself (`member.BACK_WITHIN`).
BACK_WITHIN: Final = 6.0
"""Seconds that members of the previous coordinator have to return to its successor."""

# Shorter than the launcher waits before it kills the coordinator, which
# still has to send its final report.
HURRIED_REPORTS_WITHIN: Final = 0.5
"""Seconds for the last view and the report if a person or a failure ends the world."""


MORE_TIME: Final = "; hard = 120 under [process.NAME], or --view NAME:hard=120, gives it more time"
"""The end of a log line about output that has been given up."""


class Monitor:
    """Checks every STATUS_EVERY seconds for awaited members, and acts on their time-outs."""

    def __init__(self, coordinator: Coordinator, waits: Waits) -> None:
        self._algorithm = coordinator.algorithm
        self._runner = coordinator.runner
        self._schedule = coordinator.schedule
        self._meter = coordinator.status
        self._admission = coordinator.admission
        self._log = coordinator.log
        self._watchers = coordinator.watchers
        self._clock = coordinator.system.monotonic
        self._waits = waits
        self._greeted: dict[str, float] = {}
        self._is_hurried = False

    def started(self, member: str) -> None:
        """Note that the launcher starts a member's process; its waiting time begins now."""
        self._waits.started(member, self._clock())

    def greeted(self, member: str) -> None:
        """Note that a greeting was sent to a member."""
        self._greeted[member] = self._clock()

    def arrived(self, member: str) -> None:
        """Note the `hello` of a member."""
        self._greeted.pop(member, None)
        if self._waits.arrived(member, self._clock()):
            self._watchers.came(member)

    def outlook(self, name: str) -> str:
        """What the world does with an awaited member, and when."""
        guest = not self._algorithm.members.get(name).expected
        return self._waits.outlook(name, self._waits.since(name, self._clock()), guest)

    def end(self, end: s.End) -> None:
        """End the world; members have less time for reports if its owner waits for the end."""
        if end.failed or end.hurried:
            self._is_hurried = True
        self._runner.handle(end)

    def tick(self, now: float) -> None:
        """Report the status and apply time-outs; `now` is the monotonic time in seconds."""
        self._schedule.check_end(now)
        if now < self._meter.at + STATUS_EVERY / 2:
            return  # After a long frame several ticks of the clock have queued up.
        # Revoked members are informed before the next check cuts their links.
        for name in self._admission.look(now):
            self._part_from(name)
        self._greet_again(now)
        self._log.report_omitted(now)
        algorithm = self._algorithm
        active = {member.name for member in algorithm.members.index.active}
        for name in self._waits.overtaken(active, now):
            self._watchers.came(name)
        waiting = algorithm.waiting_for()
        step = algorithm.frame, algorithm.phase
        waited = self._waits.update(step, algorithm.in_frame, waiting, now)
        self._meter.waited = waited
        self._watchers.status(self._meter.status(now, waiting))
        if waited:
            self._report_waiting(waiting, now)

    def _part_from(self, common_name: str) -> None:
        """Remove all members that joined with a certificate that was revoked."""
        for member in self._algorithm.members:
            if covers(common_name, member.name) and member.state is not MemberState.LEFT:
                reason = self._admission.rules.shut_out(member.name)
                self._runner.handle(s.Violation(member.name, reason))

    def _greet_again(self, now: float) -> None:
        # After a link is restored, a member's token may arrive before its subscriptions do; the
        # first greeting is lost then.
        late = sorted(name for name, at in self._greeted.items() if now >= at + GREETED_AGAIN)
        for name in late:
            del self._greeted[name]
            # A guest that has left long ago is forgotten.
            known = self._algorithm.members.knows(name)
            if known and self._algorithm.members.get(name).state is MemberState.JOINING:
                # This notes the greeting again, so it is repeated until the member answers.
                self._runner.transport.send(name, m.Greet())

    def _report_waiting(self, waiting: Sequence[str], now: float) -> None:
        """Log which members the frame waits for, with back-off, and apply their time-outs."""
        algorithm = self._algorithm
        if algorithm.phase is Phase.STOPPING:
            # The second `Silent` drops members whose token is gone: a
            # token may overtake the last message.
            self._runner.handle(s.Silent())
            self._await_reports(now)
            return
        late = self._waits.reportable(now)
        if late:
            self._runner.handle(s.Silent())
            frame = f"frame {algorithm.frame} ({algorithm.phase.value}) has been waiting"
            guests = [name for name in late if not algorithm.members.get(name).expected]
            for name, text in self._waits.describe(late, guests, now):
                self._log.warn(name or COORDINATOR, f"{frame} for {text}")
        self._give_up_guests(waiting, now)
        for name, action in self._waits.overdue(now):
            self._time_out(name, action, now)

    def _await_reports(self, now: float) -> None:
        """Log which reports are missing after the last frame; after the time-out end without."""
        late = sorted(self._algorithm.waiting_for())
        within = HURRIED_REPORTS_WITHIN if self._is_hurried else self._waits.for_output(late)
        left = within - self._meter.waited
        waiting = f"the world has ended; finishing {{}} ({duration(left)} at most)"
        self._warn_of(self._waits.reportable(now), waiting, "its last output", "the last output")
        if left > 0:
            return
        for name in late:
            self._watchers.stalled(name, self._meter.waited)
        missing = (
            f"after the last frame, {{}} did not come within {within:g} s and may be missing"
            f"{'' if self._is_hurried else MORE_TIME}"
        )
        self._warn_of(late, missing, "its output", "the output")
        self._runner.handle(s.End("no report in time"))

    def _warn_of(self, names: Sequence[str], text: str, its: str, the: str) -> None:
        """Log a text for each of a few members, or once for all of many."""
        if len(names) > MAX_NAMED:
            self._log.warn(COORDINATOR, text.format(f"{the} of {named_some(names, MAX_NAMED)}"))
            return
        for name in names:
            self._log.warn(name, text.format(its))

    def _time_out(self, name: str, action: str, now: float) -> None:
        """Apply the time-out policy of a member: skip, stop or restart."""
        waited = self._waits.since(name, now)
        if action == "skip":
            self._runner.handle(s.Skip(name))
        elif action == "stop":
            silence = f"did not answer for {waited:.1f} s in frame {self._algorithm.frame}"
            self._log.warn(name, f"{silence}; the world stops")
            self.end(s.End(f"{name} {silence}", failed=True))
        else:
            # The next process gets the full time, regardless of the previous one.
            self._waits.restart(name, now)
            self._watchers.stalled(name, waited)
            # Nothing restarts a guest, so it is excluded; it may join again.
            if not self._algorithm.members.get(name).expected:
                reason = f"it did not answer for {duration(waited)}"
                self._runner.handle(s.Violation(name, reason))

    def _give_up_guests(self, waiting: Sequence[str], now: float) -> None:
        """Stop waiting for members of the previous coordinator that have not returned."""
        # The journal names guests of the predecessor, but some may have left with it.
        for name in self._algorithm.members.missing_guests():
            if name in waiting and self._waits.since(name, now) >= BACK_WITHIN:
                self._runner.handle(s.Abandoned(name))


# --- the loop ---

POLL_SECONDS: Final = 0.01
"""Longest sleep in seconds before the next frame is due."""

POLL_SECONDS_ASKED: Final = 0.001
"""Longest sleep in seconds while an operator's question waits."""

MAX_MESSAGES_AT_ONCE: Final = 500
"""Most messages handled before a due frame begins: a flood delays the frame only this much."""


class Coordinator(WorldRun):
    """Runs a world's frame algorithm over Zenoh.

    `runner` executes the algorithm; the receiver admits messages, the monitor applies time-outs,
    `schedule` times the frames. `sinks` observe the run after those of the coordinator itself.

    Args:
        watchers: Callbacks of the launcher, called in the main thread.
        rate: Frames per second; 0: as many as possible.
        where: Endpoints, routers, shared memory and security.
        deadlines: Time-outs of members.
        limits: What members may send.
        epoch: Rises with each coordinator of a world; messages of a lower one are ignored.
        algorithm: Continues a run, or replays one; by default the world begins.
        queued: Members whose processes have not been started yet.
        keep: Whether to measure every frame for a profile.
        commands: Questions that operators may ask, by name.
        sinks: Further sinks of the runner.
        system: Clock, threads and sessions.

    """

    def __init__(
        self,
        world: WorldSpec,
        watchers: Watchers,
        *,
        rate: float = 0.0,
        where: ListenConfig | None = None,
        deadlines: Deadlines | None = None,
        limits: Limits = DEFAULT,
        epoch: int = 0,
        algorithm: FrameAlgorithm | None = None,
        queued: Collection[str] = (),
        keep: bool = False,
        commands: Mapping[str, Command] = COMMANDS,
        sinks: Iterable[Sink | Callable[[Notice], None]] = (),
        system: System = REAL,
    ) -> None:
        super().__init__(world, algorithm, rate, limits, watchers.said, system, commands, keep=keep)
        self.keys, self.watchers, log = Keys(world.name), watchers, self.log
        self.collected = watchers.collected
        self.inbox = HubInbox(STATUS_EVERY, system)
        where = where or ListenConfig()
        self.admission = Admission(self.keys, limits, where, log.warn, system)
        self.transport = ZenohTransport(
            self.keys, epoch, self.metrics, system.monotonic, self._note_sent
        )
        own = (self.schedule, self.metrics, log, self.status, self)
        self.runner = Runner(self.algorithm, self.transport, [*own, *sinks])
        self._monitor = Monitor(self, Waits(deadlines or Deadlines(), queued))
        receiver = Receiver(self, limits, self._monitor.arrived)
        self._receiver, self._postponed = receiver, receiver.postponed.queue
        self._answers = Answers(self, self.admission, limits, watchers.operated)
        self._waiting = self._answers.waiting
        # By type of what arrives in the inbox.
        self._handlers: dict[type, Callable[[Any], None]] = {
            tuple: receiver.receive,
            Decoded: receiver.take_decoded,
            TokensChanged: receiver.take_token,
            s.End: self._monitor.end,
            TimerTick: self._tick,
            Printed: lambda line: self.log.line(line.member, line.line, line.level),
            Started: lambda started: self._monitor.started(started.member),
            Question: self._answers.add,
            LocalQuestion: self.answer,
            Successor: self._compare_epochs,
            Linked: self.admission.notice,
            type(None): lambda _: None,
        }

    def run(self) -> s.Ended:
        """Run the world to its end. Raises BusError if the bus cannot be set up."""
        return run_through(self.life())

    def life(self) -> Generator[None, None, s.Ended]:
        """`run` as a generator that yields after each iteration, for simulations."""
        with self.admission.session(self.inbox.put) as (session, endpoint):
            declared = self._declare(session)
            self.watchers.listening(endpoint)
            # Opening the session takes time that must not count as a slow frame.
            self.status.at = self.system.monotonic()
            while self.runner.ended is None:
                self._turn()
                yield
            self.inbox.close()
            for declaration in declared:
                declaration.undeclare()
        ended = self.result
        assert ended is not None
        return ended

    def handle(self, item: Any) -> None:
        """Handle a stimulus, or another item of the inbox; from the main thread only."""
        self._handlers.get(item.__class__, self.runner.handle)(item)

    def put_question(self, asked: LocalQuestion) -> None:
        """Let the main thread answer a question; from any thread."""
        self.inbox.put(asked)

    def _declare(self, session: zenoh.Session) -> list[Any]:
        handler, keys, epoch = self.inbox.handler, self.keys, self.transport.epoch
        liveliness = session.liveliness()
        admit = self._answers.admit
        return [
            *self.transport.open(session),
            *self.watchers.opened(session),
            *self.inbox.open(session, keys.sent_by("*"), keys.sent_by(COORDINATOR)),
            session.declare_queryable(f"{keys.control}/**", handler(admit)),
            session.declare_queryable(f"{keys.base}/ask/*", handler(admit)),
            # Members join as soon as this token appears, so all subscriptions
            # exist by now.
            liveliness.declare_token(keys.alive(COORDINATOR)),
            liveliness.declare_token(keys.epoch(epoch)),
            # With history, because members and other coordinators may have declared theirs before.
            liveliness.declare_subscriber(
                keys.epoch("*"), handler(partial(successor, own=epoch)), history=True
            ),
            liveliness.declare_subscriber(
                keys.alive("*"), Callback(self._receiver.tokens.note), history=True
            ),
        ]

    # --- one iteration of the loop ---

    def _turn(self) -> None:
        # Here and below without calls, because this runs twice for each message of a member.
        if any(self._waiting):
            self._answers.answer_due()
        if self.schedule.due is None:
            self._wait()
        due = self.schedule.due  # The message may have ended a frame.
        if due is None:
            return
        until = self.schedule.rest_until() if self.schedule.rests else 0.0
        if self.system.monotonic() < until:
            # A world at rest skips frames; it still checks the clock if a view may be due.
            self._drain(until) if self.schedule.shows_by_clock else self._wait()
            return
        self._drain(due)
        due = self.schedule.due  # A message may have paused the world.
        if due is not None and self.system.monotonic() >= due:
            self.runner.handle(self.schedule.begin())

    def _wait(self) -> None:
        """Block for the next item of the inbox and handle it."""
        if self.transport.has_output:
            self._use_idle_time()
        # A blocking receive is the fastest, but with other work it could last too long.
        waits = any(self._waiting) or self._postponed
        item = self._next_before_work() if waits else self.inbox.wait()
        # As in `handle`, without the call: this line runs for each message of a member.
        self._handlers.get(item.__class__, self.runner.handle)(item)

    def _next_before_work(self) -> Any:
        """The next item, or None after a postponed message or when a question is to be answered."""
        while True:
            item = self.inbox.ready()
            if item is None and self._postponed:
                self._receiver.postponed.process_next()
                return None
            wait = self._answers.wait
            if item is not None or wait <= 0:
                return item
            self.system.sleep(min(wait, POLL_SECONDS_ASKED))

    def _drain(self, until: float) -> None:
        """Handle what is in the inbox, MAX_MESSAGES_AT_ONCE at most, and sleep once before `until`.

        Messages that arrive during the sleep are handled in the next iteration.
        """
        # Bounded: a flood of messages must not delay the frame that is due.
        for _ in range(MAX_MESSAGES_AT_ONCE):
            item = self.inbox.ready()
            if item is not None:
                self.handle(item)
            elif self._postponed:
                self._receiver.postponed.process_next()
                if self.system.monotonic() >= until:
                    break
            else:
                break
        wait = until - self.system.monotonic()
        if wait > 0:
            if self.transport.has_output:
                self._use_idle_time()
            poll = POLL_SECONDS_ASKED if any(self._waiting) else POLL_SECONDS
            self.system.sleep(min(wait, poll))

    def _use_idle_time(self) -> None:
        """Process the record's backlog while members compute, once after each output."""
        self.transport.has_output = False
        self.watchers.idle()

    def _tick(self, _: TimerTick) -> None:
        self._receiver.tick()
        self._monitor.tick(self.system.monotonic())

    def _compare_epochs(self, other: Successor) -> None:
        """Raises Followed if another coordinator of this world has a later epoch."""
        raise Followed(
            f"another coordinator runs the world {self.keys.world!r} now, of epoch {other.epoch};"
            f" this one, of epoch {self.transport.epoch}, stops in frame {self.algorithm.frame}"
        )

    # --- what operators may ask for ---

    def restart(self, member: str) -> str:
        """Request a restart of a member; returns the reason if that is impossible, or ""."""
        return self.watchers.restart(member)

    def stack(self, member: str) -> str:
        """Request that a member's stacks are written to its log; returns as `restart`."""
        return self.watchers.stack(member)

    def rejected(self) -> Mapping[str, int]:
        """The number of rejections by sender."""
        return self.admission.rules.counts()

    def outlook(self, member: str) -> str:
        """What the world does with an awaited member, and when."""
        return self._monitor.outlook(member)

    def files(self) -> tuple[FileStatus, ...]:
        """The files that the launcher writes in this process."""
        return self.watchers.files()

    # --- observations of the run ---

    def _note_sent(self, to: str, message: m.ToMember) -> None:
        # A refusal counts as a rejection, like one of a certificate.
        if isinstance(message, m.Refused):
            self.admission.rules.count(to)
        elif isinstance(message, m.Greet):
            self._monitor.greeted(to)

    def noted(self, operation: PersonOperation) -> None:
        """Keep an operation of a person."""
        super().noted(operation)
        self.watchers.noted(operation)

    def frame_done(self, notice: s.FrameDone) -> None:
        """Pass a frame to the launcher, and to observers of the world."""
        self.transport.has_output = True
        self.watchers.frame_done(notice)
        # The record contains the digest of the whole string, which is computed only if it is read.
        if self.transport.observed:
            self.transport.publish(notice.record)

    def stopping(self, notice: s.Stopping) -> None:
        """Inform the launcher that no frame follows, and observers of the last events."""
        self.watchers.stopping(notice)
        if self.transport.observed and notice.events:
            digest = self.algorithm.scene.digest
            self.transport.publish(m.FrameRecord(notice.frame, notice.events, {}, digest))
