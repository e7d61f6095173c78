"""When the next frame may begin: real time as a thin wrap round a pure step."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Pace:
    """Frames per second; 0 means as fast as it goes. Times are seconds of one monotonic clock."""

    rate: float = 0.0
    _next: float | None = None

    def due(self, now: float) -> float:
        """When the next frame is due, given that the one before has ended.

        A frame that came late does not make the following ones hurry: the rhythm starts anew.
        """
        if self.rate <= 0:
            return now
        period = 1.0 / self.rate
        if self._next is None or self._next + period < now:
            self._next = now
        else:
            self._next += period
        return self._next
