"""Where simultaneously moving bodies stop one another.

All moves of a frame last from time 0 to 1 at constant speeds. Contacts are processed in the order
of time, so nothing tunnels through anything however long a move is, and no body is favoured by its
name. A body that drives into another stops; the other continues.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from minerva_bus import portable
from minerva_services.physics.sweep import NEVER, SLACK, Point, contact


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
    strongest = max(pushes.values())
    return [
        name
        for name, push in pushes.items()
        if time < ends[name] and (push > SLACK or push == strongest)
    ]


def _dot(first: Point, second: Point) -> float:
    return first[0] * second[0] + first[1] * second[1]
