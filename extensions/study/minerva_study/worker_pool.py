"""A pool of worker processes, forked from this one, with a process for each task.

So a task cannot affect other tasks or this process by its memory, a crash or a time-out. Processes
that a task started end with its worker.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Final, Protocol, Self

from minerva_bus.errors import MinervaError
from minerva_bus.launch.child_processes import (
    ChildProcess,
    LineReader,
    Pipes,
    ReportPipe,
    caught,
    fork,
    how_ended,
    kill,
    parse_report,
    reap,
)
from minerva_bus.launch.in_process import never
from minerva_bus.launch.machine_resources import cores
from minerva_bus.launch.registry import temporary_folder
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.world_settings import Overrides

MAX_LINES: Final = 9
"""Lines of an error; a further one names the run."""

MAX_OUTPUT: Final = 2000
"""Length of the last line of a task's output that an error quotes."""


class Task(Protocol):
    """One run of a world, read by `read`; returns plain data.

    It ends early if `interrupted` is true between two frames.
    """

    @property
    def read(self) -> Callable[[Overrides], WorldFile]:
        """Reads the world."""
        ...

    @property
    def label(self) -> str:
        """Names the run in messages: `birds=100, seed=3`."""
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
class _Worker:
    """A process and its task."""

    child: ChildProcess
    number: int
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

    @property
    def open(self) -> bool:
        """Whether the process may still report."""
        # Not its exit but the end of its pipes: a report may still be unread.
        return any(reader.open for reader in self.readers)


class WorkerPool:
    """Workers for tasks, in the main thread; leaving its context ends running tasks.

    `workers`: number of processes; 0: one per core. `limit`: seconds that a task may take; 0: no
    limit. Within the context, signals that end a process make `run` raise KeyboardInterrupt.
    """

    def __init__(self, workers: int, limit: float = 0.0) -> None:
        self._count = workers or cores()
        self._limit = limit
        self._lifeline = os.pipe()
        self._pipes = Pipes()
        self._workers: list[_Worker] = []
        self._folder = ""
        self._interrupted = False
        self._context = ExitStack()

    def __enter__(self) -> Self:
        self._folder = str(self._context.enter_context(temporary_folder("study")))
        self._context.enter_context(caught(self._pipes, self._on_interrupt))
        return self

    def _on_interrupt(self, number: signal.Signals) -> None:
        # Python's own handler may raise KeyboardInterrupt during a fork, where it would be lost.
        self._interrupted = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        for worker in self._workers:
            kill(worker.child.pid)
        while self._workers:
            self._reap(self._workers[0])
        # Before the pipes, one of which belongs to the signals that this releases.
        self._context.close()
        self._pipes.close()
        for descriptor in self._lifeline:
            os.close(descriptor)

    def run(self, tasks: Sequence[Task], on_result: OnResult) -> None:
        """Run all tasks; report each result as it arrives. Raises KeyboardInterrupt."""
        waiting = deque(range(len(tasks)))
        while waiting or self._workers:
            if self._interrupted:
                raise KeyboardInterrupt
            while waiting and len(self._workers) < self._count and not self._interrupted:
                number = waiting.popleft()
                self._start(tasks[number], number)
            self._pipes.wait(self._patience())
            for worker in list(self._workers):
                self._look(worker, on_result)

    def _start(self, task: Task, number: int) -> None:
        folder, (read, write) = self._folder, os.pipe()
        child = fork(lambda: _run(task, ReportPipe(write), folder), (write,), self._lifeline[0])
        os.close(write)
        os.set_blocking(read, False)
        worker = _Worker(child, number, time.monotonic())
        worker.readers = [
            LineReader(self._pipes, read, worker.on_report),
            LineReader(self._pipes, child.output, worker.on_output),
        ]
        self._workers.append(worker)

    def _look(self, worker: _Worker, on_result: OnResult) -> None:
        """Take the result of a worker that has reported or ended, and kill one that is late."""
        now = time.monotonic()
        if worker.report is not None or not worker.open:
            kill(worker.child.pid)
            status = self._reap(worker)
            on_result(worker.number, self._result(worker, now, status))
        # The pipes of a killed process end soon, and the worker with them.
        elif self._limit and now - worker.began >= self._limit and not worker.late:
            worker.late = True
            kill(worker.child.pid)

    def _reap(self, worker: _Worker) -> int:
        """Wait until a worker has ended; returns its wait status."""
        self._workers.remove(worker)
        return reap(worker.child.pid, worker.readers)

    def _patience(self) -> float | None:
        if not self._limit:
            return None
        ends = [worker.began + self._limit for worker in self._workers if not worker.late]
        return max(0.0, min(ends) - time.monotonic()) if ends else 1.0

    def _result(self, worker: _Worker, now: float, status: int) -> Result:
        seconds, report = now - worker.began, worker.report
        if worker.late:
            return Result({}, f"took more than {self._limit:g} s", seconds)
        if report is None:
            how = how_ended(os.waitstatus_to_exitcode(status))
            output = f": {worker.last_line}" if worker.last_line else ""
            return Result({}, f"its process {how}{output}", seconds)
        return Result(report.get("values", {}), str(report.get("error", "")), seconds)


def _run(task: Task, reports: ReportPipe, folder: str) -> int:
    """Run a task in a worker, with temporary files in a folder, and report the result."""
    # A task that is killed cannot remove its files; they go with the folder.
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    try:
        done = {"values": dict(task())}
    except Exception as error:
        done = {"error": failure(error)}
    reports.send("done", **done)
    return 0


def failure(error: Exception) -> str:
    """Why a task has failed, in at most ten lines."""
    text = str(error) if isinstance(error, MinervaError) else f"raised {error!r}"
    lines = text.split("\n")
    return "\n".join(lines if len(lines) <= MAX_LINES else [*lines[: MAX_LINES - 1], "…"])
