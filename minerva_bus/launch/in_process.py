"""Runs a world in this process, without a bus: `minerva run --in-process`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any, Final
from weakref import WeakSet

from minerva_bus.errors import WorldStopped
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.collection import ORDERS
from minerva_bus.frame.member import Member, Unready
from minerva_bus.frame.norms import NORMS
from minerva_bus.frame.phases import Phase
from minerva_bus.launch.collecting import CollectSink, collect_sink
from minerva_bus.launch.compiling import compile_agents
from minerva_bus.launch.console import Console
from minerva_bus.launch.exporting import exported
from minerva_bus.launch.failures import CodeFailure
from minerva_bus.launch.free_running import FreeRunning, close_services
from minerva_bus.launch.in_process_parts import WorldParts, members_of, recorded
from minerva_bus.launch.in_process_progress import InProcessProgress
from minerva_bus.launch.in_process_questions import InProcessQuestions
from minerva_bus.launch.interrupts import interrupts_deferred
from minerva_bus.launch.printed import MEMBERS, printed
from minerva_bus.launch.recording import RunRecord, recording
from minerva_bus.launch.slow_frames import slow_frames_reported
from minerva_bus.launch.summary import RunSummary
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.asking import AskingOperator
from minerva_bus.runtime.direct import InProcessRunner, timed
from minerva_bus.runtime.metrics import Metrics
from minerva_bus.runtime.operated import Operated
from minerva_bus.runtime.runner import Notice, Sink
from minerva_bus.runtime.schedule import FrameSchedule
from minerva_bus.runtime.system import REAL
from minerva_bus.runtime.world_log import WorldLog
from minerva_bus.source import SourceLine
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wording import duration
from minerva_bus.world.operator import PersonOperation

POLL_SECONDS: Final = 0.01
"""Longest sleep between two turns, while no frame is due."""


def never() -> bool:
    """Let a run or a step continue to its end."""
    return False


class InProcessRun:
    """One world without a bus: the same frames, the same digests.

    `run` runs it to its end. Its parts are for stepping: `open`, any number of `advance`, and
    `close`, also after an error; all in one thread. `sinks` observe the run, beside its record,
    console and log.
    """

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        *sinks: Sink | Callable[[Notice], None],
    ) -> None:
        self.algorithm = FrameAlgorithm(file.world)
        limits = file.access.limits
        self.algorithm.inbox.work.allow(limits.single_events, limits.host_events)
        self.collected: CollectSink | None = None
        self._file = file
        self._console = console
        self._sinks = sinks
        self._schedule = FrameSchedule(self.algorithm, file.rate, time.monotonic, self._warn)
        self._progress = InProcessProgress(file, console, began, self.algorithm, self._schedule)
        self._questions = InProcessQuestions(file.world.name)
        self._record = RunRecord()
        self._metrics = Metrics(self.algorithm, time.monotonic)
        self._log = WorldLog(self.algorithm, self._show, REAL, self._metrics)
        self._parts: WorldParts | None = None
        self._threads = WeakSet[threading.Thread]()
        self._reason = ""

    @property
    def ended(self) -> bool:
        """Whether the world is over."""
        return bool(self._reason) or (
            self._parts is not None and self._parts.runner.ended is not None
        )

    @property
    def failed(self) -> bool:
        """Whether an error has ended the world, without an exception."""
        return self.algorithm.failed

    def run(self) -> RunSummary:
        """Run the world to its end. Raises WorldStopped if user code fails."""
        with (
            printed(self._print, self._threads),
            slow_frames_reported(lambda: self.algorithm.frame, self._warn_of_slow_code, __file__),
        ):
            try:
                self.open()
                self.advance()
            except KeyboardInterrupt:
                self.end("interrupted")
            finally:
                self.close()
        return self.summary()

    def open(self) -> None:
        """Let all members join. Raises MinervaError if one cannot, or if user code fails."""
        with self._questions.deferred(), printed(self._print, self._threads):
            compile_agents(self._file.processes, self._console.progress)
            members = members_of(self._file)
            runner, record = self._prepare(members)
            self._parts = WorldParts(runner, members, record, FreeRunning(runner, members))
            with self._reporting():
                for note in self._file.notes:
                    self._note(note)
                runner.start()
                self._parts.services.start()

    def advance(self, frames: int | None = None, interrupted: Callable[[], bool] = never) -> None:
        """Run this number of frames, or to the end of the world, at the rate of the world file.

        Returns early if `interrupted` is true between two frames. Raises WorldStopped if user code
        fails, and KeyboardInterrupt, between two frames if they are short.
        """
        end = None if frames is None else self.algorithm.frame + frames
        with self._questions.deferred(), printed(self._print, self._threads), self._reporting():
            world, listen = self._file.world.name, self._file.watch.metrics
            with exported(world, listen, self.ask, self._note), interrupts_deferred() as pending:
                self._loop(end, lambda: interrupted() or pending())
                # Those that arrived during the last frame.
                self._questions.answer()

    def ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        """Answer a question of an operator, from any thread. Raises BusError."""
        return self._questions.ask(question, **details)

    def end(self, reason: str) -> None:
        """End the world."""
        self._reason = reason
        if self._parts is not None:
            self._parts.runner.handle(s.End(reason))

    def close(self) -> None:
        """Close record, tables, console and services."""
        parts, self._console.frame = self._parts, self.algorithm.frame
        if parts is None or parts.closed:
            return
        # Set first: `close` is called again after an error, possibly one of its own.
        parts.closed = True
        with printed(self._print, self._threads):
            parts.services.stop()
            parts.record.close()
            if self.collected is not None:
                self.collected.close()
            self._console.end()
            # Last, because a service's method `close` is user code and may raise.
            close_services(parts.members, self._console.log)

    def summary(self) -> RunSummary:
        """The summary of the run, also of one that has failed."""
        ended = None if self._parts is None else self._parts.runner.ended
        return self._progress.summary(ended, self._reason)

    def _prepare(self, members: list[Member]) -> tuple[InProcessRunner, RunRecord]:
        record = recording(
            self._file, self.algorithm, lambda text: self._console.log("record", text)
        )
        self._record = record
        self.collected = collect_sink(
            self._file.collect, self.algorithm, lambda text: self._console.log("collect", text)
        )
        status = self._progress.status
        collected = () if self.collected is None else (self.collected,)
        # Sinks are called in this order; `_progress` needs the time of the frame from `_schedule`.
        runner = InProcessRunner(
            self.algorithm,
            members,
            recorded(record),
            *collected,
            self._metrics,
            self._schedule,
            self._log,
            self._progress,
            *self._sinks,
            on_readings=record.sensed if record.topics else None,
            deliver=timed(self._schedule.overruns, time.monotonic),
        )
        self._questions.world = Operated(
            runner,
            self._schedule,
            self._log.event_log,
            self._log.orders,
            self._metrics,
            status,
            _no_rejections,
            _no_restart,
            _no_stack,
            None if self.collected is None else self.collected.history,
            files=lambda: record.files,
            noted=self._note_operation,
        )
        for member in members:
            # A window in this process sends the same questions as one that is connected by the bus.
            member.operator = AskingOperator(self._questions.ask, member.name)
        return runner, record

    def _loop(self, end: int | None, interrupted: Callable[[], bool]) -> None:
        assert self._parts is not None
        runner, services = self._parts.runner, self._parts.services
        while runner.ended is None and (end is None or self.algorithm.frame < end):
            if interrupted():
                return
            # Other threads only fill queues. They are emptied here, between two frames.
            self._questions.answer()
            services.deliver()
            services.pulse()
            now, due = time.monotonic(), self._due(end)
            if due is not None and due <= now:
                runner.handle(self._schedule.begin())
            elif runner.ended is None:
                time.sleep(POLL_SECONDS if due is None else min(due - now, POLL_SECONDS))

    def _due(self, end: int | None) -> float | None:
        # A caller that steps requires each frame now, even if the world is at rest.
        return self._schedule.next_at if end is None else self._schedule.due

    @contextmanager
    def _reporting(self) -> Generator[None]:
        """Turn errors in a member's code into WorldStopped."""
        assert self._parts is not None
        try:
            yield
        except Unready as error:
            # Not a failure of code: the service cannot run in this world, as its message explains.
            self._reason = str(error)
            raise WorldStopped(str(error)) from None
        except Exception as error:
            raise self._failed(error, self._parts.runner, self._parts.record) from error

    def _failed(self, error: Exception, runner: InProcessRunner, record: RunRecord) -> WorldStopped:
        """Show an error in a member's code; returns the exception that stops the world."""
        running = runner.direct.running
        member = MEMBERS if running is None else running.name
        frame = max(self.algorithm.frame if running is None else running.frame, 0)
        self._console.frame = frame
        failure = CodeFailure.of(error, member, frame)
        record.said(member, f"failed in frame {frame}: {failure.problem}\n{failure.details}")
        self._reason = failure.reason
        return failure.stops(self._console)

    def _warn_of_slow_code(self, waited: float, place: SourceLine) -> None:
        # Between two frames, windows and commands are served; before the first call of a member,
        # code is imported and compiled.
        member = None if self._parts is None else self._parts.runner.direct.running
        if member is not None and self.algorithm.phase is not Phase.READY:
            text = f"frame {self.algorithm.frame} has been waiting for it for {duration(waited)}"
            text += "; only an interrupt (Ctrl-C) ends it; it executes"
            self._console.log(member.name, "\n".join([text, *place.lines()]))

    def _print(self, text: str) -> None:
        self._console.frame = self.algorithm.frame
        self._console.log(MEMBERS, text)

    def _note(self, text: str) -> None:
        self._console.note(f"{self._file.world.name}: {text}")

    def _note_operation(self, operation: PersonOperation) -> None:
        self._log.operated(operation)
        self._record.noted(operation)

    def _warn(self, text: str) -> None:
        self._log.warn(COORDINATOR, text)

    def _show(self, member: str, text: str, details: str) -> None:
        self._console.frame = self.algorithm.frame
        # A program that steps a world sends events in each frame, and knows that they count; in a
        # world of learners, each episode breaks norms.
        if member not in (ORDERS, NORMS) or not self._console.quiet:
            self._console.log(member, text, "warning")
        self._record.said(member, f"{text}\n{details}".rstrip())


def _no_rejections() -> Mapping[str, int]:
    return {}  # There is no sender outside of this process.


def _no_restart(_: str) -> str:
    return "all members run in one process: a single one cannot be restarted"


def _no_stack(_: str) -> str:
    return "all members run in one process: none has a stack of its own"
