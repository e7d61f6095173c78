"""Where simultaneously moving bodies stop one another.

All moves of a frame last from time 0 to 1 at constant speeds. Contacts are processed in the order
of time, so nothing tunnels through anything however long a move is, and no body is favoured by its
name. A body that drives into another stops; the other continues. `contacts` tells where each body
touches what stopped it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from minerva_bus import portable
from minerva_services.physics.sweep import NEVER, TOLERANCE, Point, Segment, contact, offset


@dataclass(frozen=True, slots=True)
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
