"""Loop closures: pairs of distant keyframes that observe the same place.

A closure is searched by correlation over all shifts and rotations in a window (Olson, "Real-Time
Correlative Scan Matching", ICRA 2009). Ambiguous fits, as in a corridor, get a large covariance and
therefore little weight. A closure is accepted only if each scan has walls where the other has them
and neither sees through the other's walls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import scipy.fft
import scipy.spatial

from minerva_agents.robot.keyframes import (
    MIN_LOOP,
    ScanKeyframe,
    between,
    seen_through,
    transformed,
)
from minerva_agents.robot.motion import Reals
from minerva_agents.robot.pose_graph import Edge

_fft: Any = scipy.fft
_spatial: Any = scipy.spatial

# Side of a cell of the correlation in metres.
_CELL: Final = 0.2
_MAX_POINTS: Final = 400
_AROUND: Final = 4
"""Neighbouring keyframes on each side that belong to a keyframe's local map."""

# Odometry error in metres per metre travelled, and the resulting window's limit in metres.
_DRIFT, _MAX_WINDOW = 0.05, 12.0
# Largest rotation that is tried to each side, and the step between rotations.
_DEGREES: Final = 18.0
_STEP_DEGREES: Final = 3.0
_NEAR: Final = 0.15
# A closure has at least _MIN_FIT of its points on walls, and sees at most _MAX_SEEN_THROUGH of them
# through walls.
_MIN_FIT: Final = 0.6
_MAX_SEEN_THROUGH: Final = 0.15
_SEARCH_METRES: Final = 2.0
"""Metres travelled between two searches."""

# Difference of scores at which the weight of a pose falls to 1/e.
_TEMPERATURE: Final = 0.02


class LocalMap:
    """Local map around a keyframe, in its own frame, for scoring other points."""

    def __init__(self, keys: Sequence[ScanKeyframe], poses: Reals, number: int) -> None:
        around = range(max(0, number - _AROUND), min(len(keys), number + _AROUND + 1))
        self.points = np.concatenate(
            [transformed(keys[k].points, between(poses[number], poses[k])) for k in around]
        )
        # The limit bounds the grid, and with it the time of each FFT.
        self.half = math.ceil((min(25.0, np.abs(self.points).max()) + 1.0) / _CELL)
        grid = np.zeros((2 * self.half, 2 * self.half))
        cells = np.floor(self.points / _CELL).astype(np.intp) + self.half
        # A margin of one cell for the blur below.
        inside = np.all((cells >= 1) & (cells < 2 * self.half - 1), axis=1)
        cells = cells[inside]
        # Walls are blurred by a cell, so that points just beside them score as well.
        for down, right, worth in _NEIGHBOURS:
            at = (cells[:, 0] + down, cells[:, 1] + right)
            grid[at] = np.maximum(grid[at], worth)
        self.grid = grid
        self.tree: Any = _spatial.cKDTree(self.points)

    def fit(self, points: Reals) -> float:
        """Fraction of points with a wall within `_NEAR` metres."""
        dist, _ = self.tree.query(points, distance_upper_bound=_NEAR)
        return float(np.mean(np.isfinite(dist)))


_NEIGHBOURS: Final = [
    (i, j, math.exp(-(i * i + j * j) / 2.0)) for i in (-1, 0, 1) for j in (-1, 0, 1)
]


