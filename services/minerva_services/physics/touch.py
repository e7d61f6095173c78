"""Contact points of stopped bodies: where, and by what."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from minerva_bus import portable
from minerva_services.physics.encounters import MovingDisc
from minerva_services.physics.sweep import Point, Segment, offset

WallsNear: TypeAlias = Callable[[Point, Point, float], Iterable[Segment]]

_REACH: Final = 1e-6
"""Maximum gap in metres between a body and the wall that stopped it, due to rounding."""


@dataclass(frozen=True, slots=True)
class Contact:
    """The point at which a body touches what stopped it.

    Attributes:
        other: the body that stopped it; "" for a wall.
        x: in metres.
        y: in metres.
        nx: unit normal, pointing to the stopped body.
        ny: likewise.

    """

    other: str
    x: float
    y: float
    nx: float
    ny: float


def contacts(
    courses: Mapping[str, MovingDisc],
    driven: Iterable[str],
    ends: Mapping[str, float],
    stopped_by: Mapping[str, str],
    walls_near: WallsNear,
) -> dict[str, Contact]:
    """The contact of each stopped body: with the body that stopped it, or else with a wall.

    Args:
        courses: moving discs of all bodies, by name.
        driven: names of the bodies that were commanded to move.
        ends: fraction of its move, 0 to 1, that each body completed.
        stopped_by: the body that stopped it, if it was a body.
        walls_near: walls that overlap the box of two points, grown by metres.

    """
    result: dict[str, Contact] = {}
    for name in driven:
        here, other, end = courses[name], stopped_by.get(name), ends[name]
        if other is not None:
            result[name] = _with_body(other, here, courses[other], end, ends[other])
        elif end < 1:
            at = here.at(end)
            result[name] = _with_wall(here, end, walls_near(at, at, 2 * here.radius))
    return result


def _with_body(
    name: str, here: MovingDisc, there: MovingDisc, end: float, other_end: float
) -> Contact:
    """The contact of a stopped body with another that moved until `other_end`."""
    at, other = here.at(end), there.at(min(end, other_end))
    return _contact(name, at, here, (at[0] - other[0], at[1] - other[1]))


def _with_wall(here: MovingDisc, end: float, near: Iterable[Segment]) -> Contact:
    """The contact of a body with the wall in reach that lies most directly ahead."""
    at, (dx, dy) = here.at(end), here.move
    ways = [offset(at, wall) for wall in sorted(near)]
    touched = [way for way in ways if 0 < portable.hypot(*way) <= here.radius + _REACH]
    ahead = min(
        touched,
        key=lambda way: (way[0] * dx + way[1] * dy) / portable.hypot(*way),
        default=(-dx, -dy),
    )
    return _contact("", at, here, ahead)


def _contact(other: str, at: Point, here: MovingDisc, way: Point) -> Contact:
    length = portable.hypot(*way)
    nx, ny = (way[0] / length, way[1] / length) if length else (1.0, 0.0)
    return Contact(other, at[0] - nx * here.radius, at[1] - ny * here.radius, nx, ny)
