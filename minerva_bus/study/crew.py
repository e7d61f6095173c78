"""A pool of worker processes: each task runs in a process forked from this one.

So a task cannot affect other tasks or this process by its memory, a crash or a time-out. Processes
that it started end with it.

Our signal handler notes an interrupt, and the pool raises it between two iterations: Python's own
handler may raise it during a fork, where it would be lost.
"""

from __future__ import annotations

import os
import selectors
import signal
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import FrameType, TracebackType
from typing import Any, Self

from minerva_bus.errors import MinervaError
from minerva_bus.launch.interrupts import end_signals
from minerva_bus.launch.pipes import LineBuffer as Lines, ReportPipe as Reports, parse_report as parsed
from minerva_bus.launch.forking import ChildProcess as Child, fork

Task = Callable[[], Mapping[str, Any]]
LAST_LINES = 2000


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a task, or why it failed; `seconds` of wall time."""

    told: Mapping[str, Any]
    error: str
    seconds: float


Heard = Callable[[int, Result], None]


@dataclass(slots=True)
class _Job:
    """A running task."""

    number: int
    child: Child
    results: int
    began: float
    lines: Lines = field(default_factory=Lines)
    told: dict[str, Any] | None = None
    said: str = ""
    late: bool = False
    open: int = 2


class WorkerPool:
    """Workers for tasks, in the main thread; leaving its context ends running tasks.

    `limit`: seconds that a task may take; 0: no limit. Within the context, SIGINT and SIGTERM
    make `run` raise KeyboardInterrupt.
    """

    def __init__(self, workers: int, limit: float = 0.0) -> None:
        self._workers = workers
        self._limit = limit
        self._lifeline = os.pipe()
        self._folder = tempfile.TemporaryDirectory(
            prefix="minerva-study-", ignore_cleanup_errors=True
        )
        self._selector = selectors.DefaultSelector()
        self._jobs: list[_Job] = []
        self._wake = os.pipe()
        self._interrupted = False
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for end in self._wake:
            os.set_blocking(end, False)
        self._selector.register(self._wake[0], selectors.EVENT_READ)
        signal.set_wakeup_fd(self._wake[1], warn_on_full_buffer=False)
        for number in end_signals():
            self._handlers[number] = signal.signal(number, self._on_interrupt)
        return self

    def _on_interrupt(self, number: int, frame: FrameType | None) -> None:
        self._interrupted = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        for job in self._jobs:
            _kill(job.child.pid)
        for job in self._jobs:
            os.waitpid(job.child.pid, 0)
        self._jobs.clear()
        signal.set_wakeup_fd(-1)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        for key in list(self._selector.get_map().values()):
            os.close(key.fd)
        self._selector.close()
        for descriptor in (*self._lifeline, self._wake[1]):
            os.close(descriptor)
        self._folder.cleanup()

    def run(self, tasks: Sequence[Task], heard: Heard) -> None:
        """Run all tasks; report each result with the number of its task as it arrives.

        Raises KeyboardInterrupt.
        """
        waiting = list(enumerate(tasks))[::-1]
        while waiting or self._jobs:
            if self._interrupted:
                raise KeyboardInterrupt
            while waiting and len(self._jobs) < self._workers and not self._interrupted:
                self._start(*waiting.pop())
            self._turn(heard)

    def _start(self, number: int, task: Task) -> None:
        folder, (read, write) = self._folder.name, os.pipe()
        child = fork(
            lambda: _body(task, write, folder), (write,), self._lifeline[0]
        )
        os.close(write)
        os.set_blocking(read, False)
        job = _Job(number, child, read, time.monotonic())
        self._jobs.append(job)
        self._selector.register(read, selectors.EVENT_READ, (job, True))
        self._selector.register(child.output, selectors.EVENT_READ, (job, False))

    def _turn(self, heard: Heard) -> None:
        for key, _ in self._selector.select(self._patience()):
            if key.data is None:
                os.read(key.fd, 4096)  # An interrupt, handled in the next iteration.
                continue
            job, result = key.data
            self._read(job, key.fd, result)
        now = time.monotonic()
        for job in list(self._jobs):
            if self._limit and now - job.began >= self._limit and not job.late:
                job.late = True
                _kill(job.child.pid)
            if not job.open:
                self._jobs.remove(job)
                heard(job.number, self._ended(job, now))

    def _patience(self) -> float | None:
        if not self._limit:
            return None
        ends = [job.began + self._limit for job in self._jobs if not job.late]
        return max(0.0, min(ends) - time.monotonic()) if ends else 1.0

    def _read(self, job: _Job, descriptor: int, result: bool) -> None:
        data = os.read(descriptor, 65536)
        if not data:
            self._selector.unregister(descriptor)
            os.close(descriptor)
            job.open -= 1
        elif result:
            for line in job.lines.feed(data):
                job.told = parsed(line) or job.told
        else:
            job.said = (job.said + data.decode("utf-8", "replace"))[-LAST_LINES:]

    def _ended(self, job: _Job, now: float) -> Result:
        _, status = os.waitpid(job.child.pid, 0)
        seconds, told = now - job.began, job.told or {}
        if job.late:
            return Result({}, f"took over {self._limit:g} s", seconds)
        if not told:
            code = os.waitstatus_to_exitcode(status)
            how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
            return Result({}, f"its process {how}{_last_line(job.said)}", seconds)
        return Result(told.get("told", {}), str(told.get("error", "")), seconds)


def _body(task: Task, results: int, folder: str) -> int:
    """Run a task in its process, with temporary files in a folder, and report the result."""
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    reports = Reports(results)
    try:
        reports.send("done", told=dict(task()))
    except MinervaError as error:
        reports.send("done", error=str(error))
    except Exception as error:
        reports.send("done", error=f"raised {error!r}")
    return 0


def _last_line(said: str) -> str:
    lines = [line for line in said.splitlines() if line.strip()]
    return f": {lines[-1].strip()}" if lines else ""


def _kill(pid: int) -> None:
    """Kill a task's process; processes that it started end by their lifelines."""
    for end in (os.killpg, os.kill):
        try:
            end(pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            continue
