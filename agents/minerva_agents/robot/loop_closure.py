"""Loop closure: recognise revisited places in scans and correct the trajectory. Needs scipy.

Scan matching accumulates small errors, so after a large loop the first walls are drawn a second
time next to the old ones. Keyframes therefore become a pose graph with edges for consecutive steps
and for closures: pairs of distant keyframes that observe the same place.

A closure is searched by correlation over all shifts and rotations in a window (Olson, "Real-Time
Correlative Scan Matching", ICRA 2009). Ambiguous fits, as in a corridor, get a large covariance and
therefore little weight. A closure is accepted only if each scan has walls where the other has them
and neither sees through the other's walls.

The graph is optimised after Grisetti, Kümmerle, Stachniss and Burgard, "A Tutorial on Graph-Based
SLAM" (2010). Contradictory closures are switched off by dynamic covariance scaling (Agarwal et al.,
"Robust Map Optimization using Dynamic Covariance Scaling", ICRA 2013).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.fft
import scipy.spatial
from scipy import sparse
from scipy.sparse import linalg

from minerva_agents.robot.pose import Reals, moved
from minerva_agents.robot.trajectories import (
    ANYWHERE,
    MIN_LOOP,
    MapExtent,
    Posed,
    ScanKeyframe,
    between,
    canvas_of,
    keyframes_of,
    matched_pose,
    poses_of,
    seen_through,
    transformed,
)
from minerva_bus.log.recordings import Progress
from minerva_bus.semantics.poses import Pose
from minerva_bus.values import fast_dataclass
from minerva_bus.world.readings import Scan

_MIN_WEIGHT: Final = 0.25
"""Minimum weight for a closure to be kept."""

_ANCHOR_CELL: Final = 0.05
"""Side of a cell in metres of the map that the first scan must fit."""

_MAX_WIDTH: Final = 2.0
"""Search window of the second round, in metres to each side."""


@fast_dataclass
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
    carried = _anchored(scans, keys, _carried(places, keys, poses))
    return ClosedLoops(carried, len(closures), rejected)


def _anchored(
    scans: Sequence[Scan], keys: Sequence[ScanKeyframe], places: Sequence[Pose]
) -> list[Pose]:
    """The poses, moved and turned together so that the first scan fits what later ones have seen.

    The first pose stays. The next ones were matched with a map of few scans, and a small error of
    heading there turns all others about it.
    """
    extent, posed = MapExtent(), list[Posed]()
    for key in keys:
        if key.way > MIN_LOOP:
            at = places[key.number]
            posed.append(Posed(scans[key.number], at.x, at.y, at.angle))
            extent.take(posed[-1])
    canvas = canvas_of(extent, _ANCHOR_CELL)
    for each in posed:
        canvas.draw(each)
    seen = matched_pose(canvas, scans[0], places[0], ANYWHERE)
    return [places[0], *[places[0].compose(seen.seen(place)) for place in places[1:]]]


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


# --- closures -------------------------------------------------------------------------------------


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


# --- the pose graph -------------------------------------------------------------------------------


_linalg: Any = linalg

_SWITCH: Final = 10.0
"""Squared standard deviations beyond which dynamic covariance scaling weakens a closure."""


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """Pose of keyframe `to` relative to `begin` (m, m, rad), and its certainty.

    `information` is the inverse covariance, (3, 3).
    """

    begin: int
    to: int
    step: Reals
    information: Reals
    closes: bool = False


# Some hundred poses do not justify GTSAM or g2o: each is a C++ framework, this is a page.
def optimised(poses: Reals, edges: Sequence[Edge], rounds: int = 15) -> tuple[Reals, Reals]:
    """The poses that minimise the error of all edges, and each edge's weight, 0 to 1.

    Gauss-Newton; the first pose is fixed.
    """
    poses, counts = poses.copy(), np.ones(len(edges))
    begin = np.array([edge.begin for edge in edges])
    to = np.array([edge.to for edge in edges])
    steps = np.array([edge.step for edge in edges])
    information = np.array([edge.information for edge in edges])
    closes = np.array([edge.closes for edge in edges])
    columns = np.concatenate([3 * begin[:, None] + [0, 1, 2], 3 * to[:, None] + [0, 1, 2]], axis=1)
    for _ in range(rounds):
        errors, slopes = _errors(poses[begin], poses[to], steps)
        chi = np.einsum("ei,eij,ej->e", errors, information, errors)
        # Dynamic covariance scaling: wrong closures lose weight instead of bending the map.
        counts = np.where(closes, np.minimum(1.0, 2 * _SWITCH / (_SWITCH + chi)) ** 2, 1.0)
        weights = information * counts[:, None, None]
        squares = np.einsum("eki,ekl,elj->eij", slopes, weights, slopes)
        sides = np.einsum("eki,ekl,el->ei", slopes, weights, errors)
        rows = np.repeat(columns[:, :, None], 6, axis=2)
        matrix = sparse.coo_matrix(
            (squares.ravel(), (rows.ravel(), rows.transpose(0, 2, 1).ravel())),
            shape=(poses.size, poses.size),
        ).tocsc()
        right = np.bincount(columns.ravel(), sides.ravel(), poses.size)
        change = np.zeros(poses.size)
        # With the first pose free the system would be singular: edges are relative.
        change[3:] = _linalg.spsolve(matrix[3:, 3:], -right[3:])
        poses += change.reshape(-1, 3)
        # No pose has moved by more than a tenth of a millimetre, or 1e-4 rad.
        if np.abs(change).max() < 1e-4:
            break
    return poses, counts


def _errors(first: Reals, second: Reals, steps: Reals) -> tuple[Reals, Reals]:
    """Residuals of the edges, (e, 3), and their Jacobians, (e, 3, 6)."""
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    x, y = (second[:, :2] - first[:, :2]).T
    ahead, left = cos * x + sin * y, cos * y - sin * x
    turn = second[:, 2] - first[:, 2] - steps[:, 2]
    # A full turn is not an error.
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    errors = np.stack([ahead - steps[:, 0], left - steps[:, 1], turn], axis=1)
    slopes = np.zeros((len(first), 3, 6))
    slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 0, 2] = -cos, -sin, left
    slopes[:, 1, 0], slopes[:, 1, 1], slopes[:, 1, 2] = sin, -cos, -ahead
    slopes[:, 0, 3], slopes[:, 0, 4] = cos, sin
    slopes[:, 1, 3], slopes[:, 1, 4] = -sin, cos
    slopes[:, 2, 2], slopes[:, 2, 5] = -1.0, 1.0
    return errors, slopes
