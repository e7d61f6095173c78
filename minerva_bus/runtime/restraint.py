"""Lines about members that others cause: some at once, and then few, with how many were left out.

Whoever may take part can come and go, or err, ten thousand times a second; a log, a terminal and a
record must outlast that, and still show whose doing it was.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from minerva_bus.wording import counted

AT_ONCE: Final = 20
"""Lines about one subject that are said at once; after that one is each second."""

GUESTS: Final = "members from elsewhere"
"""The subject that all are together who are no processes of the world file."""

MAX_SUBJECTS: Final = 1000


@dataclass(slots=True)
class _Subject:
    room: float
    at: float
    held: int = 0


class Restraint:
    """Lets lines about each subject through, as many as there is room for; `now` is in seconds."""

    def __init__(self) -> None:
        self._subjects: dict[str, _Subject] = {}

    def lets(self, subject: str, now: float) -> bool:
        """Whether a line may be said; one that may not is counted."""
        known = self._subjects.get(subject)
        if known is None:
            if len(self._subjects) >= MAX_SUBJECTS:
                self._forget(now)
            known = self._subjects.setdefault(subject, _Subject(AT_ONCE, now))
        known.room = min(AT_ONCE, known.room + now - known.at)
        known.at = now
        if known.room < 1.0 or known.held:
            known.held += 1
            return False
        known.room -= 1.0
        return True

    def left_out(self, now: float) -> Iterator[tuple[str, str]]:
        """Of each subject that has room again, how many lines were left out since it was said."""
        for name, known in self._subjects.items():
            room = known.room + now - known.at
            if known.held and room >= 1.0:
                known.room, known.at = room - 1.0, now
                whom = GUESTS if name == GUESTS else "it"
                yield name, f"{counted(known.held, 'more line')} about {whom} left out"
                known.held = 0

    def _forget(self, now: float) -> None:
        """Keep only those of whom something was said a moment ago, or is to be said."""
        self._subjects = {
            name: known
            for name, known in self._subjects.items()
            if known.held or known.room + now - known.at < AT_ONCE
        }
