"""What members print where they have no process of their own: lines of the log, as everywhere."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, redirect_stdout
from typing import Final

MEMBERS: Final = "in-process"
"""Who has said it: nobody can tell which of them."""


class _Lines(io.TextIOBase):
    """A text stream that hands over whole lines; from any thread."""

    encoding = "utf-8"

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._begun = ""
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
        """Hand over what has no end of its own."""
        with self._lock:
            if self._begun:
                self.write("\n")
        super().close()


@contextmanager
def printed(tell: Callable[[str], None]) -> Generator[None]:
    """Hand over, line by line, what is printed on standard output."""
    with _Lines(tell) as lines, redirect_stdout(lines):
        yield
