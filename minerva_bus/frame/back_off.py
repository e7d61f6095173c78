"""When to report again what lasts: a log must not have a line for each frame."""

from __future__ import annotations

from math import inf
from typing import Final

_MIN_SECONDS: Final = 1.0
_MAX_SECONDS: Final = 60.0


class BackOff:
    """Reports with pauses that double from 1 s to 60 s; times are of one monotonic clock."""

    def __init__(self) -> None:
        self._next: float = -inf
        self._pause: float = _MIN_SECONDS

    def is_due(self, now: float) -> bool:
        """Whether to report now; then the next pause begins."""
        if now < self._next:
            return False
        self._next = now + self._pause
        self._pause = min(2 * self._pause, _MAX_SECONDS)
        return True
