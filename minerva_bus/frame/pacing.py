"""When the next frame may begin: real time as a thin wrap round a pure step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

REST: Final = 0.1
"""Seconds between two frames in which nothing happens, of a world that goes as fast as it can."""


@dataclass(slots=True)
class Pace:
    """Frames per second; 0 means as fast as it goes. Times are seconds of one monotonic clock.

    `left` is how many frames may still begin; None: any number.
    """

    rate: float = 0.0
    left: int | None = None
    _next: float | None = None

    @property
    def paused(self) -> bool:
        """Whether no frame may begin."""
        return self.left == 0

    def due(self, now: float) -> float | None:
        """When the next frame is due, given that the one before has ended; None while paused.

        A frame that came late does not make the following ones hurry: the rhythm starts anew.
        """
        if self.paused:
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
        """Until when the world may rest if nothing happens, its `last` frame having ended then.

        `view` is when one by the clock is due. A world with a rhythm of its own never rests.
        """
        return min(last + REST, view) if self.rate <= 0 and self.left is None else last

    def began(self) -> None:
        """A frame has begun."""
        if self.left:
            self.left -= 1

    def pause(self) -> None:
        """Let no frame begin any more."""
        self.left = 0

    def resume(self) -> None:
        """Let any number of frames begin."""
        self.left = None

    def step(self, frames: int) -> None:
        """Let so many more frames begin."""
        self.left = frames + (self.left or 0)

    def change(self, rate: float) -> None:
        """Begin so many frames a second from now on."""
        self.rate, self._next = rate, None


@dataclass(slots=True)
class Glances:
    """Which devices that want views by the clock are due one."""

    _last: dict[str, float] = field(default_factory=dict[str, float])

    def due(self, now: float, rates: Mapping[str, float]) -> tuple[str, ...]:
        """The visual event types of which a view is due in a frame that begins now."""
        due = tuple([one for one in sorted(rates) if self._is_due(one, now, rates[one])])
        for event_type in due:
            self._last[event_type] = now
        return due

    def next(self, rates: Mapping[str, float]) -> float:
        """When the first of these views is due."""
        return min((self._next(one, rate) for one, rate in rates.items()), default=float("inf"))

    def _is_due(self, event_type: str, now: float, rate: float) -> bool:
        return now >= self._next(event_type, rate)

    def _next(self, event_type: str, rate: float) -> float:
        return self._last.get(event_type, float("-inf")) + 0.95 / rate
