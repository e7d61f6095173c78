"""Pace of frames: when the next frame may begin, and which frames were late.

All of it is outside the pure frame algorithm. Times are seconds of one monotonic clock; they are
passed in, so that this module reads no clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.wording import BackOff

REST_SECONDS: Final = 0.1
"""Interval between frames without changes, of a world that runs as fast as possible."""


@dataclass(slots=True)
class Pace:
    """Frames per second; 0: as fast as possible. Times are seconds of one monotonic clock.

    `left`: number of frames that may still begin; None: any number.
    """

    rate: float = 0.0
    left: int | None = None
    _next: float | None = None

    @property
    def paused(self) -> bool:
        """Whether no frame may begin."""
        return self.left == 0

    def due(self, now: float) -> float | None:
        """Time at which the next frame is due after the end of the previous one; None while paused.

        After a late frame the rhythm starts again; the following frames do not catch up.
        """
        if self.paused:
            # A pause is not a delay: the rhythm starts again after it.
            self._next = None
            return None
        if self.rate <= 0:
            return now
        period = 1.0 / self.rate
        if self._next is None or self._next + period < now:
            self._next = now
        else:
            self._next += period
        return self._next

    def rest(self, last: float, view: float) -> float:
        """Time until which the world may rest without changes; `last` is the end of its last frame.

        `view` is the time of the next view by the clock. A world with a frame rate never rests.
        """
        return min(last + REST_SECONDS, view) if self.rate <= 0 and self.left is None else last

    def began(self) -> None:
        """Note that a frame has begun."""
        if self.left:
            self.left -= 1

    def pause(self, after: int = 0) -> None:
        """Pause: only this number of further frames may begin."""
        self.left = after

    def resume(self) -> None:
        """Allow any number of frames."""
        self.left = None

    def step(self, frames: int) -> None:
        """Allow this number of further frames."""
        self.left = frames + (self.left or 0)

    def change(self, rate: float) -> None:
        """Set the number of frames per second."""
        self.rate, self._next = rate, None


@dataclass(slots=True)
class ViewClock:
    """Times of the views for devices with a view rate."""

    _last: dict[str, float] = field(default_factory=dict[str, float])

    def due(
        self, now: float, rates: Mapping[str, float], *, everything: bool = False
    ) -> tuple[str, ...]:
        """The visual event types of which a view is due in a frame that begins now."""
        names = [n for n in sorted(rates) if everything or now >= self._next(n, rates[n])]
        due = tuple(names)
        for event_type in due:
            self._last[event_type] = now
        return due

    def next(self, rates: Mapping[str, float]) -> float:
        """Time at which the next of these views is due."""
        return min((self._next(name, rate) for name, rate in rates.items()), default=float("inf"))

    def _next(self, event_type: str, rate: float) -> float:
        # Slightly early, because a frame that begins just before would delay the view by a frame.
        return self._last.get(event_type, float("-inf")) + 0.95 / rate


_TOLERANCE: Final = 1.1
"""Ratio of a frame's time to its period above which the frame is late."""

_FIRST_REPORT: Final = 5
"""Late frames before the first report."""


def real_period(rate: float, world: WorldSpec) -> float:
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
            shown.append(f"{part} {at - since:.3f} s until {member} answered")
            since = at
        if self._took:
            longest = max(self._took, key=lambda member: self._took[member])
            shown.append(f"{longest} took the longest, {self._took[longest]:.3f} s")
        return f" ({'; '.join(shown)})" if shown else ""
