"""Where and by what a body was stopped: what is told of a collision beside its cost."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from minerva_bus import portable
from minerva_services.physics.encounters import Course
from minerva_services.physics.sweep import Point, Segment, offset

WallsNear: TypeAlias = Callable[[Point, Point, float], Iterable[Segment]]

_REACH: Final = 1e-6
"""Metres by which rounding may keep a body from a wall that stops it."""


@dataclass(frozen=True, slots=True)
class Contact:
    """The place at which a body touches what has stopped it.

    Attributes:
        other: the body that stopped it; "" for a wall.
        x: in metres.
        y: in metres.
        nx: of the normal, which has length 1 and points to the body that was stopped.
        ny: likewise.

    """

    other: str
    x: float
    y: float
    nx: float
    ny: float


def contacts(
    courses: Mapping[str, Course],
    driven: Iterable[str],
    ends: Mapping[str, float],
    stopped_by: Mapping[str, str],
    walls_near: WallsNear,
) -> dict[str, Contact]:
    """What each body touches that was stopped: the body that did it, or else a wall.

    Args:
        courses: by name, of all bodies.
        driven: names of those that wanted to go somewhere.
        ends: the part of its move, 0 to 1, that each made.
        stopped_by: the body that stopped it, of those that a body has stopped.
        walls_near: the walls that reach into the box around two points, grown by metres.

    """
    found: dict[str, Contact] = {}
    for name in driven:
        here, other, end = courses[name], stopped_by.get(name), ends[name]
        if other is not None:
            found[name] = _with_body(other, here, courses[other], end, ends[other])
        elif end < 1:
            at = here.at(end)
            found[name] = _with_wall(here, end, walls_near(at, at, 2 * here.radius))
    return found


def _with_body(name: str, here: Course, there: Course, end: float, other_end: float) -> Contact:
    """The contact of a body whose move ended at a time with one that moved until another time."""
    at, other = here.at(end), there.at(min(end, other_end))
    return _contact(name, at, here, (at[0] - other[0], at[1] - other[1]))


def _with_wall(here: Course, end: float, near: Iterable[Segment]) -> Contact:
    """The contact of a body whose move a wall ended: of the walls in reach that most ahead."""
    at, (dx, dy) = here.at(end), here.move
    ways = [offset(at, wall) for wall in sorted(near)]
    touched = [way for way in ways if 0 < portable.hypot(*way) <= here.radius + _REACH]
    ahead = min(
        touched,
        key=lambda way: (way[0] * dx + way[1] * dy) / portable.hypot(*way),
        default=(-dx, -dy),
    )
    return _contact("", at, here, ahead)


def _contact(other: str, at: Point, here: Course, way: Point) -> Contact:
    length = portable.hypot(*way)
    nx, ny = (way[0] / length, way[1] / length) if length else (1.0, 0.0)
    return Contact(other, at[0] - nx * here.radius, at[1] - ny * here.radius, nx, ny)
