"""What a member's own threads tell its main one, beside what comes over the bus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.world.readings import Reading


@dataclass(frozen=True, slots=True)
class Ungreeted:
    """So long nobody has greeted the member that nobody will."""


@dataclass(frozen=True, slots=True)
class Gone:
    """The world has not come back."""


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

    def __init__(self, put: Callable[[Any], None]) -> None:
        self._put = put

    def __call__(self, event: AnyEvent) -> None:
        """Emit an event."""
        self._put(event)

    def publish(self, topic: str, reading: Reading) -> None:
        """Put a reading on a sensor topic."""
        self._put(Published(topic, reading))


@dataclass(frozen=True, slots=True)
class Pulse:
    """It is time for a pulse of the service."""
