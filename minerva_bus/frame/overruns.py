"""Frames that take longer than real time: how many, by how much, and who was last in them.

Times are seconds of one monotonic clock that is passed in, so there is no clock in here.
"""

from __future__ import annotations

from typing import Final

from minerva_bus.frame.description import World

_TOLERANCE: Final = 1.1
"""Parts of a period that a frame may take before it is late."""

_FIRST_WORD: Final = 5
"""So many frames are late before it is said; then twice as many, and so on."""


def real_period(rate: float, world: World) -> float:
    """Seconds that a frame may take at so many frames a second; 0: any number."""
    if rate > 0:
        return 1.0 / rate
    return world.dt if world.real_time else 0.0


class Overruns:
    """The late frames of a world; a period of 0 is no real time, and nothing is late."""

    def __init__(self) -> None:
        self.count: int = 0
        self.behind: float = 0.0
        self._period: float = 0.0
        self._began: float = 0.0
        self._parts: dict[str, tuple[str, float]] = {}
        self._said_at: int = _FIRST_WORD

    def began(self, period: float, now: float) -> None:
        """A frame begins that should take a period, in seconds."""
        self._period, self._began, self._parts = period, now, {}

    def heard(self, part: str, member: str, now: float) -> None:
        """A member has answered in a part of the frame."""
        if self._period:
            self._parts[part] = member, now

    def done(self, frame: int, now: float) -> str:
        """A frame is over; what there is to say of it, ever more seldom, or the empty text."""
        took = now - self._began
        if not self._period or not frame or took <= _TOLERANCE * self._period:
            return ""
        self.count += 1
        self.behind += took - self._period
        if self.count < self._said_at:
            return ""
        self._said_at *= 2
        return (
            f"frame {frame} took {took:.3f} s instead of {self._period:.3f} s{self._lasts()};"
            f" {self.count} frames were late so far, by {self.behind:.1f} s altogether"
        )

    def figures(self) -> dict[str, int | float]:
        """For the summary of a run; nothing where no frame was late."""
        if not self.count:
            return {}
        return {"late_frames": self.count, "seconds_behind": round(self.behind, 3)}

    def _lasts(self) -> str:
        """Who was the last one in each part, and how long the part took."""
        shown: list[str] = []
        since = self._began
        for part, (member, at) in self._parts.items():
            shown.append(f"{part} {at - since:.3f} s, {member} the last")
            since = at
        return f" ({'; '.join(shown)})" if shown else ""
