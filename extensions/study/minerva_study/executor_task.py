"""One task in a worker of an executor: whether it is still wanted, and how long it may take.

Each worker process runs one task at a time, since user code need not be safe for threads. A task
that is no longer wanted ends after its frame: its study has been interrupted, or killed.
"""

from __future__ import annotations

import io
import os
import platform
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, redirect_stderr, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from minerva_study.sent_branch import SentBranch
from minerva_study.sent_world import SentWorld, dask_worker
from minerva_study.worker_pool import Result, Task, failure

POLL_SECONDS: Final = 0.1


@dataclass(frozen=True, slots=True)
class Ticket:
    """Tells a worker whether a task is still wanted.

    The folder exists while the study runs in the process `pid`. A worker looks only if it has the
    same file system and processes; a Dask worker elsewhere learns it from its scheduler.
    """

    machine: str
    pid: int
    folder: str

    def valid(self) -> bool:
        """Whether the task is still wanted."""
        return (self.machine != this_machine() or self._running()) and _wanted_by_dask()

    @contextmanager
    def started(self, number: int) -> Generator[None]:
        """Mark a task as running; the mark stays if its process ends."""
        mark = self._mark(number)
        # The folder is gone if the study has ended.
        with suppress(OSError):
            if self.machine == this_machine():
                mark.touch()
        try:
            yield
        finally:
            mark.unlink(missing_ok=True)

    def take_mark(self, number: int) -> bool:
        """Whether a task was running when its process ended; removes the mark."""
        mark = self._mark(number)
        marked = mark.exists()
        mark.unlink(missing_ok=True)
        return marked

    def _mark(self, number: int) -> Path:
        return Path(self.folder) / f"running-{number}"

    def _running(self) -> bool:
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            pass  # It runs for another user.
        return Path(self.folder).exists()


def run_sent(ticket: Ticket, number: int, limit: float, task: Task) -> Result | None:
    """Run a task in a worker; returns None if it is no longer wanted.

    Its `number` makes the call unlike others, of which Dask would use the same result. Raises
    MinervaError if this worker cannot run the world.
    """
    with _running(ticket) as wanted:
        if not wanted:
            return None
        if isinstance(task.read, SentWorld | SentBranch):
            task.read.check()
        clock = _Clock(ticket, limit)
        # Members of the world print; the error has what matters.
        with ticket.started(number), redirect_stderr(io.StringIO()):
            try:
                values, error = task(clock.over), ""
            except Exception as raised:
                values, error = {}, failure(raised)
    if clock.unwanted:
        return None  # The values are those of a part of the run.
    if clock.late:
        return Result({}, f"took more than {limit:g} s", clock.seconds)
    return Result({} if error else values, error, clock.seconds)


class _Clock:
    """Decides between two frames whether a task goes on."""

    def __init__(self, ticket: Ticket, limit: float) -> None:
        self.late = self.unwanted = False
        self._ticket = ticket
        self._limit = limit
        self._began = self._looked = time.monotonic()

    @property
    def seconds(self) -> float:
        """Wall time since the task began."""
        return time.monotonic() - self._began

    def over(self) -> bool:
        """Whether the task has to end."""
        now = time.monotonic()
        if now - self._looked < POLL_SECONDS:
            return False
        self._looked = now
        self.late = bool(self._limit) and now - self._began > self._limit
        self.unwanted = not self._ticket.valid()
        return self.late or self.unwanted


_one_at_a_time = threading.Lock()


@contextmanager
def _running(ticket: Ticket) -> Generator[bool]:
    """Wait until this process runs no other task; whether the task is still wanted."""
    # Not only for safety: Python runs one thread at a time anyway.
    while not _one_at_a_time.acquire(timeout=POLL_SECONDS):
        if not ticket.valid():
            yield False
            return
    try:
        yield ticket.valid()
    finally:
        _one_at_a_time.release()


@cache
def this_machine() -> str:
    """The machine, and the container if its processes or files are separate."""
    spaces = [Path("/proc/self/ns", name) for name in ("pid", "mnt")]
    return " ".join([platform.node(), *(str(os.readlink(p)) for p in spaces if p.exists())])  # noqa: PTH115


def _wanted_by_dask() -> bool:
    try:
        worker = dask_worker()
        task = worker.state.tasks.get(worker.get_current_task())
        # The scheduler cancels a task whose client has cancelled it, or is gone.
        return task is None or task.state not in ("cancelled", "released", "forgotten")
    except (ImportError, ValueError, AttributeError):
        return True
