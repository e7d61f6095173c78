"""Rate limits of log lines about members, with a count of the lines that were omitted.

A member can fail, or join and leave, ten thousand times a second. Log, terminal and record must
remain readable, and still name the member.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from minerva_bus.wording import counted

AT_ONCE: Final = 20
"""Lines about one subject that are logged at once; after that, one per second."""

GUESTS: Final = "members from elsewhere"
"""The common subject of all members that are not processes of the world file."""

MAX_SUBJECTS: Final = 1000


@dataclass(slots=True)
class _Subject:
    room: float
    at: float
    held: int = 0


class Restraint:
    """A token bucket of log lines for each subject; `now` is in seconds."""

    def __init__(self) -> None:
        self._subjects: dict[str, _Subject] = {}

    def lets(self, subject: str, now: float) -> bool:
        """Whether a line may be logged; omitted lines are counted."""
        known = self._subjects.get(subject)
        if known is None:
            # Names may be invented, so the table must not grow without limit.
            if len(self._subjects) >= MAX_SUBJECTS:
                self._forget(now)
            known = self._subjects.setdefault(subject, _Subject(AT_ONCE, now))
        known.room = min(AT_ONCE, known.room + now - known.at)
        known.at = now
        # A line after omitted ones waits as well, until `left_out` has reported their number.
        if known.room < 1.0 or known.held:
            known.held += 1
            return False
        known.room -= 1.0
        return True

    def left_out(self, now: float) -> Iterator[tuple[str, str]]:
        """The subjects that may be logged again, with the number of omitted lines in words."""
        for name, known in self._subjects.items():
            room = known.room + now - known.at
            if known.held and room >= 1.0:
                known.room, known.at = room - 1.0, now
                whom = GUESTS if name == GUESTS else "it"
                yield name, f"{counted(known.held, 'more line')} about {whom} omitted"
                known.held = 0

    def _forget(self, now: float) -> None:
        """Forget the subjects with a full bucket and no omitted lines."""
        self._subjects = {
            name: known
            for name, known in self._subjects.items()
            if known.held or known.room + now - known.at < AT_ONCE
        }
