"""Runs a world in this process, without a bus: `minerva run --in-process`.

Frames run in one thread. Other threads only fill queues: questions of operators, and the output of
free-running generators. One of them looks at the frame: on the bus the coordinator notices a member
that does not answer, here the thread of the frames is the one that is blocked.
"""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import takewhile
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.errors import MinervaError, UserCodeError, WorldStopped
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection_step import ORDERS
from minerva_bus.frame.member_side import Member, Unready
from minerva_bus.frame.norm_rejections import NORMS
from minerva_bus.frame.world_state import Phase
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.launch.child_processes import interrupts_deferred
from minerva_bus.launch.console import (
    MEMBERS,
    AllThreads,
    Console,
    EndReport,
    RunSummary,
    Startup,
    live_line,
    printed,
)
from minerva_bus.launch.process_specs import compile_agents
from minerva_bus.launch.run_outputs import (
    CollectSink,
    RunRecord,
    collect_sink,
    complete_tables,
    monitored,
    recording,
)
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.operator_client import AskingOperator
from minerva_bus.runtime.participants import Outlet, Published
from minerva_bus.runtime.questions import LocalQuestion, WorldRun, answer
from minerva_bus.runtime.runner import InProcessRunner, Notice, Sink, timed
from minerva_bus.runtime.session import REAL
from minerva_bus.uncaught import VARIABLE
from minerva_bus.user_code import (
    SourceLine,
    blamed,
    function_name,
    handler_name,
    innermost,
    report,
    whole,
)
from minerva_bus.wording import duration
from minerva_bus.world.operator import FileStatus, PersonOperation
from minerva_bus.world.services import Generator as EventGenerator

if TYPE_CHECKING:
    from minerva_bus.collect.data_tables import DataTable

POLL_SECONDS: Final = 0.01
"""Longest sleep between two turns, while no frame is due."""

STATUS_SECONDS: Final = 0.1
"""Time between two status lines."""

MAX_WAITING: Final = 256
"""Most events and readings of a free-running generator that may wait for the main thread."""

BLOCKED_POLL_SECONDS: Final = 0.2
"""Interval in seconds at which a blocked generator checks whether the world has ended."""

LOOK_SECONDS: Final = 10.0
"""Time between two looks at the frame; a frame that is the same in both is slow."""


def never() -> bool:
    """Let a run or a step continue to its end."""
    return False


