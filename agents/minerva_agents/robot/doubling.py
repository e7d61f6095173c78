"""Walls that are drawn twice: a measure of a map's sanity.

Where a robot comes to a place again, each of two scans should see walls where the other does. One
that looks through the other's walls was put in the wrong place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from minerva_agents.robot.keyframes import (
    MIN_LOOP,
    between,
    keyframes_of,
    moved,
    poses_of,
    seen_through,
)
from minerva_bus.world.poses import Pose
from minerva_bus.world.readings import Scan

_AGAIN: Final = 1.5
"""Metres between two keyframes at one place."""

_THROUGH: Final = 0.3
"""The part of a scan's hits that may lie where another scan has looked through."""

_FEW: Final = 0.02
"""The part of places that may differ because of people and doors."""


@dataclass(frozen=True, slots=True)
class Doubled:
    """A place to which the robot came twice, and whose walls do not agree: metres, seconds."""

    x: float
    y: float
    first: float
    second: float


def doubled_walls(scans: Sequence[Scan], places: Sequence[Pose]) -> tuple[list[Doubled], int]:
    """Places whose walls a later visit saw elsewhere, and the number of places visited again."""
    keys = keyframes_of(scans, places)
    poses = poses_of([places[key.number] for key in keys])
    doubled, visits = [], 0
    way = np.array([key.way for key in keys])
    for later in range(0, len(keys), 2):
        before = np.flatnonzero(way <= way[later] - MIN_LOOP)
        if not len(before):
            continue
        apart = np.hypot(*(poses[before, :2] - poses[later, :2]).T)
        first = int(before[apart.argmin()])
        if apart.min() > _AGAIN:
            continue
        visits += 1
        step = between(poses[first], poses[later])
        through = max(
            seen_through(moved(keys[later].points, step), keys[first].reach),
            seen_through(moved(keys[first].points, between(step, np.zeros(3))), keys[later].reach),
        )
        if through > _THROUGH:
            x, y, _ = poses[later].tolist()
            times = [scans[keys[k].number].time - scans[0].time for k in (first, later)]
            doubled.append(Doubled(x, y, *times))
    return doubled, visits


def doubling_told(scans: Sequence[Scan], places: Sequence[Pose], poses: str) -> list[str]:
    """A line on walls that are drawn twice, if there are any, that says what to do."""
    doubled, visits = doubled_walls(scans, places)
    if len(doubled) < 2 or len(doubled) <= _FEW * visits:
        return []
    worst = doubled[0]
    advice = (
        "record more slowly, or leave a part out (--from, --to)"
        if poses == "matched"
        else "--poses matched finds where the robot was, and closes loops"
    )
    return [
        f"walls are drawn twice at {len(doubled)} of {visits} places to which the robot came again,"
        f" first near ({worst.x:.1f}, {worst.y:.1f}) m, seen at {worst.first:.0f} s and"
        f" {worst.second:.0f} s: {advice}"
    ]
