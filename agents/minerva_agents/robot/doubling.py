"""Walls drawn twice: a consistency check for maps.

When a robot revisits a place, both scans should see the same walls. A scan that looks through the
other's walls was placed at a wrong pose.
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
    poses_of,
    seen_through,
    transformed,
)
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.clock_steps import seconds_of
from minerva_bus.world.readings import Scan

_SAME_PLACE_METRES: Final = 1.5
"""Maximum distance between two keyframes of one place, in metres."""

_MAX_SEEN_THROUGH: Final = 0.3
"""Tolerated fraction of a scan's hits in space that the other scan saw as free."""

_TOLERATED: Final = 0.02
"""Fraction of places that may differ because of people and doors."""


@dataclass(frozen=True, slots=True)
class Doubled:
    """A revisited place (m) whose walls disagree, with the times of both visits (s)."""

    x: float
    y: float
    first: float
    second: float


def doubled_walls(scans: Sequence[Scan], places: Sequence[Pose]) -> tuple[list[Doubled], int]:
    """Places whose walls a later visit contradicts, and the number of revisited places."""
    keys = keyframes_of(scans, places)
    poses = poses_of([places[key.number] for key in keys])
    seconds = seconds_of([scan.time for scan in scans])
    doubled, visits = [], 0
    way = np.array([key.way for key in keys])
    for later in range(0, len(keys), 2):
        before = np.flatnonzero(way <= way[later] - MIN_LOOP)
        if not len(before):
            continue
        apart = np.hypot(*(poses[before, :2] - poses[later, :2]).T)
        first = int(before[apart.argmin()])
        if apart.min() > _SAME_PLACE_METRES:
            continue
        visits += 1
        step = between(poses[first], poses[later])
        # Either scan may look through the walls of the other.
        through = max(
            seen_through(transformed(keys[later].points, step), keys[first].reach),
            seen_through(
                transformed(keys[first].points, between(step, np.zeros(3))), keys[later].reach
            ),
        )
        if through > _MAX_SEEN_THROUGH:
            x, y, _ = poses[later].tolist()
            times = [seconds[keys[k].number] for k in (first, later)]
            doubled.append(Doubled(x, y, *times))
    return doubled, visits


def doubling_notes(scans: Sequence[Scan], places: Sequence[Pose], poses: str) -> list[str]:
    """A warning with advice if walls are drawn twice, as a list of lines; else empty."""
    doubled, visits = doubled_walls(scans, places)
    if len(doubled) < 2 or len(doubled) <= _TOLERATED * visits:
        return []
    worst = doubled[0]
    advice = (
        "record at lower speed, or exclude a part (--from, --to)"
        if poses == "matched"
        else "use --poses matched to estimate the poses and close loops"
    )
    return [
        f"walls are drawn twice at {len(doubled)} of {visits} revisited places,"
        f" first near ({worst.x:.1f}, {worst.y:.1f}) m, seen at {worst.first:.0f} s and"
        f" {worst.second:.0f} s: {advice}"
    ]
