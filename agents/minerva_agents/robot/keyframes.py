"""Keyframes of a trajectory: the scans used to compare places, and poses as arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from minerva_agents.robot.motion import Reals
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.beams import hits
from minerva_bus.world.readings import Scan

KEY_METRES, KEY_DEGREES = 0.8, 40.0
"""Maximum travel and rotation between keyframes, if scans are that dense."""

MIN_LOOP: Final = 12.0
"""Minimum travel in metres between two keyframes of one place."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanKeyframe:
    """A scan of the trajectory: index, hits relative to the robot in metres (n, 2), and reach.

    `reach` is the distance in metres to the nearest hit per degree, (360,); 0 where nothing was
    hit. `way` is the distance travelled so far.
    """

    number: int
    points: Reals
    reach: Reals
    way: float


def keyframes_of(scans: Sequence[Scan], places: Sequence[Pose]) -> list[ScanKeyframe]:
    """Scans of a trajectory, thinned to the spacing of keyframes."""
    keys: list[ScanKeyframe] = []
    way, last = 0.0, -1
    for number, (scan, place) in enumerate(zip(scans, places, strict=True)):
        if number:
            before = places[number - 1]
            way += math.hypot(place.x - before.x, place.y - before.y)
        if keys:
            turn = abs(math.remainder(place.angle - places[last].angle, 360.0))
            if way - keys[-1].way < KEY_METRES and turn < KEY_DEGREES:
                continue
        dist, angle = hits(scan)
        # Too few hits to recognise a place.
        if len(dist) < 20:
            continue
        keys.append(ScanKeyframe(number, _points(dist, angle), _reach(dist, angle), way))
        last = number
    return keys


def _points(dist: Reals, angle: Reals) -> Reals:
    heading = np.radians(angle)
    return np.stack([dist * np.cos(heading), dist * np.sin(heading)], axis=1)


def _reach(dist: Reals, angle: Reals) -> Reals:
    reach = np.full(360, np.inf)
    np.minimum.at(reach, np.floor(angle).astype(np.intp) % 360, dist)
    # The nearest of three degrees: an edge that lies between two of them must not count as seen
    # through.
    least = np.minimum(reach, np.minimum(np.roll(reach, 1), np.roll(reach, -1)))
    return np.where(np.isfinite(least), least, 0.0)


def poses_of(places: Sequence[Pose]) -> Reals:
    """Poses as an array, (n, 3)."""
    return np.array([(p.x, p.y, math.radians(p.angle)) for p in places])


def between(first: Reals, second: Reals) -> Reals:
    """The second pose relative to the first."""
    cos, sin = math.cos(first[2]), math.sin(first[2])
    x, y = second[0] - first[0], second[1] - first[1]
    turn = math.remainder(second[2] - first[2], math.tau)
    return np.array([cos * x + sin * y, cos * y - sin * x, turn])


def transformed(points: Reals, pose: Reals) -> Reals:
    """Points in a pose's own frame, transformed to the outer frame."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def seen_through(points: Reals, reach: Reals) -> float:
    """Fraction of points in space that a keyframe observed as free."""
    dist = np.hypot(points[:, 0], points[:, 1])
    degree = np.floor(np.degrees(np.arctan2(points[:, 1], points[:, 0]))).astype(np.intp) % 360
    limit = reach[degree]
    known = limit > 0
    if np.count_nonzero(known) < 20:
        return 0.0
    # The tolerance grows with the distance, like the effect of an error of heading.
    return float(np.mean(dist[known] < limit[known] - 0.3 - 0.03 * limit[known]))
