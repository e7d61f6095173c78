"""When a region's frames and its repeated parcels are due, on the clock that all regions share."""

from __future__ import annotations

import time
from typing import Final

from minerva_bus.frame.pace import Pace
from minerva_bus.launch.in_process import STATUS_EVERY

AGAIN_SECONDS: Final = 1.0
"""Time after which parcels are sent again to regions that are still awaited."""


class RegionTimes:
    """When frames are due and were completed, on the monotonic clock, seconds."""

    def __init__(self, rate: float) -> None:
        self.due = 0.0
        self.first_at: float | None = None
        self.last_at = 0.0
        self.again_at = 0.0
        self._pace = Pace(rate)
        self._shown_at = 0.0

    def plan(self, *, resting: bool) -> None:
        """Plan the next frame; at rest, frames are as rare as with one coordinator."""
        now = time.monotonic()
        self.due = self._pace.due(now) or now
        if resting:
            self.due = max(self.due, self._pace.rest(self.last_at, float("inf")))

    def completed(self) -> bool:
        """Note the end of a frame; whether a report is due."""
        now = self.last_at = time.monotonic()
        self.first_at = now if self.first_at is None else self.first_at
        self.again()
        is_due = now - self._shown_at >= STATUS_EVERY
        self._shown_at = now if is_due else self._shown_at
        return is_due

    def again(self) -> float:
        """Seconds until parcels are sent again, from now on."""
        self.again_at = time.monotonic() + AGAIN_SECONDS
        return AGAIN_SECONDS