class InProcessRun(WorldRun):
    """One world without a bus: the same frames, the same digests.

    `run` runs it to its end. Its parts are for stepping: `open`, any number of `advance`, and
    `close`, also after an error; all in one thread. `sinks` observe the run, beside its record,
    console and log. `alone`: the process runs nothing else, so all its threads are the run's.
    """

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        *sinks: Sink | Callable[[Notice], None],
        alone: bool = False,
    ) -> None:
        limits = file.access.limits
        super().__init__(file.world, None, file.rate, limits, self._show, REAL)
        self._collecting: CollectSink | None = None
        self._file = file
        self._console = console
        self._startup = Startup(began)
        self._sinks = sinks
        # Held by the thread that runs the world, which answers the questions of others.
        self._running = threading.RLock()
        self._asked: SimpleQueue[LocalQuestion] = SimpleQueue()
        self._record = RunRecord()
        self._parts: WorldParts | None = None
        # Those of generators, which print as members do.
        self._started: list[threading.Thread] = []
        self._threads = AllThreads() if alone else self._started
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
        with self._running, printed(self._print, self._threads):
            compile_agents(self._file.processes, self._console.progress)
            members = members_of(self._file)
            runner, record = self._prepare(members)
            services = FreeRunning(runner, members, self._started)
            self._parts = WorldParts(runner, members, record, services)
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
        with self._running, printed(self._print, self._threads), self._reporting():
            metrics = monitored(self._file, self.ask, self._note)
            with metrics, interrupts_deferred() as pending:
                self._loop(end, lambda: interrupted() or pending())
                # Those that arrived during the last frame.
                self._answer_waiting()

    def reply_to(self, question: Mapping[str, Any]) -> Mapping[str, Any]:
        """Answer a question between two frames; at once if no thread runs the world."""
        # The thread that runs the world must not wait for itself, as after a key in a window.
        if not self._running.acquire(blocking=False):
            return super().reply_to(question)
        try:
            return answer(question, self)
        finally:
            self._running.release()

    def put_question(self, asked: LocalQuestion) -> None:
        """Let the thread that runs the world answer between two frames."""
        self._asked.put(asked)

    def _answer_waiting(self) -> None:
        for _ in range(self._asked.qsize()):
            self.answer(self._asked.get())

    @property
    def tables(self) -> dict[str, DataTable]:
        """The tables of collected data, by name; empty if they go into a file."""
        return {} if self._collecting is None else self._collecting.tables

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
            if self._collecting is not None:
                self._collecting.close()
                # Of a disk that was full.
                complete_tables(self._file.collect.into, self._log_collect)
            self._console.end()
            # Last, because a service's method `close` is user code and may raise.
            close_services(parts.members, self._console.log)

    def summary(self) -> RunSummary:
        """The summary of the run, also of one that has failed."""
        report = EndReport.of(self, len(self._file.processes), self._reason)
        return replace(RunSummary.of(self._file.world, report, self._startup, ""), startup={})

    def frame_done(self, notice: s.FrameDone) -> None:
        """Show the frame rate every STATUS_SECONDS."""
        now = self.schedule.last_frame_at
        self._startup.completed(notice.frame, now)
        if now - self.status.at >= STATUS_SECONDS:
            rate, world = self.status.status(now, ()).rate, self._file.world
            frame = self.algorithm.frame
            status = {"frame": frame, "rate": rate, "members": 1, "waiting": (), "waited": 0.0}
            self._console.live(live_line(world.name, status, world.frames, self._startup.began))

    def _prepare(self, members: list[Member]) -> tuple[InProcessRunner, RunRecord]:
        record = recording(
            self._file, self.algorithm, lambda text: self._console.log("record", text)
        )
        self._record = record
        self._collecting = collect_sink(self._file.collect, self.algorithm, self._log_collect)
        collected = () if self._collecting is None else (self._collecting,)
        self.collected = None if self._collecting is None else self._collecting.history
        # Sinks are called in this order; this one needs the time of the frame from `_schedule`.
        runner = InProcessRunner(
            self.algorithm,
            members,
            record,
            *collected,
            self.metrics,
            self.schedule,
            self.log,
            self,
            *self._sinks,
            on_readings=record.sensed if record.topics else None,
            deliver=timed(self.schedule.overruns, time.monotonic),
        )
        for member in members:
            # A window in this process sends the same questions as one that is connected by the bus.
            member.operator = AskingOperator(self.ask, member.name)
        return runner, record

    def _loop(self, end: int | None, interrupted: Callable[[], bool]) -> None:
        assert self._parts is not None
        runner, services = self._parts.runner, self._parts.services
        while runner.ended is None and (end is None or self.algorithm.frame < end):
            if interrupted():
                return
            # Other threads only fill queues. They are emptied here, between two frames.
            self._answer_waiting()
            services.deliver()
            services.pulse()
            # A caller that steps requires each frame now, even if the world is at rest.
            due = self.schedule.next_at if end is None else self.schedule.due
            now = time.monotonic()
            if due is not None and due <= now:
                runner.handle(self.schedule.begin())
            elif runner.ended is None:
                time.sleep(POLL_SECONDS if due is None else min(due - now, POLL_SECONDS))

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
        running, console = runner.direct.running, self._console
        member = MEMBERS if running is None else running.name
        frame = max(self.algorithm.frame if running is None else running.frame, 0)
        shown, details = f"failed in frame {frame}: {report(error)}", whole(error)
        record.said(member, f"{shown}\n{details}")
        console.frame = frame
        console.log(member, shown, "error")
        console.details(member, details)
        # The summary has the same words as on the bus.
        self._reason = f"{member} {shown}".partition("\n")[0]
        return WorldStopped(
            f"{self._reason}; the world stops ({VARIABLE}=1 shows all frames)",
            f"{member} failed in frame {frame}; the world stops",
        )

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

    def _log_collect(self, text: str) -> None:
        self._console.log("collect", text)

    def _note(self, text: str) -> None:
        self._console.note(f"{self._file.world.name}: {text}")

    def files(self) -> tuple[FileStatus, ...]:
        """The record and the tables."""
        tables = () if self._collecting is None else self._collecting.files
        return (*self._record.files, *tables)

    def noted(self, operation: PersonOperation) -> None:
        """Keep an operation of a person."""
        super().noted(operation)
        self._record.noted(operation)

    def _show(self, member: str, text: str, details: str) -> None:
        self._console.frame = self.algorithm.frame
        # A program that steps a world sends events in each frame, and knows that they count; in a
        # world of learners, each episode breaks norms.
        if member not in (ORDERS, NORMS) or not self._console.quiet:
            self._console.log(member, text, "warning")
        self._record.said(member, f"{text}\n{details}".rstrip())


@dataclass(slots=True)
class WorldParts:
    """The parts of an open world."""

    runner: InProcessRunner
    members: list[Member]
    record: RunRecord
    services: FreeRunning
    closed: bool = False


def members_of(file: WorldFile) -> list[Member]:
    """The members of all processes. Raises MinervaError for one that needs its own process."""
    for process in file.processes:
        if process.command:
            raise MinervaError(f"{process.name} is a command of its own: run without --in-process")
        if process.elsewhere:
            raise MinervaError(f"{process.name} runs elsewhere: run without --in-process")
    return [process.make_member() for process in file.processes]


def close_services(members: Iterable[Member], log: Callable[[str, str], None]) -> None:
    """Close all services; logs by name of the member which of them fail.

    The world is over, so an error does not change its result: it is logged, as on the bus.
    """
    for member in members:
        try:
            member.close()
        except UserCodeError as error:
            log(member.name, report(error))


