"""A bridge: a free-running publisher that reads a source which may fail and come back.

To write a bridge, implement a `Source` that can be opened, read until it ends, and closed;
connecting, waiting, reconnecting, counting and logging are done here.
"""

from __future__ import annotations

import sys
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Emit, Generator

MIN_WAIT_SECONDS, MAX_WAIT_SECONDS = 0.25, 5.0
# Time without an item after which an open source is reported as silent.
SILENT_SECONDS = 3.0

SourceItem: TypeAlias = "tuple[str, Reading] | AnyEvent"
"""An item of a source: a reading with its topic, or an event."""


class SourceError(MinervaError):
    """A source cannot be opened or has failed; it may recover."""


class Source(Protocol):
    """Something that yields readings and events until it ends."""

    def read(self, stop: threading.Event, /) -> Iterator[SourceItem | None]:
        """Items as they arrive; None from time to time while there are none.

        Ends when the source is exhausted, or soon after `stop` is set. Raises SourceError if the
        source fails; invalid input is skipped and counted.
        """
        ...

    def close(self) -> None:
        """Release the source."""
        ...


@dataclass(frozen=True, slots=True)
class OpenSource:
    """A `Source` of two functions."""

    read: Callable[[threading.Event], Iterator[SourceItem | None]]
    close: Callable[[], None]


class Counting:
    """Counts what was skipped, and logs the first of each kind; thread-safe."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._lock = threading.Lock()

    @property
    def counts(self) -> dict[str, int]:
        """A copy of the counts, because other threads count meanwhile."""
        with self._lock:
            return dict(self._counts)

    def count(self, what: str, more: int = 1) -> None:
        """Count something, shown by `minerva list` and `top`."""
        with self._lock:
            self._counts[what] = self._counts.get(what, 0) + more

    def pass_over(self, what: str, line: str) -> None:
        """Count skipped input, and log the first of its kind."""
        if what not in self.counts:
            self._log(f"{line}; further ones are counted as {what!r}")
        self.count(what)

    def _log(self, line: str) -> None:
        log(line)


class Bridge(Generator, Counting, when="freely"):
    """A generator that forwards the items of a source.

    A subclass opens its source, declares its output in `publishes` and `events`, and counts skipped
    input with `count`. `source` is its display name.
    """

    reconnects: bool = True
    """Whether a failed source is reopened."""

    source: str = "its source"

    failed: bool = False
    """Whether the bridge has given up its source."""

    def __init__(self) -> None:
        # Constructors of bridges open nothing, because they also run when a world file is read.
        Counting.__init__(self)
        self._state = "not open yet"
        self._received_at = 0.0

    @abstractmethod
    def open(self) -> Source:
        """Open the source. Raises SourceError."""

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Counts, and the state of the source."""
        return {**self.counts, "source": self._source_state()}

    def _source_state(self) -> str:
        silent = time.monotonic() - self._received_at
        if self._state == "open" and silent > SILENT_SECONDS:
            return f"silent for {silent:.0f} s"
        return self._state

    # --- in its own thread ---

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Forward items until the source or the world ends."""
        wait = MIN_WAIT_SECONDS
        logged = set[str]()  # failures since the source was last open
        while not stop.is_set():
            try:
                with closing(self.open()) as source:
                    if logged:
                        self._log(f"{self.source} is back")
                    self._state, self._received_at = "open", time.monotonic()
                    wait = MIN_WAIT_SECONDS
                    logged.clear()
                    self._pass_on(source, emit, stop)
                self._state = "ended"
                if not stop.is_set():
                    self._log(f"{self.source} has ended")
                return
            except SourceError as error:
                self._state = str(error)
                if not self.reconnects:
                    raise
                if self._state not in logged:
                    self._log(f"{error}; retrying")
                logged.add(self._state)
                self.count("failures")
            # Back off exponentially: a short outage ends soon, and a missing device costs little.
            stop.wait(wait)
            wait = min(2 * wait, MAX_WAIT_SECONDS)

    def _pass_on(self, source: Source, emit: Emit, stop: threading.Event) -> None:
        for item in source.read(stop):
            if stop.is_set():
                return
            if item is None:
                continue
            self._received_at = time.monotonic()
            if isinstance(item, tuple):
                emit.publish(*item)
                self.count("readings")
            else:
                emit(item)
                self.count("events")


def log(line: str) -> None:
    """Write a line to standard output at once: the launcher shows it as the member's log."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
