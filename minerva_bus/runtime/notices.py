"""What a member's own threads tell its main one, beside what comes over the bus."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.world.readings import Reading

MAX_WAITING = 256
"""Things that a free-running generator may have said and its main thread not yet dealt with."""

POLL_SECONDS = 0.2


@dataclass(frozen=True, slots=True)
class Ungreeted:
    """So long nobody has greeted the member that nobody will."""


@dataclass(frozen=True, slots=True)
class Claim:
    """It is time to see whether the member's name is free again."""


@dataclass(frozen=True, slots=True)
class Leave:
    """The member shall leave its world."""


@dataclass(frozen=True, slots=True)
class Published:
    """A reading of a free-running publisher."""

    topic: str
    reading: Reading


@dataclass(frozen=True, slots=True)
class Count:
    """It is time to tell how the member does."""


class Outlet:
    """How a free-running generator speaks, from its thread to the member's main one."""

    def __init__(self, put: Callable[[Any], None], stop: threading.Event) -> None:
        self._put = put
        self._stop = stop
        self._room = threading.Semaphore(MAX_WAITING)

    def __call__(self, event: AnyEvent) -> None:
        """Emit an event."""
        self._say(event)

    def publish(self, topic: str, reading: Reading) -> None:
        """Put a reading on a sensor topic."""
        self._say(Published(topic, reading))

    def taken(self) -> None:
        """The main thread has dealt with one thing that was said."""
        self._room.release()

    def _say(self, what: Any) -> None:
        """Hand something over; who is faster than the bus waits, or memory would have no end."""
        while not self._room.acquire(timeout=POLL_SECONDS):
            if self._stop.is_set():
                return
        self._put(what)


@dataclass(frozen=True, slots=True)
class Pulse:
    """It is time for a pulse of the service."""
