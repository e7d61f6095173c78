"""The coordinator of a world on Zenoh: one loop around a runner, its inbox and its clock."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from concurrent.futures import TimeoutError as NoAnswer
from dataclasses import replace
from typing import Any, Final, cast

import zenoh

from minerva_bus.errors import BusError, Followed
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.runtime.admission import Admission, ListenConfig, Security
from minerva_bus.runtime.answers import Answers
from minerva_bus.runtime.audit import Denials
from minerva_bus.runtime.control import COMMANDS, Command, Operated
from minerva_bus.runtime.greetings import Greetings
from minerva_bus.runtime.inbox import HubInbox, Question, Tick
from minerva_bus.runtime.large import Opened
from minerva_bus.runtime.links import Linked
from minerva_bus.runtime.metrics import Metrics
from minerva_bus.runtime.monitor import STATUS_EVERY, Monitor
from minerva_bus.runtime.presence import Successor, presence, successor
from minerva_bus.runtime.receiver import Receiver
from minerva_bus.runtime.rejected_connections import RejectedConnection
from minerva_bus.runtime.runner import Notice, Runner, Sink
from minerva_bus.runtime.schedule import FrameSchedule
from minerva_bus.runtime.session import LOOPBACK
from minerva_bus.runtime.status import StatusMeter
from minerva_bus.runtime.system import REAL, System, run_through
from minerva_bus.runtime.transport import ZenohTransport
from minerva_bus.runtime.waiting import Deadlines, Waits
from minerva_bus.runtime.watchers import Asked, Printed, Started, Watchers
from minerva_bus.runtime.world_log import WorldLog
from minerva_bus.wire.keys import COORDINATOR, Keys
from minerva_bus.wire.limits import DEFAULT, Limits

POLL_SECONDS: Final = 0.01
"""Longest sleep before a frame that is due."""

POLL_SECONDS_ASKED: Final = 0.001
"""The same while an operator's question waits."""

MAX_MESSAGES_AT_ONCE: Final = 500
"""Messages taken before a frame that is due begins, so that a flood does not delay it for ever."""

ANSWER_SECONDS: Final = 2.0
"""How long another thread of this process waits for an answer."""