def correlated(
    walls: LocalMap, points: Reals, guess: Reals, window: float
) -> tuple[Reals, float, Reals]:
    """Best pose of points in a local map, its fraction of matching points, and its covariance.

    Tries all shifts up to `window` metres around the guess by correlation (FFT), and rotations up
    to `_DEGREES`.
    """
    size = 2 * walls.half
    reach = min(size - 1, math.ceil(window / _CELL))
    # Padded by the window on both sides: correlation by FFT is cyclic.
    side = _fft.next_fast_len(size + 2 * reach, real=True)
    shape = (side, side)
    # The spectrum of the map is the same for all rotations.
    spectrum = np.conj(_fft.rfft2(walls.grid, shape))
    best, parts = (-1.0, guess), []
    turns = np.arange(-_DEGREES, _DEGREES + 0.1, _STEP_DEGREES)
    for turn in turns.tolist():
        pose = np.array([guess[0], guess[1], guess[2] + math.radians(turn)])
        cells = np.floor(transformed(points, pose) / _CELL).astype(np.intp) + walls.half
        cells = cells[np.all((cells >= 0) & (cells < size), axis=1)]
        image = np.zeros(shape)
        # Unlike image[cells] += 1, this counts several points per cell.
        np.add.at(image, (cells[:, 0], cells[:, 1]), 1.0)
        scores = _fft.irfft2(np.conj(_fft.rfft2(image) * spectrum), shape) / len(points)
        scores = np.roll(scores, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
        parts.append((turn, scores))
        row, column = divmod(int(scores.argmax()), scores.shape[1])
        if scores[row, column] > best[0]:
            shift = np.array([(row - reach) * _CELL, (column - reach) * _CELL, 0.0])
            best = float(scores[row, column]), pose + shift
    return best[1], best[0], _covariance(parts, best[0], reach)


def _covariance(parts: list[tuple[float, Reals]], best: float, reach: int) -> Reals:
    """Covariance of a pose from the scores around the optimum (Olson 2009, section 3)."""
    steps = np.arange(-reach, reach + 1) * _CELL
    x, y = np.meshgrid(steps, steps, indexing="ij")
    total, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for turn, scores in parts:
        # Poses further below the best have weights under e⁻⁶ and would only cost time.
        near = scores > best - 6 * _TEMPERATURE
        weight = np.exp((scores[near] - best) / _TEMPERATURE)
        at = np.stack([x[near], y[near], np.full(len(weight), math.radians(turn))], axis=1)
        total += float(weight.sum())
        first += weight @ at
        second += (weight[:, None] * at).T @ at
    mean = first / total
    # At least the resolution of the search, or a sharp optimum would count as exact.
    least = np.diag([0.05**2, 0.05**2, math.radians(0.7) ** 2])
    return second / total - np.outer(mean, mean) + least


def polished(walls: LocalMap, points: Reals, pose: Reals) -> Reals:
    """A pose refined by trimmed ICP: points against the nearest walls."""
    # The distances at which points still count shrink, so that outliers lose their influence.
    for limit in (0.4, 0.25, 0.2, 0.15, 0.15):
        here = transformed(points, pose)
        dist, index = walls.tree.query(here, distance_upper_bound=limit)
        near = np.isfinite(dist)
        if np.count_nonzero(near) < 30:
            return pose
        ours, theirs = here[near], walls.points[index[near]]
        a, b = ours - ours.mean(0), theirs - theirs.mean(0)
        # The rotation of least squared error, in closed form.
        turn = math.atan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
        cos, sin = math.cos(turn), math.sin(turn)
        shift = theirs.mean(0) - np.array([[cos, -sin], [sin, cos]]) @ ours.mean(0)
        x, y = np.array([[cos, -sin], [sin, cos]]) @ pose[:2] + shift
        pose = np.array([x, y, pose[2] + turn])
    return pose


def candidates(keys: Sequence[ScanKeyframe], poses: Reals) -> list[tuple[int, int, float]]:
    """Pairs of keyframes that may show the same place, each with its search window in metres."""
    way = np.array([key.way for key in keys])
    pairs, next_way = [], 0.0
    for later in range(len(keys)):
        if way[later] < next_way:
            continue
        # Recent keyframes show the same walls anyway, so an edge to them closes no loop.
        before = np.flatnonzero(way <= way[later] - MIN_LOOP)
        if not len(before):
            continue
        apart = np.hypot(*(poses[before, :2] - poses[later, :2]).T)
        window = np.minimum(_MAX_WINDOW, 1.0 + _DRIFT * (way[later] - way[before]))
        part = apart / (window + 2.0)
        nearest = int(part.argmin())
        if part[nearest] < 1.0:
            pairs.append((int(before[nearest]), later, float(window[nearest])))
            next_way = way[later] + _SEARCH_METRES
    return pairs


def closure(
    keys: Sequence[ScanKeyframe], poses: Reals, first: int, second: int, window: float
) -> Edge | None:
    """The graph edge between two keyframes, or None if they observe different places."""
    walls = LocalMap(keys, poses, first)
    others = LocalMap(keys, poses, second)
    # A sample of the points suffices, and time grows with their number.
    points = others.points[:: max(1, len(others.points) // _MAX_POINTS)]
    # Correlation finds the optimum of the window to a cell and three degrees, ICP refines it.
    pose, _, covariance = correlated(walls, points, between(poses[first], poses[second]), window)
    pose = polished(walls, points, pose)
    if not _fits(keys[first], keys[second], walls, others, points, pose):
        return None
    return Edge(first, second, pose, np.asarray(np.linalg.inv(covariance), np.float64), closes=True)


def _fits(
    first: ScanKeyframe,
    second: ScanKeyframe,
    walls: LocalMap,
    others: LocalMap,
    points: Reals,
    pose: Reals,
) -> bool:
    back = between(pose, np.zeros(3))
    fits = walls.fit(transformed(points, pose))
    again = others.fit(transformed(first.points, back))
    # Either scan may look through the walls of the other.
    through = max(
        seen_through(transformed(second.points, pose), first.reach),
        seen_through(transformed(first.points, back), second.reach),
    )
    return min(fits, again) >= _MIN_FIT and through <= _MAX_SEEN_THROUGH
