"""Time budgets of commands that keep frames at their nominal duration.

Times are seconds of a monotonic clock passed in by the caller, so this module reads no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_FORGIVEN: Final = 5.0
"""Delay in frames up to which the schedule is kept; beyond it, it restarts."""


@dataclass(slots=True)
class FramePacer:
    """When the current command should end.

    The time that the world needs between two commands, to measure, decide and distribute, counts
    towards the second: meanwhile the robot still drives towards the end of the first.
    """

    due: float = -math.inf

    def begin(self, seconds: float, now: float) -> float:
        """The time left for a command that begins now, of its nominal duration."""
        late = now - self.due
        self.due = max(self.due + seconds, now) if late < _FORGIVEN * seconds else now + seconds
        return self.due - now