class Coordinator:
    """Runs a world's frame algorithm over Zenoh.

    `runner` executes it, `receiver` lets messages in, `monitor` applies time-outs, `schedule` times
    the frames. `sinks` observe the run after those of the coordinator itself.

    Args:
        watchers: Called in the main thread with what concerns the launcher.
        rate: Frames per second; 0: as many as possible.
        listen: Endpoint for members of this machine and, with `security`, of others.
        deadlines: Time-outs of members.
        shared: Whether large messages use shared memory.
        routers: Zenoh routers to join.
        epoch: Rises with each coordinator of a world; messages of a lower one are ignored.
        algorithm: Continues a run, or replays one; by default the world begins.
        queued: Members whose processes have yet to be started.
        keep: Whether to measure every frame for a profile.
        commands: What operators may ask.
        sinks: Further sinks of the runner.
        system: Clock, threads and sessions.

    """

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
        keep: bool = False,
        commands: Mapping[str, Command] = COMMANDS,
        sinks: Iterable[Sink | Callable[[Notice], None]] = (),
        system: System = REAL,
    ) -> None:
        algorithm = FrameAlgorithm(world) if algorithm is None else algorithm
        algorithm.inbox.max_single_events = limits.single_events
        keys, clock, greetings = Keys(world.name), system.monotonic, Greetings()

        def sent(to: str, message: m.ToMember) -> None:
            if isinstance(message, m.Refused):
                self.admission.rules.count(to)
            elif isinstance(message, m.Greet):
                greetings.sent(to, clock())

        self.inbox = HubInbox(STATUS_EVERY, system)
        self.metrics = Metrics(algorithm, clock, keep)
        self.log = WorldLog(algorithm, self.metrics, watchers.said, system)
        self.admission = Admission(keys, limits, security, self.log.warn, system)
        self.schedule = FrameSchedule(algorithm, rate, clock, self._warn)
        self.transport = ZenohTransport(keys, epoch, self.metrics, clock, sent)
        self.status = StatusMeter(algorithm, self.schedule.pace, clock())
        own = (self.schedule, self.metrics, self.log, self.status, self._observe)
        self.runner = Runner(algorithm, self.transport, [*own, *sinks])
        self._monitor = Monitor(
            self.runner,
            self.status,
            Waits(deadlines or Deadlines(), queued),
            self.admission,
            greetings,
            self.log,
            watchers,
            algorithm.members.expected() - world.expected,
            clock,
        )
        self._receiver = Receiver(
            self.runner,
            self.transport,
            self.admission,
            greetings,
            self.metrics,
            self.log,
            limits,
            system,
            put=self.inbox.put,
            arrived=self._monitor.arrived,
        )
        operated = Operated(
            self.runner,
            self.schedule,
            self.log.event_log,
            self.metrics,
            self.status,
            self.admission.rules.counts,
            watchers.restart,
        )
        self._answers = Answers(
            operated, keys, self.admission, limits, watchers.operated, system, commands
        )
        self._where = ListenConfig(listen, shared, routers)
        self._watch = watchers
        self._system = system
        self._frame_ended = False

    @property
    def algorithm(self) -> FrameAlgorithm:
        """The frame algorithm."""
        return self.runner.algorithm

    @property
    def keys(self) -> Keys:
        """The keys of the world."""
        return Keys(self.algorithm.world.name)

    def run(self) -> s.Ended:
        """Run the world to its end. Raises BusError where the bus cannot be set up."""
        return run_through(self.life())

    def life(self) -> Generator[None, None, s.Ended]:
        """The same, one turn of the loop at a time: a simulation decides when the next one runs."""
        with self.admission.session(self._where, self.inbox.put) as (session, endpoint):
            declared = self._declare(session)
            self._watch.listening(endpoint)
            self.status.at = self._system.monotonic()
            while self.runner.ended is None:
                self._turn()
                yield
            self.inbox.close()
            for declaration in declared:
                declaration.undeclare()
        ended = self.runner.ended
        return replace(ended, figures={**ended.figures, **self.schedule.overruns.figures()})

    def handle(self, stimulus: s.Stimulus) -> None:
        """Pass a stimulus to the algorithm; from the main thread only."""
        if isinstance(stimulus, s.End):
            self._monitor.end(stimulus)
        else:
            self.runner.handle(stimulus)

    def ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """The answer to a question of another thread. Raises BusError as a client does."""
        asked = Asked({"ask": question, **details})
        self.inbox.put(asked)
        try:
            reply = asked.later.result(ANSWER_SECONDS)
        except NoAnswer:
            raise BusError(f"it has not answered for {ANSWER_SECONDS:g} s") from None
        if "error" in reply:
            raise BusError(str(reply["error"]))
        return reply

    def _declare(self, session: zenoh.Session) -> list[Any]:
        handler, keys, epoch = self.inbox.handler, self.keys, self.transport.epoch
        liveliness = session.liveliness()
        asked = self._answers.admit
        return [
            *self.transport.open(session),
            *self._watch.opened(session),
            *self.inbox.open(session, keys.sent_by("*"), keys.sent_by(COORDINATOR)),
            session.declare_queryable(f"{keys.control}/**", handler(asked)),
            session.declare_queryable(f"{keys.base}/ask/*", handler(asked)),
            liveliness.declare_token(keys.alive(COORDINATOR)),
            liveliness.declare_token(keys.epoch(epoch)),
            liveliness.declare_subscriber(keys.epoch("*"), handler(successor), history=True),
            liveliness.declare_subscriber(keys.alive("*"), handler(presence), history=True),
        ]

    # --- one turn of the loop ---

    def _turn(self) -> None:
        self._answers.answer_due()
        due = self.schedule.due
        if due is None:
            self._wait()
            return
        until = self.schedule.rest_until() if self.schedule.rests else 0.0
        if self._system.monotonic() < until:
            # A world at rest skips frames; it still looks at the clock where a view may be due.
            self._drain(until) if self.schedule.shows_by_clock else self._wait()
            return
        self._drain(due)
        due = self.schedule.due  # A message may have paused the world.
        if due is not None and self._system.monotonic() >= due:
            self.runner.handle(self.schedule.begin())

    def _wait(self) -> None:
        """Block for the next item of the inbox."""
        self._use_idle_time()
        self._take(self._next())

    def _next(self) -> Any:
        """The next item, or None when it is time to answer a question."""
        while self._answers.waiting:
            item = self.inbox.ready()
            if item is not None or (wait := self._answers.waiting.wait) <= 0:
                return item
            self._system.sleep(min(wait, POLL_SECONDS_ASKED))
        return self.inbox.wait()

    def _drain(self, until: float) -> None:
        """Take what is in the inbox, MAX_MESSAGES_AT_ONCE at most, and sleep once before `until`.

        What arrives during the sleep is taken in the next turn.
        """
        for _ in range(MAX_MESSAGES_AT_ONCE):
            item = self.inbox.ready()
            if item is None:
                break
            self._take(item)
        wait = until - self._system.monotonic()
        if wait > 0:
            self._use_idle_time()
            poll = POLL_SECONDS_ASKED if self._answers.waiting else POLL_SECONDS
            self._system.sleep(min(wait, poll))

    def _use_idle_time(self) -> None:
        """Let the record work off its backlog while members compute, once after each output."""
        if self._frame_ended or self.transport.has_sent:
            self._frame_ended = self.transport.has_sent = False
            self._watch.idle()

    def _take(self, item: Any) -> None:
        if isinstance(item, tuple):
            self._receiver.receive(*cast("tuple[str, bytes]", item))
        elif isinstance(item, Tick):
            self.metrics.check()
            self._monitor.tick(self._system.monotonic())
        elif isinstance(item, Printed | Started):
            self._take_launcher(item)
        elif isinstance(item, Question | Asked):
            self._answers.take(item)
        elif isinstance(item, Successor):
            self._meet(item.epoch)
        elif isinstance(item, Linked | RejectedConnection | Denials):
            self.admission.notice(item)
        elif isinstance(item, s.Appeared):
            self._receiver.appear(item)
        elif isinstance(item, Opened):
            self._receiver.take_opened(item)
        elif item is not None:
            self.handle(item)

    def _take_launcher(self, item: Printed | Started) -> None:
        if isinstance(item, Printed):
            self.log.line(item.member, item.line, item.level)
        else:
            self._monitor.started(item.member)

    def _meet(self, epoch: int) -> None:
        """Compare epochs with another coordinator. Raises Followed where it is a later one."""
        own = self.transport.epoch
        if epoch > own:
            raise Followed(
                f"another coordinator runs the world {self.keys.world!r} now, of epoch {epoch};"
                f" this one, of epoch {own}, stops in frame {self.algorithm.frame}"
            )

    # --- sinks ---

    def _warn(self, text: str) -> None:
        self.log.warn(COORDINATOR, text)

    def _observe(self, notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            self._frame_ended = True
            self._watch.frame_done(notice)
            if self.transport.observed:
                self.transport.publish(notice.record)
        elif isinstance(notice, s.Stopping):
            self._watch.stopping(notice.reason)
