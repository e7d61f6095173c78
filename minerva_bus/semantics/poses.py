"""Poses in the plane: metres, and degrees counter-clockwise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from minerva_bus import portable

Point: TypeAlias = tuple[float, float]


class HasPose(Protocol):
    """Anything with a pose: x and y in metres, angle in degrees."""

    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def angle(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Pose:
    """A position in metres and a heading in degrees, relative to a frame of reference."""

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0

    def then(self, x: float, y: float, turn: float = 0.0, forward: float = 0.0) -> Pose:
        """Shift by (x, y) along this pose's own axes, turn, and go forward.

        The angle is the sum of the turns: it may leave the range from -180 to 180.
        """
        cos, sin = portable.cos_sin(math.radians(self.angle))
        angle = self.angle + turn
        along, across = portable.cos_sin(math.radians(angle))
        return Pose(
            self.x + x * cos - y * sin + forward * along,
            self.y + x * sin + y * cos + forward * across,
            angle,
        )

    def point(self, x: float, y: float) -> Point:
        """Coordinates in the outer frame of a point that is given along this pose's axes."""
        there = self.then(x, y)
        return there.x, there.y

    def compose(self, inner: HasPose) -> Pose:
        """The pose in the outer frame of a pose that is relative to this one."""
        cos, sin = portable.cos_sin(math.radians(self.angle))
        x, y = self.x + inner.x * cos - inner.y * sin, self.y + inner.x * sin + inner.y * cos
        # The remainder is exact in IEEE 754, so it is portable.
        return Pose(x, y, math.remainder(self.angle + inner.angle, 360.0))

    def seen(self, other: HasPose) -> Pose:
        """Another pose of the outer frame relative to this one; the inverse of `compose`."""
        cos, sin = portable.cos_sin(math.radians(self.angle))
        x, y = other.x - self.x, other.y - self.y
        angle = math.remainder(other.angle - self.angle, 360.0)
        return Pose(x * cos + y * sin, y * cos - x * sin, angle)


def interpolated(begin: HasPose, end: HasPose, part: float) -> Pose:
    """The pose on the line between two poses, at 0 the first and at 1 the second.

    The angle turns the shorter way, and may leave the range from -180 to 180.
    """
    turn = math.remainder(end.angle - begin.angle, 360.0)
    return Pose(
        begin.x + part * (end.x - begin.x),
        begin.y + part * (end.y - begin.y),
        begin.angle + part * turn,
    )
