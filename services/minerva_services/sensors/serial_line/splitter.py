"""Lines of text from a byte stream."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from minerva_services.sensors.serial_line.line import MOST


class LineSplitter:
    """Splits a byte stream into complete lines without their terminators.

    A line longer than `longest` bytes is dropped and counted as garbage.
    """

    def __init__(self, count: Callable[[str], None], longest: int = MOST) -> None:
        self._count = count
        self._longest = longest
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """Complete non-empty lines; non-ASCII bytes become replacement characters."""
        *whole, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if len(self._rest) > self._longest:
            self._rest = b""
            self._count("garbage")
        for line in whole:
            if line.strip():
                yield line.decode("ascii", "replace").strip()
