"""Pacing: when the next frame may begin, outside the pure frame algorithm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

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
        due = tuple(
            [name for name in sorted(rates) if everything or self._is_due(name, now, rates[name])]
        )
        for event_type in due:
            self._last[event_type] = now
        return due

    def next(self, rates: Mapping[str, float]) -> float:
        """Time at which the next of these views is due."""
        return min((self._next(name, rate) for name, rate in rates.items()), default=float("inf"))

    def _is_due(self, event_type: str, now: float, rate: float) -> bool:
        return now >= self._next(event_type, rate)

    def _next(self, event_type: str, rate: float) -> float:
        # Slightly early, because a frame that begins just before would delay the view by a frame.
        return self._last.get(event_type, float("-inf")) + 0.95 / rate