class WaitingOutput:
    """Output of a free-running generator that waits for the main thread."""

    def __init__(self, put: Callable[[Any], None], stop: threading.Event) -> None:
        self._put = put
        self._stop = stop
        self._room = threading.Semaphore(MAX_WAITING)

    def add(self, output: AnyEvent | Published) -> None:
        """Queue an event or a reading, from the generator's thread."""
        # A generator that is faster than the frames blocks here; otherwise memory would fill up.
        while not self._room.acquire(timeout=BLOCKED_POLL_SECONDS):
            # Otherwise a generator's thread would block forever after the end.
            if self._stop.is_set():
                return
        self._put(output)

    def taken(self) -> None:
        """The main thread has processed one item."""
        self._room.release()


class FreeRunning:
    """Runs each free-running generator in a thread, and passes its output to the main thread.

    Frames run in the main thread only, so output waits in a queue until `deliver` is called.
    """

    def __init__(
        self, runner: InProcessRunner, members: Iterable[Member], threads: list[threading.Thread]
    ) -> None:
        """`threads` receives the threads."""
        self._runner = runner
        self._members = tuple(members)
        self._threads = threads
        self._queue: SimpleQueue[tuple[Member, Any]] = SimpleQueue()
        self._waiting: dict[str, WaitingOutput] = {}
        self._pulsed: dict[str, float] = {}
        self._stop = threading.Event()

    def start(self) -> None:
        """Start the threads."""
        for member in self._members:
            if isinstance(member.service, EventGenerator) and not member.when.is_awaited:
                arguments = member, member.service
                thread = threading.Thread(target=self._generate, args=arguments, daemon=True)
                self._threads.append(thread)
                thread.start()

    def stop(self) -> None:
        """Request the end of all generators, without a join: their threads are daemons."""
        self._stop.set()

    def deliver(self) -> None:
        """Pass queued events and readings to the runner. Raises exceptions of generators."""
        for _ in range(self._queue.qsize()):  # Later output waits for the next turn.
            member, output = self._queue.get()
            # The report of an error names this member.
            self._runner.direct.running = member
            if isinstance(output, Exception):
                raise output
            if isinstance(output, Published):
                self._runner.publish(member.published(output.topic, output.reading))
            else:
                self._runner.handle(member.emitted(output))
            self._waiting[member.name].taken()

    def pulse(self) -> None:
        """Call `pulse` of the services that are due; a service that leaves ends the world."""
        now = time.monotonic()
        for member in self._members:
            service = member.service
            if service is None or not service.pulse_every:
                continue
            if now < self._pulsed.get(member.name, 0.0) + service.pulse_every:
                continue
            self._pulsed[member.name] = now
            if _call(service.pulse, service.leaves):
                self._runner.handle(s.End(f"{member.name} was closed"))

    def _generate(self, member: Member, service: EventGenerator) -> None:
        try:
            waiting = WaitingOutput(lambda output: self._queue.put((member, output)), self._stop)
            self._waiting[member.name] = waiting
            # The main thread raises an error in `deliver`; in this thread it would be lost.
            service.run(Outlet(waiting.add), self._stop)
        except BaseException as error:
            failure = UserCodeError(handler_name(service.run), service.run)
            failure.__cause__ = error
            self._queue.put((member, failure))


def _call(pulse: Callable[[], object], leaves: Callable[[], bool]) -> bool:
    with blamed(pulse):
        pulse()
    with blamed(leaves):
        return leaves()


@contextmanager
def slow_frames_reported(
    frame: Callable[[], int],
    report: Callable[[float, SourceLine], None],
    began_in: str,
    seconds: float = LOOK_SECONDS,
) -> Generator[None]:
    """Report frames of this thread that take long; each after one look, two, four, ...

    Args:
        frame: the number of the current frame.
        report: called in another thread with the seconds for which the frame has been seen, and
            the line that it executes.
        began_in: the source file that runs the frames; older code belongs to the caller.
        seconds: time between two looks.

    """
    ended, watched = threading.Event(), threading.get_ident()

    def look() -> None:
        seen, since, looks = frame(), time.monotonic(), 0
        while not ended.wait(seconds):
            if frame() != seen:
                seen, since, looks = frame(), time.monotonic(), 0
                continue
            looks += 1
            place = _executed(watched, began_in)
            if place is not None and looks & (looks - 1) == 0:
                report(time.monotonic() - since, place)

    thread = threading.Thread(target=look, name="slow frames", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _executed(thread: int, began_in: str) -> SourceLine | None:
    """The line of user code that a thread executes, if it executes any."""
    top = sys._current_frames().get(thread)  # pyright: ignore[reportPrivateUsage]
    if top is None:
        return None
    # A frame has no line while an instruction is executed that belongs to none.
    places = (
        SourceLine(
            frame.f_code.co_filename,
            line or frame.f_code.co_firstlineno,
            function_name(frame.f_code),
        )
        for frame, line in traceback.walk_stack(top)
    )
    return innermost(list(takewhile(lambda place: place.file != began_in, places)))
