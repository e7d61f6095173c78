"""Where bodies that move at the same time stop one another.

All moves of a frame take the same time, from 0 to 1, each at a constant speed. Meetings are dealt
with in the order of their time, so nothing passes through anything however long a move is, and no
body is favoured for its name. Who drives into the other stops; who is driven into goes on.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from minerva_bus import portable
from minerva_services.physics.sweep import NEVER, SLACK, Point, contact


@dataclass(frozen=True, slots=True)
class Course:
    """A disc and where it wants to go.

    Attributes:
        start: the centre at time 0 in metres.
        move: the displacement until time 1 in metres; (0, 0) for one that stands.
        radius: in metres.

    """

    start: Point
    move: Point
    radius: float

    def at(self, time: float) -> Point:
        """The centre in metres at a time from 0 to 1."""
        return self.start[0] + self.move[0] * time, self.start[1] + self.move[1] * time


def settle(
    courses: Mapping[str, Course],
    walls: Mapping[str, float],
    pairs: Iterable[tuple[str, str]],
) -> tuple[dict[str, float], dict[str, str]]:
    """The time at which each body stops, and by whom those are stopped that meet another one.

    Args:
        courses: by name.
        walls: the time (0 to 1) at which walls would stop each body, or 1.
        pairs: the names of those that may come near one another.

    Returns:
        Times from 0 to 1 by name, 1 where a move is not stopped; and names by name.

    """
    ends, stopped_by = dict(walls), dict[str, str]()
    near: dict[str, list[str]] = {}
    queue: list[tuple[float, str, str]] = []
    for one, other in sorted(pairs):
        near.setdefault(one, []).append(other)
        near.setdefault(other, []).append(one)
        _enqueue(queue, one, other, courses, ends)
    while queue:
        time, one, other = heapq.heappop(queue)
        # A meeting that no longer is as it was queued has been queued again as it is now.
        if time != _meeting(courses[one], ends[one], courses[other], ends[other]):
            continue
        for name in _stopped(time, one, other, courses, ends):
            ends[name], stopped_by[name] = time, other if name == one else one
            for neighbour in near[name]:
                _enqueue(queue, min(name, neighbour), max(name, neighbour), courses, ends)
    return ends, stopped_by


def _enqueue(
    queue: list[tuple[float, str, str]],
    one: str,
    other: str,
    courses: Mapping[str, Course],
    ends: Mapping[str, float],
) -> None:
    time = _meeting(courses[one], ends[one], courses[other], ends[other])
    if time != NEVER:
        heapq.heappush(queue, (time, one, other))


def _meeting(one: Course, end: float, other: Course, other_end: float) -> float:
    """The first time at which two bodies, each moving until its end, press on one another."""
    both_move, one_moves = sorted((end, other_end))
    time = _contact_between(0.0, both_move, one, end, other, other_end)
    if time != NEVER:
        return time
    return _contact_between(both_move, one_moves, one, end, other, other_end)


def _contact_between(
    begin: float, finish: float, one: Course, end: float, other: Course, other_end: float
) -> float:
    """The time of contact in a span of time in which neither body changes its speed."""
    x, y = _between(one.at(min(begin, end)), other.at(min(begin, other_end)))
    later_x, later_y = _between(one.at(min(finish, end)), other.at(min(finish, other_end)))
    part = contact((x, y), (later_x - x, later_y - y), (0, 0, 0, 0), one.radius + other.radius)
    return begin + part * (finish - begin) if part != NEVER else NEVER


def _between(here: Point, there: Point) -> Point:
    return here[0] - there[0], here[1] - there[1]


def _stopped(
    time: float,
    one: str,
    other: str,
    courses: Mapping[str, Course],
    ends: Mapping[str, float],
) -> list[str]:
    """Who of two that meet still moves, and moves towards the other."""
    here = courses[one].at(min(time, ends[one]))
    there = courses[other].at(min(time, ends[other]))
    apart = portable.dist(here, there)
    toward = (there[0] - here[0]) / apart, (there[1] - here[1]) / apart
    pushes = {
        one: _dot(courses[one].move, toward) if time < ends[one] else 0.0,
        other: -_dot(courses[other].move, toward) if time < ends[other] else 0.0,
    }
    strongest = max(pushes.values())
    return [
        name
        for name, push in pushes.items()
        if time < ends[name] and (push > SLACK or push == strongest)
    ]


def _dot(one: Point, other: Point) -> float:
    return one[0] * other[0] + one[1] * other[1]
