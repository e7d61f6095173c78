"""A feed of world events in which those of every frame do not crowd out the others."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from itertools import chain

from minerva_bus.world.operator import LogEntry, WorldStatus

NOTABLE: str = "what is not in every frame"
ALL: str = "all"
_EACH = 30
_OFTEN = 0.3
"""Mean number of events of a type per frame from which they are not notable."""


class EventFeed:
    """The latest events of each type."""

    def __init__(self) -> None:
        self.last = 0
        self._kept: dict[str, deque[LogEntry]] = {}
        self._often: set[str] = set()

    def update(self, status: WorldStatus) -> None:
        """Add the events since the last update."""
        frames = max(status.hz, 1.0)
        self._often |= {name for name, rate in status.events.items() if rate > _OFTEN * frames}
        for event in status.happenings:
            self._kept.setdefault(event.about, deque(maxlen=_EACH)).append(event)
            self.last = max(self.last, event.number)

    @property
    def choices(self) -> tuple[str, ...]:
        """Options of the filter."""
        return (NOTABLE, ALL, *sorted(self._kept))

    def chosen(self, choice: str, most: int) -> list[LogEntry]:
        """The latest events of a filter option, oldest first."""
        if choice == NOTABLE:
            groups: Iterable[deque[LogEntry]] = (
                kept for about, kept in self._kept.items() if about not in self._often
            )
        else:
            groups = (kept for about, kept in self._kept.items() if choice in (ALL, about))
        return sorted(chain.from_iterable(groups), key=lambda event: event.number)[-most:]
