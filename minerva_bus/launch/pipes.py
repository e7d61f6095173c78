"""Pipes between the launcher and its child processes: waiting, lines and reports.

A report is a JSON object in a line of its own.
"""

from __future__ import annotations

import json
import os
import select
import selectors
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, cast

READ_BYTES: Final = 65536
CLOSED: Final = -1
"""Replaces a closed descriptor, because the system reuses descriptor numbers."""


class Pipes:
    """Read ends of non-blocking pipes, and the handler of each."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def listen(self, descriptor: int, on_ready: Callable[[], object]) -> None:
        """Call `on_ready` when the pipe has data to `read` or has reached its end."""
        self._selector.register(descriptor, selectors.EVENT_READ, on_ready)

    def wait(self, seconds: float | None) -> None:
        """Wait for pipes that are ready, and call their handlers; None: no time limit."""
        for key, _ in self._selector.select(seconds):
            # The handler of an earlier pipe may have closed this one.
            if self._selector.get_map().get(key.fd) is key:
                key.data()

    def wait_for(self, descriptor: int, seconds: float) -> bool:
        """Wait for one pipe without calling a handler; returns whether it is ready."""
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        return bool(poll.poll(1000 * seconds))

    def read(self, descriptor: int) -> bytes | None:
        """The available data, possibly b""; None at the end of the pipe, which is then closed."""
        try:
            data = os.read(descriptor, READ_BYTES)
        except BlockingIOError:
            return b""
        if data:
            return data
        self.forget(descriptor)
        return None

    def forget(self, descriptor: int) -> None:
        """Close a pipe unless it is CLOSED."""
        if descriptor != CLOSED:
            self._selector.unregister(descriptor)
            os.close(descriptor)

    def close(self) -> None:
        """Close all pipes."""
        for key in list(self._selector.get_map().values()):
            self.forget(key.fd)
        self._selector.close()


@dataclass(slots=True)
class LineBuffer:
    """Splits data into lines; a line of more than `limit` bytes is cut."""

    limit: int = 1_000_000
    _rest: bytes = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """The lines that `data` completes."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > self.limit:  # Otherwise a child could fill the launcher's memory.
            lines.append(self._rest)
            self._rest = b""
        for line in lines:
            yield line.decode("utf-8", "replace")

    def end(self) -> str:
        """The unterminated last line, or an empty string."""
        rest, self._rest = self._rest, b""
        return rest.decode("utf-8", "replace")


class LineReader:
    """Passes the lines of a pipe to `on_line`."""

    def __init__(self, pipes: Pipes, descriptor: int, on_line: Callable[[str], object]) -> None:
        self.descriptor = descriptor
        self._pipes = pipes
        self._on_line = on_line
        self._buffer = LineBuffer()
        pipes.listen(descriptor, self.read)

    @property
    def open(self) -> bool:
        """Whether the pipe has not reached its end."""
        return self.descriptor != CLOSED

    def read(self) -> bool:
        """Read once; returns whether there was data."""
        # Once: a child that prints without end must not block the reading of other pipes. `wait`
        # reports the pipe again if it has more.
        data = self._pipes.read(self.descriptor)
        if data is None:
            self.descriptor = CLOSED
        for line in self._buffer.feed(data or b""):
            self._on_line(line)
        return bool(data)

    def finish(self) -> None:
        """Read the remaining data, with an unterminated last line, and close the pipe."""
        while self.open and self.read():
            pass
        # A grandchild may hold the write end open, so the pipe may never reach its end.
        self._pipes.forget(self.descriptor)
        self.descriptor = CLOSED
        rest = self._buffer.end()
        if rest:
            self._on_line(rest)


def reap(pid: int, readers: Iterable[LineReader]) -> int:
    """Wait until a worker has ended; returns its status."""
    status = os.waitpid(pid, 0)[1]
    for reader in readers:
        reader.finish()
    return status


@dataclass(slots=True)
class ReportPipe:
    """Writes reports to a pipe; `broken` once its reader is gone."""

    descriptor: int
    broken: bool = field(default=False)

    def send(self, kind: str, **fields: Any) -> None:
        """Send a report; without a reader, do nothing."""
        data = json.dumps({"kind": kind, **fields}).encode() + b"\n"
        try:
            # The system may accept only a part of a long report.
            while data and not self.broken:
                data = data[os.write(self.descriptor, data) :]
        except OSError:
            self.broken = True


def parse_report(line: str) -> dict[str, Any] | None:
    """The report in a line, or None if the line is not a report."""
    try:
        report = json.loads(line)
    except ValueError:
        return None
    return cast("dict[str, Any]", report) if isinstance(report, dict) else None
