"""Where simultaneously moving bodies stop one another, and when a disc touches a segment.

All moves of a frame last from time 0 to 1 at constant speeds. Contacts are processed in the order
of time, so nothing tunnels through anything however long a move is, and no body is favoured by its
name. A body that drives into another stops; the other continues. `contacts` tells where each body
touches what stopped it.

The time at which a moving disc touches a segment has a closed form: the disc shrinks to its centre
and the segment grows by the disc's radius (`reach`) to a capsule, two discs and a slab. The
distance to a segment is convex along a line, so a point that does not approach at the start never
will: a touching body can always leave or slide along.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Final, TypeAlias

from minerva_bus import portable
from minerva_bus.values import fast_dataclass

Point: TypeAlias = tuple[float, float]
Segment: TypeAlias = tuple[float, float, float, float]

NEVER: Final = math.inf

TOLERANCE: Final = 1e-9
"""Overlap in metres that counts as touching: far above rounding, far below anything visible."""

TOUCH: Final = 1e-9
"""Metres between a line and a wall that count as touching.

On a map of cells, robots often stand and look exactly along the edges of walls and at their
corners. Rounding would decide there otherwise, and differ between two simulations of one robot.
"""


def contact(start: Point, move: Point, wall: Segment, reach: float) -> float:
    """Fraction of a move at which a disc is stopped by a segment.

    Args:
        start: the disc's centre in metres.
        move: its displacement in metres.
        wall: `ax, ay, bx, by` in metres; a point (another disc's centre) if both ends are equal.
        reach: distance at which the two touch, in metres.

    Returns:
        0 to 1, or `NEVER` if the move never penetrates deeper than `TOLERANCE`. Without this
          tolerance, rounding would stop a disc that slides along a wall at the joint of two
          segments.

    """
    # A move is stopped only if it would penetrate deeper than the tolerance, but then at the
    # surface.
    deep = _entry(start, move, wall, reach - TOLERANCE)
    return deep if deep == NEVER else min(deep, _entry(start, move, wall, reach))


def offset(point: Point, wall: Segment) -> Point:
    """Vector in metres from the nearest point of a segment to a point."""
    ax, ay, bx, by = wall
    px, py, lx, ly = point[0] - ax, point[1] - ay, bx - ax, by - ay
    square = lx * lx + ly * ly
    part = min(1.0, max(0.0, (px * lx + py * ly) / square)) if square else 0.0
    return px - part * lx, py - part * ly


def meeting(start: Point, end: Point, wall: Segment) -> float | None:
    """Fraction of a line at which it crosses a wall or touches one of its ends, if it does.

    Args:
        start: the line's beginning in metres.
        end: its end.
        wall: `ax, ay, bx, by` in metres.

    """
    x, y = end[0] - start[0], end[1] - start[1]
    ax, ay, bx, by = wall[0] - start[0], wall[1] - start[1], wall[2] - start[0], wall[3] - start[1]
    square = x * x + y * y
    # Distances from the line of both ends, times its length.
    a, b = x * ay - y * ax, x * by - y * bx
    near = [
        (x * to_x + y * to_y) / square
        for across, to_x, to_y in ((a, ax, ay), (b, bx, by))
        if across * across <= TOUCH * TOUCH * square
    ]
    if a * b < 0:
        near.append((ax * by - ay * bx) / (b - a))
    return min((part for part in near if 0 <= part <= 1), default=None)


def _entry(start: Point, move: Point, wall: Segment, reach: float) -> float:
    """Fraction of the move at which a point enters the capsule, or `NEVER`."""
    away = offset(start, wall)
    # Already in contact: only a move into the wall is stopped.
    if portable.hypot(*away) < reach:
        return 0.0 if away[0] * move[0] + away[1] * move[1] < 0 else NEVER
    return min(
        _disc_entry(start, move, wall[:2], reach),
        _disc_entry(start, move, wall[2:], reach),
        _side_entry(start, move, wall, reach),
    )


def _disc_entry(start: Point, move: Point, centre: Point, reach: float) -> float:
    x, y = start[0] - centre[0], start[1] - centre[1]
    approach = -(x * move[0] + y * move[1])
    if approach <= 0:
        return NEVER
    gap = x * x + y * y - reach * reach
    root = approach * approach - (move[0] * move[0] + move[1] * move[1]) * gap
    if root < 0:
        return NEVER
    # The smaller root, in the form that avoids cancellation.
    return _within_move(gap / (approach + math.sqrt(root)))


def _side_entry(start: Point, move: Point, wall: Segment, reach: float) -> float:
    ax, ay, bx, by = wall
    length = portable.hypot(bx - ax, by - ay)
    if length == 0:
        return NEVER
    ux, uy = (bx - ax) / length, (by - ay) / length
    x, y = start[0] - ax, start[1] - ay
    height, climb = ux * y - uy * x, ux * move[1] - uy * move[0]
    # Mirror the problem, so that the start always lies above the wall.
    if height < 0:
        height, climb = -height, -climb
    if climb >= 0:
        return NEVER
    part = max(0.0, (height - reach) / -climb)  # rounding may put height below reach
    along = (x + part * move[0]) * ux + (y + part * move[1]) * uy
    # The slab covers the segment itself; beyond its ends, `_disc_entry` decides.
    return _within_move(part) if 0 <= along <= length else NEVER


def _within_move(part: float) -> float:
    return max(0.0, part) if part <= 1 else NEVER


@fast_dataclass
class MovingDisc:
    """A disc and its intended displacement.

    Attributes:
        start: centre at time 0 in metres.
        move: displacement until time 1 in metres; (0, 0) at rest.
        radius: in metres.

    """

    start: Point
    move: Point
    radius: float

    def at(self, time: float) -> Point:
        """Centre in metres at a time from 0 to 1."""
        return self.start[0] + self.move[0] * time, self.start[1] + self.move[1] * time


def settle(
    courses: Mapping[str, MovingDisc],
    walls: Mapping[str, float],
    pairs: Iterable[tuple[str, str]],
) -> tuple[dict[str, float], dict[str, str]]:
    """The time at which each body stops, and which body stopped it, if any.

    Args:
        courses: moving discs by name.
        walls: the time (0 to 1) at which walls stop each body, or 1.
        pairs: names of bodies that may come close to each other.

    Returns:
        Times from 0 to 1 by name, 1 for a completed move; and names of stopping bodies by name.

    """
    ends, stopped_by = dict(walls), dict[str, str]()
    near: dict[str, list[str]] = {}
    queue: list[tuple[float, str, str]] = []
    # `pairs` may be a set, whose order depends on the hash seed.
    for first, second in sorted(pairs):
        near.setdefault(first, []).append(second)
        near.setdefault(second, []).append(first)
        _enqueue(queue, first, second, courses, ends)
    while queue:
        time, first, second = heapq.heappop(queue)
        # A contact that changed since it was queued has been queued again, so skip the stale entry.
        if time != _meeting(courses[first], ends[first], courses[second], ends[second]):
            continue
        for name in _stopped(time, first, second, courses, ends):
            ends[name], stopped_by[name] = time, second if name == first else first
            # A stopped body may be met later, or no longer: recompute its other contacts.
            for neighbour in near[name]:
                _enqueue(queue, min(name, neighbour), max(name, neighbour), courses, ends)
    return ends, stopped_by


def _enqueue(
    queue: list[tuple[float, str, str]],
    first: str,
    second: str,
    courses: Mapping[str, MovingDisc],
    ends: Mapping[str, float],
) -> None:
    time = _meeting(courses[first], ends[first], courses[second], ends[second])
    if time != NEVER:
        heapq.heappush(queue, (time, first, second))


def _meeting(first: MovingDisc, end: float, second: MovingDisc, other_end: float) -> float:
    """The first time at which two bodies, each moving until its end, collide."""
    # The relative velocity is constant until the first body stops, and until the second does.
    both_move, first_moves = sorted((end, other_end))
    time = _contact_between(0.0, both_move, first, end, second, other_end)
    if time != NEVER:
        return time
    return _contact_between(both_move, first_moves, first, end, second, other_end)


def _contact_between(
    begin: float, finish: float, first: MovingDisc, end: float, second: MovingDisc, other_end: float
) -> float:
    """The time of contact in an interval in which neither body changes its speed."""
    x, y = _between(first.at(min(begin, end)), second.at(min(begin, other_end)))
    later_x, later_y = _between(first.at(min(finish, end)), second.at(min(finish, other_end)))
    # In the second body's frame it is a point at rest, and the first moves past it.
    part = contact((x, y), (later_x - x, later_y - y), (0, 0, 0, 0), first.radius + second.radius)
    return begin + part * (finish - begin) if part != NEVER else NEVER


def _between(here: Point, there: Point) -> Point:
    return here[0] - there[0], here[1] - there[1]


def _stopped(
    time: float,
    first: str,
    second: str,
    courses: Mapping[str, MovingDisc],
    ends: Mapping[str, float],
) -> list[str]:
    """Which of two bodies in contact still moves towards the other."""
    here = courses[first].at(min(time, ends[first]))
    there = courses[second].at(min(time, ends[second]))
    apart = portable.dist(here, there)
    toward = (there[0] - here[0]) / apart, (there[1] - here[1]) / apart
    pushes = {
        first: _dot(courses[first].move, toward) if time < ends[first] else 0.0,
        second: -_dot(courses[second].move, toward) if time < ends[second] else 0.0,
    }
    # In a grazing contact rounding may leave both pushes within the tolerance. The stronger one
    # then stops, or the bodies would overlap.
    strongest = max(pushes.values())
    return [
        name
        for name, push in pushes.items()
        if time < ends[name] and (push > TOLERANCE or push == strongest)
    ]


def _dot(first: Point, second: Point) -> float:
    return first[0] * second[0] + first[1] * second[1]


WallsNear: TypeAlias = Callable[[Point, Point, float], Iterable[Segment]]

_MAX_GAP: Final = 1e-6
"""Maximum gap in metres between a body and the wall that stopped it, due to rounding."""


@fast_dataclass
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
    # The index returns walls in an arbitrary order; sorting makes ties in `min` reproducible.
    ways = [offset(at, wall) for wall in sorted(near)]
    touched = [way for way in ways if 0 < portable.hypot(*way) <= here.radius + _MAX_GAP]
    ahead = min(
        touched,
        key=lambda way: (way[0] * dx + way[1] * dy) / portable.hypot(*way),
        # Rounding may leave no wall within reach; the normal then opposes the move.
        default=(-dx, -dy),
    )
    return _contact("", at, here, ahead)


def _contact(other: str, at: Point, here: MovingDisc, way: Point) -> Contact:
    length = portable.hypot(*way)
    nx, ny = (way[0] / length, way[1] / length) if length else (1.0, 0.0)
    return Contact(other, at[0] - nx * here.radius, at[1] - ny * here.radius, nx, ny)
