"""How long a command has, so that frames last as long as they should though the world takes time.

Times are seconds of one monotonic clock that is passed in, so there is no clock in here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_FORGIVEN: Final = 5.0
"""Frames by which a world may be late and still go by the same rhythm: later it has rested."""


@dataclass(slots=True)
class Rhythm:
    """When the command that is under way should be over.

    What the world needs between two commands, to measure, decide and tell, is time of the second
    one: the robot still drives on towards the end of the first.
    """

    due: float = -math.inf

    def begin(self, seconds: float, now: float) -> float:
        """The seconds that are left of those of a command which begins now."""
        late = now - self.due
        self.due = max(self.due + seconds, now) if late < _FORGIVEN * seconds else now + seconds
        return self.due - now
