"""The events of a world as a person can follow them: those of every frame do not drown the rest."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from itertools import chain

from minerva_bus.world.operator import LogEntry, WorldStatus

NOTABLE: str = "what is not in every frame"
ALL: str = "all"
_EACH = 30
_OFTEN = 0.3
"""Events of a type in a frame, on average, from which they are not notable."""


class Diary:
    """The last happenings of each type."""

    def __init__(self) -> None:
        self.last = 0
        self._kept: dict[str, deque[LogEntry]] = {}
        self._often: set[str] = set()

    def hear(self, status: WorldStatus) -> None:
        """Take what has happened since."""
        frames = max(status.hz, 1.0)
        self._often |= {one for one, rate in status.events.items() if rate > _OFTEN * frames}
        for one in status.happenings:
            self._kept.setdefault(one.about, deque(maxlen=_EACH)).append(one)
            self.last = max(self.last, one.number)

    @property
    def choices(self) -> tuple[str, ...]:
        """What one may look at."""
        return (NOTABLE, ALL, *sorted(self._kept))

    def chosen(self, choice: str, most: int) -> list[LogEntry]:
        """The last happenings of a choice, the oldest first."""
        if choice == NOTABLE:
            found: Iterable[deque[LogEntry]] = (
                kept for about, kept in self._kept.items() if about not in self._often
            )
        else:
            found = (kept for about, kept in self._kept.items() if choice in (ALL, about))
        return sorted(chain.from_iterable(found), key=lambda one: one.number)[-most:]
