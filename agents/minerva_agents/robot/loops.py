"""Loop closure: recognise revisited places in scans and correct the trajectory.

Scan matching accumulates small errors, so after a large loop the first walls are drawn a second
time next to the old ones. Keyframes therefore become a pose graph with edges for consecutive steps
and for closures. Needs scipy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from minerva_agents.robot.closures import candidates, closure
from minerva_agents.robot.keyframes import ScanKeyframe, between, keyframes_of, poses_of
from minerva_agents.robot.motion import Reals
from minerva_agents.robot.pose_graph import Edge, optimised
from minerva_bus.semantics.poses import Pose, moved
from minerva_bus.world.readings import Scan
from minerva_bus.world.recordings import Progress

_MIN_WEIGHT: Final = 0.25
"""Minimum weight for a closure to be kept."""

_MAX_WIDTH: Final = 2.0
"""Search window of the second round, in metres to each side."""


@dataclass(frozen=True, slots=True)
class ClosedLoops:
    """Poses after closing loops, and how many closures were kept and rejected."""

    places: list[Pose]
    closures: int
    rejected: int

    def __str__(self) -> str:
        return f"loops: {self.closures} closures kept, {self.rejected} rejected as contradictory"


def closed_loops(scans: Sequence[Scan], places: Sequence[Pose], progress: Progress) -> ClosedLoops:
    """Correct the poses of scans by closing loops.

    The first round searches windows as wide as the possible drift; the second starts from the
    corrected poses and uses narrow ones.
    """
    keys = keyframes_of(scans, places)
    if not keys:
        return ClosedLoops(list(places), 0, 0)
    poses = poses_of([places[key.number] for key in keys])
    steps, closures, rejected = _steps(keys, poses), list[Edge](), 0
    for number in range(2):
        edges = _searched(keys, poses, number, lambda part, n=number: progress((n + part) / 2))
        if not edges:
            break
        _, counts = optimised(poses, [*steps, *edges])
        held = (counts[len(steps) :] > _MIN_WEIGHT).tolist()
        closures = [edge for edge, holds in zip(edges, held, strict=True) if holds]
        rejected = len(edges) - len(closures)
        # Rejected closures would still pull with their small weights, so optimise again without
        # them.
        poses, _ = optimised(poses, [*steps, *closures])
    progress(1.0)
    if not closures:
        return ClosedLoops(list(places), 0, rejected)
    return ClosedLoops(_carried(places, keys, poses), len(closures), rejected)


def _searched(
    keys: Sequence[ScanKeyframe], poses: Reals, number: int, progress: Progress
) -> list[Edge]:
    """Closures of one round."""
    pairs = candidates(keys, poses)
    edges: list[Edge] = []
    for done, (first, second, window) in enumerate(pairs):
        edge = closure(keys, poses, first, second, window if number == 0 else _MAX_WIDTH)
        if edge is not None:
            edges.append(edge)
        progress(done / len(pairs))
    return edges


def _steps(keys: Sequence[ScanKeyframe], poses: Reals) -> list[Edge]:
    edges: list[Edge] = []
    for number in range(1, len(keys)):
        step = between(poses[number - 1], poses[number])
        length = math.hypot(step[0], step[1])
        metres = 0.01 + 0.02 * length
        degrees = 0.25 + 0.5 * length + 0.02 * abs(math.degrees(step[2]))
        spread = np.array([metres, metres, math.radians(degrees)])
        edges.append(Edge(number - 1, number, step, np.diag(spread**-2.0)))
    return edges


def _carried(places: Sequence[Pose], keys: Sequence[ScanKeyframe], poses: Reals) -> list[Pose]:
    """All poses, each moved along with the keyframe before it."""
    carried, at = [], 0
    for number, place in enumerate(places):
        while at + 1 < len(keys) and keys[at + 1].number <= number:
            at += 1
        x, y, turn = poses[at].tolist()
        carried.append(moved(Pose(x, y, math.degrees(turn)), places[keys[at].number], place))
    return carried
