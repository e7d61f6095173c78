"""Turns output of members without a process of their own into lines of the log."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, redirect_stdout
from typing import Final

MEMBERS: Final = "in-process"
"""The name before such lines: all members share one output, so the member is unknown."""


class _Lines(io.TextIOBase):
    """A text stream that passes on whole lines; any thread may write to it."""

    encoding = "utf-8"

    def __init__(self, tell: Callable[[str], None]) -> None:
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


@contextmanager
def printed(tell: Callable[[str], None]) -> Generator[None]:
    """Pass standard output to `tell`, line by line."""
    with _Lines(tell) as lines, redirect_stdout(lines):
        yield
