"""Overruns: frames that take longer than real time, and the last member to answer in each.

Times are seconds of one monotonic clock; they are passed in, so that this module reads no clock.
"""

from __future__ import annotations

from typing import Final

from minerva_bus.frame.back_off import BackOff
from minerva_bus.frame.description import World

_TOLERANCE: Final = 1.1
"""Ratio of a frame's time to its period above which the frame is late."""

_FIRST_REPORT: Final = 5
"""Late frames before the first report."""


def real_period(rate: float, world: World) -> float:
    """Seconds that a frame may take at this frame rate; 0: any number."""
    if rate > 0:
        return 1.0 / rate
    return world.dt if world.real_time else 0.0


class Overruns:
    """The late frames of a world; with a period of 0 no frame is late."""

    def __init__(self) -> None:
        self.count: int = 0
        self.behind: float = 0.0
        self._period: float = 0.0
        self._began: float = 0.0
        self._parts: dict[str, tuple[str, float]] = {}
        self._took: dict[str, float] = {}
        self._reports = BackOff()

    def began(self, period: float, now: float) -> None:
        """Note the beginning of a frame that should take `period` seconds."""
        self._period, self._began = period, now
        self._parts, self._took = {}, {}

    def answered(self, part: str, member: str, now: float) -> None:
        """Note that a member has answered in a part of the frame."""
        if self._period:
            self._parts[part] = member, now

    @property
    def measures(self) -> bool:
        """Whether the frame has a period, so that times count."""
        return self._period > 0

    def took(self, member: str, seconds: float) -> None:
        """Note that a member has run for this time, if members run one after the other."""
        self._took[member] = self._took.get(member, 0.0) + seconds

    def done(self, frame: int, now: float) -> str:
        """Note the end of a frame; returns a report, with back-off, or an empty string."""
        elapsed = now - self._began
        if not self._period or not frame or elapsed <= _TOLERANCE * self._period:
            return ""
        self.count += 1
        self.behind += elapsed - self._period
        if self.count < _FIRST_REPORT or not self._reports.is_due(now):
            return ""
        return (
            f"frame {frame} took {elapsed:.3f} s instead of {self._period:.3f} s{self._lasts()};"
            f" {self.count} frames were late so far, by {self.behind:.1f} s altogether"
        )

    def figures(self) -> dict[str, int | float]:
        """Figures for the summary of a run; empty if no frame was late."""
        if not self.count:
            return {}
        return {"late_frames": self.count, "seconds_behind": round(self.behind, 3)}

    def _lasts(self) -> str:
        """The last member in each part of the frame, and the duration of the part.

        If members run one after the other, the last one may not be the slow one.
        """
        shown: list[str] = []
        since = self._began
        for part, (member, at) in self._parts.items():
            shown.append(f"{part} {at - since:.3f} s, {member} the last")
            since = at
        if self._took:
            longest = max(self._took, key=lambda member: self._took[member])
            shown.append(f"{longest} took the longest, {self._took[longest]:.3f} s")
        return f" ({'; '.join(shown)})" if shown else ""
