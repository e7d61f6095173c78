"""A bridge: a free-running publisher that reads a source which may fail, fall silent, come back.

A bridge of one's own is a `Source`, which is opened, read until it ends, and closed; connecting,
waiting, reconnecting, counting and saying so are done here.
"""

from __future__ import annotations

import sys
import threading
import time
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import Protocol, TypeAlias

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Emit, Generator

FIRST_WAIT, LONGEST_WAIT = 0.25, 5.0
SILENT_AFTER = 3.0

Said: TypeAlias = "tuple[str, Reading] | AnyEvent"
"""What a source says: a reading with its topic, or an event."""


class SourceError(MinervaError):
    """A source cannot be opened, or has failed; it may come back."""


class Source(Protocol):
    """Something that says readings and events until it ends."""

    def read(self, stop: threading.Event) -> Iterator[Said | None]:
        """What it says, as it comes; None now and then while it says nothing.

        It ends when there is no more to come, or soon after `stop` is set. Raises SourceError
        where the source fails; what is garbage is passed over and counted.
        """
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class Bridge(Generator, lockstep=False):
    """A generator that passes on what a source says.

    A subclass opens its source, says in `publishes` and `events` what comes of it, and counts what
    it passes over with `count`. `source` names it for people.
    """

    reconnects: bool = True
    """Whether a source that has failed is opened anew."""

    source: str = "its source"

    failed: bool = False
    """Whether it has given its source up."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._state = "not open yet"
        self._heard_at = 0.0
        self._lock = threading.Lock()

    @abstractmethod
    def open(self) -> Source:
        """Open the source. Raises SourceError."""

    def count(self, what: str, more: int = 1) -> None:
        """Count something that happened, for `minerva list` and `top`; from any thread."""
        with self._lock:
            self._counts[what] = self._counts.get(what, 0) + more

    def report(self) -> Mapping[str, bool | int | float | str]:
        """What was counted, and how the source is."""
        with self._lock:
            counts = dict(self._counts)
        return {**counts, "source": self._how()}

    def _how(self) -> str:
        silent = time.monotonic() - self._heard_at
        if self._state == "open" and silent > SILENT_AFTER:
            return f"silent for {silent:.0f} s"
        return self._state

    # --- in a thread of its own ---

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Pass on what the source says, until it ends or the world does."""
        wait = FIRST_WAIT
        told = set[str]()  # why it was not there, since it was the last time
        while not stop.is_set():
            try:
                with closing(self.open()) as source:
                    if told:
                        self._say(f"{self.source} is back")
                    self._state, self._heard_at = "open", time.monotonic()
                    wait = FIRST_WAIT
                    told.clear()
                    self._pass_on(source, emit, stop)
                self._state = "ended"
                if not stop.is_set():
                    self._say(f"{self.source} has ended")
                return
            except SourceError as error:
                self._state = str(error)
                if not self.reconnects:
                    raise
                if self._state not in told:
                    self._say(f"{error}; tried again until it is there")
                told.add(self._state)
                self.count("failures")
            stop.wait(wait)
            wait = min(2 * wait, LONGEST_WAIT)

    def _pass_on(self, source: Source, emit: Emit, stop: threading.Event) -> None:
        for said in source.read(stop):
            if stop.is_set():
                return
            if said is None:
                continue
            self._heard_at = time.monotonic()
            if isinstance(said, tuple):
                emit.publish(*said)
                self.count("readings")
            else:
                emit(said)
                self.count("events")

    def _say(self, what: str) -> None:
        sys.stdout.write(f"{what}\n")
        sys.stdout.flush()
