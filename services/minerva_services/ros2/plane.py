"""Places and headings in the plane, seen from one another."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minerva_bus import portable


@dataclass(frozen=True, slots=True)
class Pose:
    """A place in metres and a heading in degrees, counter-clockwise, within another frame."""

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0

    def then(self, inner: Pose) -> Pose:
        """The pose, in this one's outer frame, of a pose that is given within this one."""
        cos, sin = portable.cos(math.radians(self.angle)), portable.sin(math.radians(self.angle))
        x, y = self.x + inner.x * cos - inner.y * sin, self.y + inner.x * sin + inner.y * cos
        return Pose(x, y, wrapped(self.angle + inner.angle))

    def seen(self, other: Pose) -> Pose:
        """A pose of the same outer frame as it is seen from this one."""
        cos, sin = portable.cos(math.radians(self.angle)), portable.sin(math.radians(self.angle))
        x, y = other.x - self.x, other.y - self.y
        return Pose(x * cos + y * sin, y * cos - x * sin, wrapped(other.angle - self.angle))


def wrapped(angle: float) -> float:
    """The same direction in [-180, 180)."""
    return (angle + 180.0) % 360.0 - 180.0
