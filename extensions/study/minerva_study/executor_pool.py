"""Tasks in the workers of an executor (PEP 3148): pools of Python, Dask, MPI and others."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from types import FrameType, TracebackType
from typing import Any, Final, Self, TypeAlias

from minerva_bus.collect.data_tables import needed
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.launch.child_processes import Handler, end_signals, handled
from minerva_bus.launch.registry import temporary_folder
from minerva_study.executor_task import POLL_SECONDS, Ticket, run_sent, this_machine
from minerva_study.worker_pool import OnResult, Result, Task, WorkerPool

MAX_SUBMITTED: Final = 400
"""Tasks that an executor has at a time; as many more are not yet made."""

MAX_REOPENED: Final = 10
"""Executors that a study opens in place of broken ones."""

MAX_NAMES: Final = 4
"""Tasks that a message about a broken executor names."""

CONNECT_SECONDS: Final = 5.0
LEAVE_SECONDS: Final = 1.0
"""Time for running tasks to end after an interrupt."""

ExecutorSource: TypeAlias = Executor | Callable[[], Executor]
"""An executor, or a function that opens one."""


class ExecutorPool:
    """The workers of an executor; leaving the context cancels open tasks.

    `source` is an executor, which stays open, or a function that opens one. If a worker dies, that
    function opens another executor. The tasks that ran then run again, one at a time: one that
    loses its worker once more has failed.

    `limit`: seconds that a task may take, checked between frames; 0: no limit. `note` is called
    with a line for the user.
    """

    def __init__(
        self,
        source: ExecutorSource,
        limit: float = 0.0,
        note: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._open_executor = None if _is_executor(source) or not callable(source) else source
        self._executor: Any = source
        self._limit = limit
        self._note = note
        self._open: dict[Future[Any], int] = {}
        self._reopened = 0
        self._interrupted = False
        self._ticket = Ticket("", 0, "")
        self._context = ExitStack()

    def __enter__(self) -> Self:
        if self._open_executor is not None:
            self._executor = self._open_executor()
        if not _is_executor(self._executor):
            raise MisuseError(
                f"{self._executor!r:.60} is not an executor: give one of concurrent.futures, or"
                " Client(...).get_executor() of Dask, or a function that opens one"
            )
        folder = self._context.enter_context(temporary_folder("study"))
        self._ticket = Ticket(this_machine(), os.getpid(), str(folder))
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
        if self._open_executor is not None:
            # A task that has not ended by now may be stuck in one frame.
            self._executor.shutdown(wait=all(future.done() for future in self._open))
        self._open.clear()

    def run(self, tasks: Sequence[Task], on_result: OnResult) -> None:
        """Run all tasks; report each result as it arrives.

        Raises KeyboardInterrupt, and MinervaError if the workers cannot run the tasks.
        """
        batch = _Batch(tasks, on_result, deque(range(len(tasks))))
        with _signals(self._on_signal):
            while batch.unfinished or self._open:
                self._submit_next(batch)
                if self._interrupted:
                    raise KeyboardInterrupt
                with suppress(Empty):
                    self._take(batch.done.get(timeout=POLL_SECONDS), batch)

    def _on_signal(self, number: int, _: FrameType | None) -> None:
        # Noted only: an exception could interrupt `on_result`, which writes files.
        self._interrupted = True

    def _submit_next(self, batch: _Batch) -> None:
        """Submit as many tasks as the executor should have."""
        if batch.lost:
            # The executor is broken, so its other tasks end soon.
            if self._open:
                return
            self._reopen(batch)
        while len(self._open) < MAX_SUBMITTED:
            number = batch.next(busy=bool(self._open))
            if number is None:
                return
            try:
                future = self._executor.submit(
                    run_sent, self._ticket, number, self._limit, batch.tasks[number]
                )
            except BrokenExecutor as error:
                batch.lost[number] = error
                return
            except Exception as error:
                raise MinervaError(f"the executor accepts no task: {_described(error)}") from error
            self._open[future] = number
            future.add_done_callback(batch.done.put)

    def _take(self, future: Future[Any], batch: _Batch) -> None:
        """Take the result of a task, or note that its executor is broken."""
        number = self._open.pop(future)
        try:
            result = _result(future)
        except BrokenExecutor as error:
            batch.lost[number] = error
            return
        batch.alone.discard(number)
        if result is not None:
            batch.on_result(number, result)
        else:
            # The worker gave it up, as after a lost connection.
            batch.waiting.appendleft(number)

    def _reopen(self, batch: _Batch) -> None:
        """Open another executor in place of a broken one. Raises MinervaError if there is none."""
        error = next(iter(batch.lost.values()))
        running = [number for number in sorted(batch.lost) if self._ticket.take_mark(number)]
        names = "; ".join(batch.tasks[number].label for number in running[:MAX_NAMES])
        what = f"a worker ended while it ran {names}" if names else _described(error)
        if self._open_executor is None:
            raise MinervaError(
                f"the executor cannot go on: {type(error).__name__}: {what}; start the study again,"
                " or give a function that opens an executor, such as"
                " executor=lambda: ProcessPoolExecutor(4), and the study reopens it"
            ) from error
        if self._reopened == MAX_REOPENED:
            raise MinervaError(
                f"the executor cannot go on: {what}; it was reopened {MAX_REOPENED} times already"
            ) from error
        self._reopened += 1
        self._note(f"{what}; reopening the executor ({self._reopened} of {MAX_REOPENED})")
        # Its processes have ended.
        self._executor.shutdown(wait=False)
        self._executor = self._open_executor()
        batch.restore(running)


@dataclass(slots=True)
class _Batch:
    """The tasks of one call of `run`, by their numbers.

    `lost`: those of a broken executor, with its error; `suspects`: those of them that ran, which
    have to run alone; `alone`: the suspect that runs.
    """

    tasks: Sequence[Task]
    on_result: OnResult
    waiting: deque[int]
    done: SimpleQueue[Future[Any]] = field(default_factory=lambda: SimpleQueue[Future[Any]]())
    lost: dict[int, BrokenExecutor] = field(default_factory=dict[int, BrokenExecutor])
    suspects: deque[int] = field(default_factory=deque[int])
    alone: set[int] = field(default_factory=set[int])

    @property
    def unfinished(self) -> bool:
        """Whether a task has to be submitted."""
        return bool(self.waiting or self.lost or self.suspects)

    def next(self, *, busy: bool) -> int | None:
        """The next task to submit; None while it has to wait for others."""
        if self.alone or (self.suspects and busy):
            return None
        if self.suspects:
            number = self.suspects.popleft()
            self.alone.add(number)
            return number
        return self.waiting.popleft() if self.waiting else None

    def restore(self, running: Sequence[int]) -> None:
        """Submit lost tasks again; one that has lost its worker alone has failed."""
        for number in sorted(self.lost, reverse=True):
            if number in running and number in self.alone:
                self.on_result(number, Result({}, "its worker process ended, twice", 0.0))
            elif number in running:
                self.suspects.appendleft(number)
            else:
                self.waiting.appendleft(number)
        self.lost.clear()
        self.alone.clear()


@dataclass(frozen=True, slots=True)
class Workers:
    """Where the runs of a study run: in those of an executor, or in processes of this machine.

    `count`: of processes; 0: one per core. `limit`: seconds that a run may take; 0: no limit.
    """

    count: int = 0
    limit: float = 0.0
    executor: ExecutorSource | None = None


def open_pool(workers: Workers, note: Callable[[str], None]) -> WorkerPool | ExecutorPool:
    """The pool of these workers, to be entered; `note` is called with lines for the user."""
    if workers.executor is None:
        return WorkerPool(workers.count, workers.limit)
    return ExecutorPool(workers.executor, workers.limit, note)


def _is_executor(value: object) -> bool:
    return callable(getattr(value, "submit", None))


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


def _result(future: Future[Any]) -> Result | None:
    try:
        return future.result()
    except MinervaError:
        raise
    except KeyboardInterrupt:
        raise  # Ctrl-C in a terminal also reaches the workers of a pool.
    except BrokenExecutor:
        raise
    except (CancelledError, ModuleNotFoundError) as error:
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
