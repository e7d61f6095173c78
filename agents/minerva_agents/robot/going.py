"""From one place to another, and the same step from somewhere else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from minerva_bus import portable


class Placed(Protocol):
    """Whatever is somewhere: metres and degrees."""

    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def angle(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Place:
    """Somewhere: metres and degrees."""

    x: float
    y: float
    angle: float


def gone(start: Placed, before: Placed, after: Placed) -> Place:
    """Where one comes to from a start who moves as from one place to another."""
    east, north = after.x - before.x, after.y - before.y
    turn = math.radians(start.angle - before.angle)
    return Place(
        start.x + portable.cos(turn) * east - portable.sin(turn) * north,
        start.y + portable.sin(turn) * east + portable.cos(turn) * north,
        start.angle + math.remainder(after.angle - before.angle, 360.0),
    )
