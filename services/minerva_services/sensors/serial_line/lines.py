"""Lines of text out of bytes that come in parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from minerva_services.sensors.serial_line.line import MOST


class Lines:
    """Takes bytes and gives the lines that are complete, without their ends.

    A line over so many bytes is none: what has come of it is dropped, and `count` told.
    """

    def __init__(self, count: Callable[[str], None], longest: int = MOST) -> None:
        self._count = count
        self._longest = longest
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """Complete lines that are not empty; what is no ASCII becomes signs of replacement."""
        *whole, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if len(self._rest) > self._longest:
            self._rest = b""
            self._count("garbage")
        for line in whole:
            if line.strip():
                yield line.decode("ascii", "replace").strip()
