"""Turns output of members without a process of their own into lines of the log.

Standard output belongs to the whole process, in which other threads print, and other worlds run. So
it is replaced by a stream that passes on what a thread writes to the run of this thread.
"""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Callable, Generator, Set
from contextlib import contextmanager
from typing import Any, Final, ParamSpec, TextIO
from weakref import WeakSet

_P = ParamSpec("_P")

MEMBERS: Final = "in-process"
"""The name before such lines: all members share one output, so the member is unknown."""


class _Lines(io.TextIOBase):
    """A text stream that passes on whole lines; any thread may write to it.

    `others` are threads that are not of its run; `thread` runs it.
    """

    encoding = "utf-8"

    def __init__(self, tell: Callable[[str], None], others: Set[threading.Thread]) -> None:
        self.others = others
        self.thread = threading.current_thread()
        self._tell = tell
        self._begun = ""
        # Reentrant, because `close` writes while it holds the lock.
        self._lock = threading.RLock()

    def writable(self) -> bool:
        return True

    def write(self, text: str, /) -> int:
        with self._lock:
            *lines, self._begun = (self._begun + text).split("\n")
            for line in lines:
                self._tell(line)
        return len(text)

    def close(self) -> None:
        """Pass on an unterminated last line."""
        with self._lock:
            if self._begun:
                self.write("\n")
        super().close()


class _Output(io.TextIOBase):
    """Standard output while there are runs: what a thread writes goes to its own run.

    `original` gets what threads of no run write.
    """

    def __init__(self, original: TextIO) -> None:
        self.original = original
        self.runs: dict[threading.Thread, list[_Lines]] = {}

    def __getattribute__(self, name: str) -> Any:
        # The base class has these of its own.
        if name in ("encoding", "errors", "buffer", "newlines"):
            return getattr(self.original, name)
        return super().__getattribute__(name)

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return self.original.isatty()

    def fileno(self) -> int:
        return self.original.fileno()

    def write(self, text: str, /) -> int:
        return (self.lines() or self.original).write(text)

    def flush(self) -> None:
        (self.lines() or self.original).flush()

    def lines(self) -> _Lines | None:
        """The lines of this thread's run; None if it has none."""
        thread = threading.current_thread()
        runs = self.runs.get(thread)
        if runs is None:
            # While the main thread runs a world, only code of this world starts threads.
            runs = self.runs.get(threading.main_thread())
            if runs and thread in runs[-1].others:
                return None
        elif runs[-1].closed:  # Its thread was started in an earlier block of the run.
            runs = self.runs.get(runs[-1].thread)
        # Threads of a run may live longer.
        return runs[-1] if runs and not runs[-1].closed else None


_installing: Final = threading.Lock()
"""For what all threads share: standard output, and the runs of threads."""


@contextmanager
def printed(tell: Callable[[str], None], own: WeakSet[threading.Thread]) -> Generator[None]:
    """Pass to `tell`, line by line, what this thread prints, and the threads that it starts.

    `own` are those that the main thread has started in earlier blocks of the same run; new ones are
    added.
    """
    others = {*threading.enumerate()} - {*own}
    with _Lines(tell, others) as lines, _printing(lines):
        try:
            yield
        finally:
            # Beside another thread, anything may have started them.
            if threading.current_thread() is threading.main_thread():
                own.update({*threading.enumerate()} - others)


def inherited(call: Callable[_P, None]) -> Callable[_P, None]:
    """`call` for a thread that this one starts: what it prints is of the same run."""
    output = sys.stdout
    lines = output.lines() if isinstance(output, _Output) else None
    if lines is None:
        return call

    def inheriting(*args: _P.args, **options: _P.kwargs) -> None:
        with _printing(lines):
            call(*args, **options)

    return inheriting


@contextmanager
def _printing(lines: _Lines) -> Generator[None]:
    thread = threading.current_thread()
    with _installing:
        # A program may have replaced it since another run began.
        if not isinstance(sys.stdout, _Output):
            sys.stdout = _Output(sys.stdout)
        output = sys.stdout
        output.runs.setdefault(thread, []).append(lines)
    try:
        yield
    finally:
        with _installing:
            output.runs[thread].remove(lines)
            if not output.runs[thread]:
                del output.runs[thread]
            if not output.runs and sys.stdout is output:
                sys.stdout = output.original
