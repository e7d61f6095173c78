"""Tasks in the workers of an executor (PEP 3148): pools of Python, Dask, MPI and others.

Each worker process runs one task at a time, since user code need not be safe for threads. A task
that is no longer wanted ends after its frame: its study has been interrupted, or killed.
"""

from __future__ import annotations

import io
import logging
import os
import platform
import threading
import time
from collections.abc import Generator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack, contextmanager, redirect_stderr, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from queue import Empty, SimpleQueue
from types import FrameType, TracebackType
from typing import Any, Final, Self

from minerva_bus.collect.table import needed
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.launch.interrupts import Handler, end_signals, handled
from minerva_bus.launch.temporary_folder import temporary_folder
from minerva_bus.study.sent_world import SentWorld, dask_worker
from minerva_bus.study.worker_pool import OnResult, Result, Task, WorkerPool, failure

MAX_SUBMITTED: Final = 400
"""Tasks that an executor has at a time; as many more are not yet made."""

POLL_SECONDS: Final = 0.1
CONNECT_SECONDS: Final = 5.0
LEAVE_SECONDS: Final = 1.0
"""Time for running tasks to end after an interrupt."""


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
        return (self.machine != _machine() or self._running()) and _wanted_by_dask()

    def _running(self) -> bool:
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            pass  # It runs for another user.
        return Path(self.folder).exists()


class ExecutorPool:
    """The workers of an executor, which stays open; leaving the context cancels open tasks.

    `limit`: seconds that a task may take, checked between frames; 0: no limit.
    """

    def __init__(self, executor: Executor, limit: float = 0.0) -> None:
        if not callable(getattr(executor, "submit", None)):
            raise MisuseError(
                f"{executor!r:.60} is no executor: give one of concurrent.futures, or"
                " Client(...).get_executor() of Dask"
            )
        self._executor = executor
        self._limit = limit
        self._open: dict[Future[Any], int] = {}
        self._interrupted = False
        self._ticket = Ticket("", 0, "")
        self._context = ExitStack()

    def __enter__(self) -> Self:
        folder = self._context.enter_context(temporary_folder("study"))
        self._ticket = Ticket(_machine(), os.getpid(), str(folder))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._context.close()
        for future in self._open:
            future.cancel()
        end = time.monotonic() + LEAVE_SECONDS
        for future in self._open:
            with suppress(BaseException):
                future.result(max(0.0, end - time.monotonic()))
        self._open.clear()

    def run(self, tasks: Sequence[Task], on_result: OnResult) -> None:
        """Run all tasks; report each result as it arrives.

        Raises KeyboardInterrupt, and MinervaError if the workers cannot run the tasks.
        """
        waiting = list(enumerate(tasks))[::-1]
        done: SimpleQueue[Future[Any]] = SimpleQueue()
        with _signals(self._on_signal):
            while waiting or self._open:
                while waiting and len(self._open) < MAX_SUBMITTED:
                    self._submit(*waiting.pop(), done)
                if self._interrupted:
                    raise KeyboardInterrupt
                with suppress(Empty):
                    future = done.get(timeout=POLL_SECONDS)
                    number, result = self._open.pop(future), _result(future)
                    if result is not None:
                        on_result(number, result)
                    else:
                        # The worker gave it up, as after a lost connection.
                        waiting.append((number, tasks[number]))

    def _on_signal(self, number: int, _: FrameType | None) -> None:
        # Noted only: an exception could interrupt `on_result`, which writes files.
        self._interrupted = True

    def _submit(self, number: int, task: Task, done: SimpleQueue[Future[Any]]) -> None:
        try:
            future = self._executor.submit(run_sent, self._ticket, number, self._limit, task)
        except Exception as error:
            raise MinervaError(f"the executor accepts no task: {_described(error)}") from error
        self._open[future] = number
        future.add_done_callback(done.put)


@dataclass(frozen=True, slots=True)
class Workers:
    """Where the runs of a study run: in those of an executor, or in processes of this machine.

    `count`: of processes; 0: one per core. `limit`: seconds that a run may take; 0: no limit.
    """

    count: int = 0
    limit: float = 0.0
    executor: Executor | None = None


def open_pool(workers: Workers) -> WorkerPool | ExecutorPool:
    """The pool of these workers, to be entered. Raises MisuseError."""
    if workers.executor is None:
        return WorkerPool(workers.count, workers.limit)
    return ExecutorPool(workers.executor, workers.limit)


@contextmanager
def dask_executor(address: str) -> Generator[Executor]:
    """The workers of a Dask cluster. Raises MisuseError if there is none at this address."""
    distributed = needed("distributed", "dask")
    # Its client logs tracebacks of a lost connection; the error of the study says what matters.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise MisuseError(
            f"--dask {address}: no scheduler answers ({_described(error)}); start one with"
            " `dask scheduler`, and workers with `dask worker HOST:8786`"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise MisuseError(
                f"--dask {address}: the cluster has no workers; start one with"
                f" `dask worker {address}`"
            )
        yield client.get_executor(pure=False)


def run_sent(ticket: Ticket, number: int, limit: float, task: Task) -> Result | None:
    """Run a task in a worker; returns None if it is no longer wanted.

    Its `number` makes the call unlike others, of which Dask would use the same result. Raises
    MinervaError if this worker cannot run the world.
    """
    with _running(ticket) as wanted:
        if not wanted:
            return None
        if isinstance(task.read, SentWorld):
            task.read.check()
        clock = _Clock(ticket, limit)
        # Members of the world print; the error has what matters.
        with redirect_stderr(io.StringIO()):
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


def _result(future: Future[Any]) -> Result | None:
    try:
        return future.result()
    except MinervaError:
        raise
    except KeyboardInterrupt:
        raise  # Ctrl-C in a terminal also reaches the workers of a pool.
    except (CancelledError, BrokenExecutor, ModuleNotFoundError) as error:
        # Not the failure of one task: no further one would succeed.
        raise MinervaError(
            f"the executor cannot go on: {_described(error)}; check its workers, and start the"
            " study again"
        ) from error
    except BaseException as error:
        return Result({}, f"its worker failed: {_described(error)}", 0.0)


def _described(error: BaseException) -> str:
    text = str(error).strip().partition("\n")[0][:300]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@contextmanager
def _signals(handler: Handler) -> Generator[None]:
    """Handle the signals that end this process, as far as this is the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with handled(dict.fromkeys(end_signals(), handler)):
        yield


@cache
def _machine() -> str:
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
