"""Poses in the plane: metres, and degrees counter-clockwise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from minerva_bus import portable


class HasPose(Protocol):
    """Whatever has a pose."""

    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def angle(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Pose:
    """A place in metres and a heading in degrees, within another frame of reference."""

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0

    def then(self, inner: HasPose) -> Pose:
        """The pose, in this one's outer frame, of a pose that is given within this one."""
        turn = math.radians(self.angle)
        cos, sin = portable.cos(turn), portable.sin(turn)
        x, y = self.x + inner.x * cos - inner.y * sin, self.y + inner.x * sin + inner.y * cos
        return Pose(x, y, math.remainder(self.angle + inner.angle, 360.0))

    def seen(self, other: HasPose) -> Pose:
        """A pose of the same outer frame as seen from this one: metres ahead and to the left."""
        turn = math.radians(self.angle)
        cos, sin = portable.cos(turn), portable.sin(turn)
        x, y = other.x - self.x, other.y - self.y
        angle = math.remainder(other.angle - self.angle, 360.0)
        return Pose(x * cos + y * sin, y * cos - x * sin, angle)


def interpolated(begin: HasPose, end: HasPose, part: float) -> Pose:
    """The pose on the line through two others, 0 at the first and 1 at the second.

    The angle takes the shorter way, and may leave the range from -180 to 180.
    """
    turn = math.remainder(end.angle - begin.angle, 360.0)
    return Pose(
        begin.x + part * (end.x - begin.x),
        begin.y + part * (end.y - begin.y),
        begin.angle + part * turn,
    )


def moved(start: HasPose, before: HasPose, after: HasPose) -> Pose:
    """The pose after the motion from one pose to another, begun at `start` instead."""
    east, north = after.x - before.x, after.y - before.y
    turn = math.radians(start.angle - before.angle)
    return Pose(
        start.x + portable.cos(turn) * east - portable.sin(turn) * north,
        start.y + portable.sin(turn) * east + portable.cos(turn) * north,
        start.angle + math.remainder(after.angle - before.angle, 360.0),
    )
