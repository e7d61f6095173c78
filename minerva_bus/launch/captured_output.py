"""Turns output of members without a process of their own into lines of the log.

Standard output belongs to the whole process, in which other threads print, and other worlds run. So
it is replaced by a stream that passes on what a thread writes to the run of this thread. A thread
belongs to the run of the thread that has started it, which `Thread.start` notes while there are
runs; threads that start otherwise (`_thread`, C code) belong to none.
"""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, Final, TextIO
from weakref import WeakSet

MEMBERS: Final = "in-process"
"""The name before such lines: all members share one output, so the member is unknown."""


class _Lines(io.TextIOBase):
    """A text stream that passes on whole lines; any thread may write to it.

    `own` are the threads that those of its run have started.
    """

    encoding = "utf-8"

    def __init__(self, tell: Callable[[str], None], own: WeakSet[threading.Thread]) -> None:
        self.own = own
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
        self._start = start = threading.Thread.start

        def noted(thread: threading.Thread) -> None:
            for lines in self._of_this_thread():
                lines.own.add(thread)
            start(thread)

        self._noted = noted

    def begin(self) -> None:
        """Replace standard output and `Thread.start`."""
        sys.stdout = self
        threading.Thread.start = self._noted  # type: ignore[method-assign]

    def end(self) -> None:
        """Restore what nothing else has replaced meanwhile."""
        if sys.stdout is self:
            sys.stdout = self.original
        if threading.Thread.start is self._noted:
            threading.Thread.start = self._start  # type: ignore[method-assign]

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
        return next(reversed(self._of_this_thread()), None)

    def _of_this_thread(self) -> list[_Lines]:
        """The lines of this thread's run, and before them those of runs that contain it."""
        thread = threading.current_thread()
        # A copy, because runs begin and end in other threads.
        every = [lines for runs in [*self.runs.values()] for lines in [*runs]]
        return [*self.runs.get(thread, ())] or [each for each in every if thread in each.own]


_installing: Final = threading.Lock()
"""For what all threads share: standard output, and the runs of threads."""


@contextmanager
def printed(tell: Callable[[str], None], own: WeakSet[threading.Thread]) -> Generator[None]:
    """Pass to `tell`, line by line, what this thread prints, and the threads that it starts.

    `own` are those that earlier blocks of the same run have started; new ones are added. Between
    two blocks they print as others do.
    """
    thread = threading.current_thread()
    with _Lines(tell, own) as lines:
        with _installing:
            output: Any = sys.stdout
            # A program may have replaced it since another run began.
            if not isinstance(output, _Output):
                output = _Output(output)
                output.begin()
            output.runs.setdefault(thread, []).append(lines)
        try:
            yield
        finally:
            with _installing:
                output.runs[thread].remove(lines)
                if not output.runs[thread]:
                    del output.runs[thread]
                if not output.runs:
                    output.end()
