"""The coordinator of a world on Zenoh: one loop around a runner, its inbox and its clock."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from concurrent.futures import TimeoutError as NoAnswer
from dataclasses import replace
from functools import partial
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from minerva_bus.errors import BusError, Followed
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import WorldSpec
from minerva_bus.runtime.admission import Admission, ListenConfig
from minerva_bus.runtime.answers import Answers
from minerva_bus.runtime.control import COMMANDS
from minerva_bus.runtime.inbox import HubInbox, Question, TimerTick
from minerva_bus.runtime.large import Decoded
from minerva_bus.runtime.links import Linked
from minerva_bus.runtime.metrics import Metrics
from minerva_bus.runtime.monitor import STATUS_EVERY, Monitor
from minerva_bus.runtime.operated import Command, Operated
from minerva_bus.runtime.presence import Successor, TokensChanged, successor
from minerva_bus.runtime.receiver import Receiver
from minerva_bus.runtime.runner import Notice, Runner, Sink
from minerva_bus.runtime.schedule import FrameSchedule
from minerva_bus.runtime.status import StatusMeter
from minerva_bus.runtime.system import REAL, System, run_through
from minerva_bus.runtime.transport import ZenohTransport
from minerva_bus.runtime.waiting import Deadlines, Waits
from minerva_bus.runtime.watchers import LocalQuestion, Printed, Started, Watchers
from minerva_bus.runtime.world_log import WorldLog
from minerva_bus.wire.keys import COORDINATOR, Keys
from minerva_bus.wire.message_limits import DEFAULT, Limits
from minerva_bus.world.operator import PersonOperation

POLL_SECONDS: Final = 0.01
"""Longest sleep in seconds before the next frame is due."""

POLL_SECONDS_ASKED: Final = 0.001
"""Longest sleep in seconds while an operator's question waits."""

MAX_MESSAGES_AT_ONCE: Final = 500
"""Most messages handled before a due frame begins: a flood delays the frame only this much."""

ANSWER_SECONDS: Final = 2.0
"""Seconds that another thread of this process waits for an answer."""


class Coordinator(Sink):
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
        algorithm = FrameAlgorithm(world) if algorithm is None else algorithm
        algorithm.inbox.work.allow(limits.single_events, limits.host_events)
        keys, clock = Keys(world.name), system.monotonic
        self.system, self.watchers = system, watchers
        self.inbox = HubInbox(STATUS_EVERY, system)
        self.metrics = Metrics(algorithm, clock, keep)
        self.log = log = WorldLog(algorithm, watchers.said, system, self.metrics)
        self.admission = Admission(keys, limits, where or ListenConfig(), log.warn, system)
        self.schedule = FrameSchedule(algorithm, rate, clock, partial(log.warn, COORDINATOR))
        self.transport = ZenohTransport(keys, epoch, self.metrics, clock, self._note_sent)
        self.status = StatusMeter(algorithm, self.schedule.pace, clock())
        own = (self.schedule, self.metrics, log, self.status, self)
        self.runner = Runner(algorithm, self.transport, [*own, *sinks])
        self._monitor = Monitor(self, Waits(deadlines or Deadlines(), queued))
        receiver = Receiver(self, limits, self._monitor.arrived)
        self._receiver, self._postponed = receiver, receiver.postponed
        self._answers = Answers(
            self._operated(), self.admission, limits, watchers.operated, system, commands
        )
        self._handlers = self._handlers_with(receiver)

    def _operated(self) -> Operated:
        """What operators may ask for."""
        watchers = self.watchers
        return Operated(
            self.runner,
            self.schedule,
            self.log.event_log,
            self.log.orders,
            self.metrics,
            self.status,
            self.admission.rules.counts,
            watchers.restart,
            watchers.stack,
            watchers.collected,
            self._monitor.outlook,
            watchers.files,
            self._note_operation,
        )

    def _handlers_with(self, receiver: Receiver) -> dict[type, Callable[[Any], None]]:
        """Handlers by type of what arrives in the inbox."""
        return {
            tuple: receiver.receive,
            Decoded: receiver.take_decoded,
            TokensChanged: receiver.take_token,
            s.End: self._monitor.end,
            TimerTick: self._tick,
            Printed: lambda line: self.log.line(line.member, line.line, line.level),
            Started: lambda started: self._monitor.started(started.member),
            Question: self._answers.add,
            LocalQuestion: self._answers.answer_local,
            Successor: self._compare_epochs,
            Linked: self.admission.notice,
            type(None): lambda _: None,
        }

    @property
    def algorithm(self) -> FrameAlgorithm:
        """The frame algorithm."""
        return self.runner.algorithm

    @property
    def keys(self) -> Keys:
        """The keys of the world."""
        return Keys(self.algorithm.world.name)

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
        ended = self.runner.ended
        # Overruns are measured by the clock, which the algorithm does not have.
        return replace(ended, figures={**ended.figures, **self.schedule.overruns.figures()})

    def handle(self, item: Any) -> None:
        """Handle a stimulus, or another item of the inbox; from the main thread only."""
        self._handlers.get(item.__class__, self.runner.handle)(item)

    def ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """Answer a question from another thread. Raises BusError, as a client does."""
        asked = LocalQuestion({"ask": question, **details})
        self.inbox.put(asked)
        try:
            reply = asked.answer.result(ANSWER_SECONDS)
        except NoAnswer:
            raise BusError(f"no answer within {ANSWER_SECONDS:g} s") from None
        if "error" in reply:
            raise BusError(str(reply["error"]))
        return reply

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
        if self._answers:
            self._answers.answer_due()
        due = self.schedule.due
        if due is None:
            self._wait()
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
        waits = self._answers or self._postponed
        item = self._next_before_work() if waits else self.inbox.wait()
        # As in `handle`, without the call: this line runs for each message of a member.
        self._handlers.get(item.__class__, self.runner.handle)(item)

    def _next_before_work(self) -> Any:
        """The next item, or None after a postponed message or when a question is to be answered."""
        while True:
            item = self.inbox.ready()
            if item is None and self._postponed:
                self._postponed.process_next()
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
                self._postponed.process_next()
                if self.system.monotonic() >= until:
                    break
            else:
                break
        wait = until - self.system.monotonic()
        if wait > 0:
            if self.transport.has_output:
                self._use_idle_time()
            poll = POLL_SECONDS_ASKED if self._answers else POLL_SECONDS
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

    # --- observations of the run ---

    def _note_sent(self, to: str, message: m.ToMember) -> None:
        # A refusal counts as a rejection, like one of a certificate.
        if isinstance(message, m.Refused):
            self.admission.rules.count(to)
        elif isinstance(message, m.Greet):
            self._monitor.greeted(to)

    def _note_operation(self, operation: PersonOperation) -> None:
        self.log.operated(operation)
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
