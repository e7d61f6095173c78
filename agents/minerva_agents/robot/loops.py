"""Loop closure: a robot that comes back to a place finds by its scans that it is the same one.

Scan matching follows the robot from scan to scan, and small errors add up: after a large loop the
walls of its beginning are drawn a second time beside the first. So keyframes of the way become a
pose graph, whose edges are the steps of the way, and closures. Needs scipy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.closures import candidates, closure
from minerva_agents.robot.keyframes import Keyframe, between, keyframes_of, poses_of
from minerva_agents.robot.pose_graph import Edge, optimised
from minerva_bus.world.poses import Pose, moved
from minerva_bus.world.readings import Scan
from minerva_bus.world.recordings import Progress

Reals: TypeAlias = NDArray[np.float64]

_HOLDS: Final = 0.25
"""How much a closure must count for it to be kept."""

_NARROW: Final = 2.0
"""Metres to each side that the second round looks at."""


@dataclass(frozen=True, slots=True)
class Closed:
    """The places of scans after loops were closed, and how many closures held and were rejected."""

    places: list[Pose]
    closures: int
    rejected: int

    def __str__(self) -> str:
        return f"loops: {self.closures} closures hold, {self.rejected} contradicted and were left"


def closed_loops(scans: Sequence[Scan], places: Sequence[Pose], progress: Progress) -> Closed:
    """Correct the places of scans by loops.

    The first round searches in windows as wide as the drift may be, the second one, from the poses
    of the first, in narrow ones.
    """
    keys = keyframes_of(scans, places)
    if not keys:
        return Closed(list(places), 0, 0)
    poses = poses_of([places[key.number] for key in keys])
    steps, closures, rejected = _steps(keys, poses), list[Edge](), 0
    for number in range(2):
        found = _searched(keys, poses, number, lambda part, n=number: progress((n + part) / 2))
        if not found:
            break
        _, counts = optimised(poses, [*steps, *found])
        held = (counts[len(steps) :] > _HOLDS).tolist()
        closures = [edge for edge, holds in zip(found, held, strict=True) if holds]
        rejected = len(found) - len(closures)
        poses, _ = optimised(poses, [*steps, *closures])
    progress(1.0)
    if not closures:
        return Closed(list(places), 0, rejected)
    return Closed(_carried(places, keys, poses), len(closures), rejected)


def _searched(
    keys: Sequence[Keyframe], poses: Reals, number: int, progress: Progress
) -> list[Edge]:
    """The closures of a round."""
    pairs = candidates(keys, poses)
    found: list[Edge] = []
    for done, (first, second, window) in enumerate(pairs):
        edge = closure(keys, poses, first, second, window if number == 0 else _NARROW)
        if edge is not None:
            found.append(edge)
        progress(done / len(pairs))
    return found


def _steps(keys: Sequence[Keyframe], poses: Reals) -> list[Edge]:
    edges: list[Edge] = []
    for number in range(1, len(keys)):
        step = between(poses[number - 1], poses[number])
        length = math.hypot(step[0], step[1])
        metres = 0.01 + 0.02 * length
        degrees = 0.25 + 0.5 * length + 0.02 * abs(math.degrees(step[2]))
        spread = np.array([metres, metres, math.radians(degrees)])
        edges.append(Edge(number - 1, number, step, np.diag(spread**-2.0)))
    return edges


def _carried(places: Sequence[Pose], keys: Sequence[Keyframe], poses: Reals) -> list[Pose]:
    """All places, each as it lay from the keyframe before it."""
    carried, at = [], 0
    for number, place in enumerate(places):
        while at + 1 < len(keys) and keys[at + 1].number <= number:
            at += 1
        x, y, turn = poses[at].tolist()
        carried.append(moved(Pose(x, y, math.degrees(turn)), places[keys[at].number], place))
    return carried
