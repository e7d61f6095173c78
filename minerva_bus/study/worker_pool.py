"""A pool of worker processes: each task runs in a process forked from this one.

So a task cannot affect other tasks or this process by its memory, a crash or a time-out. Processes
that it started end with it.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Final, Protocol, Self

from minerva_bus.errors import MinervaError
from minerva_bus.launch.capacity import cores
from minerva_bus.launch.forking import ChildProcess, fork, how_ended, kill
from minerva_bus.launch.interrupts import caught
from minerva_bus.launch.pipes import LineReader, Pipes, ReportPipe, parse_report
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.settings.overrides import Overrides

MAX_LINES: Final = 9
"""Lines of an error; a further one names the run."""

MAX_OUTPUT: Final = 2000
"""Length of the last line of a task's output that an error quotes."""


def never() -> bool:
    """Run a task to its end."""
    return False


class Task(Protocol):
    """One run of a world, read by `read`; returns plain data.

    It ends early if `interrupted` is true between two frames.
    """

    @property
    def read(self) -> Callable[[Overrides], WorldFile]:
        """Reads the world."""
        ...

    def __call__(self, interrupted: Callable[[], bool] = never) -> Mapping[str, Any]: ...


class TaskPool(Protocol):
    """Runs tasks in parallel."""

    def run(self, tasks: Sequence[Task], on_result: OnResult) -> None:
        """Run all tasks; report each result as it arrives. Raises KeyboardInterrupt."""
        ...


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a task, or why it failed; `seconds` of wall time."""

    values: Mapping[str, Any]
    error: str
    seconds: float


OnResult = Callable[[int, Result], None]
"""Receives the number of a task and its result."""


@dataclass(slots=True)
class _Job:
    """A running task."""

    number: int
    child: ChildProcess
    began: float
    readers: list[LineReader] = field(default_factory=list[LineReader])
    report: dict[str, Any] | None = None
    last_line: str = ""
    late: bool = False

    def on_report(self, line: str) -> None:
        self.report = parse_report(line) or self.report

    def on_output(self, line: str) -> None:
        if line.strip():
            self.last_line = line.strip()[-MAX_OUTPUT:]


class WorkerPool:
    """Workers for tasks, in the main thread; leaving its context ends running tasks.

    `workers`: number of processes; 0: one per core. `limit`: seconds that a task may take; 0: no
    limit. Within the context, signals that end a process make `run` raise KeyboardInterrupt.
    """

    def __init__(self, workers: int, limit: float = 0.0) -> None:
        self._workers = workers or cores()
        self._limit = limit
        self._lifeline = os.pipe()
        self._pipes = Pipes()
        self._jobs: list[_Job] = []
        self._folder = ""
        self._interrupted = False
        self._context = ExitStack()

    def __enter__(self) -> Self:
        self._folder = self._context.enter_context(
            tempfile.TemporaryDirectory(prefix="minerva-study-", ignore_cleanup_errors=True)
        )
        self._context.enter_context(caught(self._pipes, self._on_interrupt))
        return self

    def _on_interrupt(self, number: signal.Signals) -> None:
        # Python's own handler may raise KeyboardInterrupt during a fork, where it would be lost.
        self._interrupted = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        for job in self._jobs:
            kill(job.child.pid)
        for job in self._jobs:
            os.waitpid(job.child.pid, 0)
        self._jobs.clear()
        # Before the pipes, one of which belongs to the signals that this releases.
        self._context.close()
        self._pipes.close()
        for descriptor in self._lifeline:
            os.close(descriptor)

    def run(self, tasks: Sequence[Task], on_result: OnResult) -> None:
        """Run all tasks; report each result as it arrives. Raises KeyboardInterrupt."""
        # Reversed, because `pop` takes the last one.
        waiting = list(enumerate(tasks))[::-1]
        while waiting or self._jobs:
            if self._interrupted:
                raise KeyboardInterrupt
            while waiting and len(self._jobs) < self._workers and not self._interrupted:
                self._start(*waiting.pop())
            self._turn(on_result)

    def _start(self, number: int, task: Task) -> None:
        folder, (read, write) = self._folder, os.pipe()
        child = fork(lambda: _run(task, ReportPipe(write), folder), (write,), self._lifeline[0])
        os.close(write)
        os.set_blocking(read, False)
        job = _Job(number, child, time.monotonic())
        job.readers = [
            LineReader(self._pipes, read, job.on_report),
            LineReader(self._pipes, child.output, job.on_output),
        ]
        self._jobs.append(job)

    def _turn(self, on_result: OnResult) -> None:
        self._pipes.wait(self._patience())
        now = time.monotonic()
        for job in list(self._jobs):
            # The pipes of a killed process end soon, and the job with them.
            if self._limit and now - job.began >= self._limit and not job.late:
                job.late = True
                kill(job.child.pid)
            # Not the exit of the process but the end of its pipes: its report may still be unread.
            if not any(reader.open for reader in job.readers):
                self._jobs.remove(job)
                on_result(job.number, self._ended(job, now))

    def _patience(self) -> float | None:
        if not self._limit:
            return None
        ends = [job.began + self._limit for job in self._jobs if not job.late]
        return max(0.0, min(ends) - time.monotonic()) if ends else 1.0

    def _ended(self, job: _Job, now: float) -> Result:
        _, status = os.waitpid(job.child.pid, 0)
        seconds, report = now - job.began, job.report
        if job.late:
            return Result({}, f"took more than {self._limit:g} s", seconds)
        if report is None:
            how = how_ended(os.waitstatus_to_exitcode(status))
            output = f": {job.last_line}" if job.last_line else ""
            return Result({}, f"its process {how}{output}", seconds)
        return Result(report.get("values", {}), str(report.get("error", "")), seconds)


def _run(task: Task, reports: ReportPipe, folder: str) -> int:
    """Run a task in its process, with temporary files in a folder, and report the result."""
    # A task that is killed cannot remove its files; they go with the folder.
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    try:
        reports.send("done", values=dict(task()))
    except Exception as error:
        reports.send("done", error=failure(error))
    return 0


def failure(error: Exception) -> str:
    """Why a task has failed, in at most ten lines."""
    text = str(error) if isinstance(error, MinervaError) else f"raised {error!r}"
    lines = text.split("\n")
    return "\n".join(lines if len(lines) <= MAX_LINES else [*lines[: MAX_LINES - 1], "…"])
