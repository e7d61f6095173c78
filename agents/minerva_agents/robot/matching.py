"""Correlative scan matching: the pose at which a scan fits the robot's own grid best.

After Olson, "Real-Time Correlative Scan Matching" (ICRA 2009): among all poses in a window around
the odometry's pose, take the one at which the scan hits most known obstacles. The first search
covers whole cells and half degrees; the second refines its optimum by quarter cells and eighths of
a degree. The search is exhaustive, so it finds the optimum of the window from any start.

The score of a hit decreases with the distance to the nearest obstacle like a normal distribution
(the likelihood field of Thrun, Burgard and Fox, Probabilistic Robotics, 6.4). Scores are integers,
so sums are identical on every machine. Odometry has a small weight: between two equally good poses,
as in a corridor, the closer one wins.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grid import obstacles
from minerva_agents.robot.pose import GridPose, Reals
from minerva_bus import Cells, portable
from minerva_bus.values import fast_dataclass

Worths: TypeAlias = NDArray[np.int16]

_SPREAD: Final = 0.1
"""Standard deviation in metres of a hit around its obstacle; hits beyond two of them score 0."""

_HIT_SCORE: Final = 1000
"""Score of a hit in an obstacle's own cell."""

_MIN_SHARE: Final = 0.15
"""Minimum fraction of the maximum score for a pose to be accepted."""

_MIN_HITS: Final = 8
"""Minimum number of hits for a match."""

_MAX_RANGE: Final = 500.0
"""Cells; hits farther away are used for the map only."""

_DEGREES: Final = 0.5
_COST: Final = 0.03
"""Cost of one standard deviation from the odometry's pose, squared, as a fraction of the score."""

_WIDTH: Final = 3.0
"""Half width of the search window in standard deviations."""


@fast_dataclass
class Uncertainty:
    """Standard deviations of the odometry's pose since the last scan."""

    metres: float
    degrees: float

    @staticmethod
    def after(turn: float, dist: float) -> Uncertainty:
        """Uncertainty after a rotation (degrees) and a distance (m): the odometry motion model.

        Thrun, Burgard and Fox, Probabilistic Robotics, 5.4, with the errors of a mediocre wheeled
        robot and a floor for effects that odometry does not measure.
        """
        turned = math.radians(turn)
        rotation = portable.hypot(_TURN_BY_TURN * turned, _TURN_BY_DIST * dist)
        driven = portable.hypot(_DIST_BY_DIST * dist, _DIST_BY_TURN * turned)
        moved = portable.hypot(driven, _MIN_METRES)
        return Uncertainty(moved, portable.hypot(math.degrees(rotation), _MIN_DEGREES))


# The α of the motion model, as standard deviations per radian or metre.
_TURN_BY_TURN: Final = 0.15
_TURN_BY_DIST: Final = 0.1
_DIST_BY_DIST: Final = 0.15
_DIST_BY_TURN: Final = 0.1
# The floor of both deviations.
_MIN_METRES: Final = 0.02
_MIN_DEGREES: Final = 0.5


def match(
    grid: Cells, guess: GridPose, hits: tuple[Reals, Reals], cell: float, uncertainty: Uncertainty
) -> GridPose:
    """The pose at which a scan fits the grid best, or the guess if it does not fit at all.

    `hits` are distances in cells and angles in degrees from the heading, (n,) each; `cell` is the
    cell side in metres.
    """
    dist, angle = hits
    near = dist < _MAX_RANGE
    if np.count_nonzero(near) < _MIN_HITS:
        return guess
    search = _Search(grid, guess, (dist[near], angle[near]), cell, uncertainty)
    first = search.over(guess, search.steps, 1.0, _halves(_WIDTH * uncertainty.degrees))
    # Less than a whole step to each side, because the first search has tried the whole ones.
    second = search.over(first.pose, 3, 0.25, _EIGHTHS)
    return second.pose if second.part >= _MIN_SHARE else guess


@fast_dataclass
class _Fit:
    """A pose and its score as a fraction of the maximum."""

    pose: GridPose
    part: float


class _Search:
    """A scan and the part of the grid that covers it at every pose of the window."""

    def __init__(
        self,
        grid: Cells,
        guess: GridPose,
        hits: tuple[Reals, Reals],
        cell: float,
        uncertainty: Uncertainty,
    ) -> None:
        self._dist, angle = hits
        # Directions of the beams are computed once. Each heading then needs four products per beam
        # instead of a sine and a cosine.
        cos, sin = portable.cos_sin(np.radians(angle))
        self._ahead, self._aside = self._dist * cos, self._dist * sin
        self._guess = guess
        self._uncertainty = Uncertainty(uncertainty.metres / cell, uncertainty.degrees)
        self.steps = math.ceil(_WIDTH * uncertainty.metres / cell)
        around = math.ceil(float(self._dist.max())) + self.steps + 3
        self._row, self._column = math.floor(guess.row) - around, math.floor(guess.column) - around
        self._worths = _worths(grid, self._row, self._column, 2 * around + 1, cell)

    def over(self, centre: GridPose, steps: int, step: float, turns: Reals) -> _Fit:
        """The best pose within `steps` steps of a centre to each side, over all turns."""
        across = np.arange(-steps, steps + 1, dtype=np.float64) * step
        rows = (centre.row - self._guess.row + across) ** 2
        columns = (centre.column - self._guess.column + across) ** 2
        spread = self._uncertainty
        # Where the scan alone cannot decide, as along a corridor, the nearest pose wins.
        costs = _COST * (rows[:, None] + columns) / (spread.metres * spread.metres)
        best = _Fit(centre, -math.inf)
        for turn in turns.tolist():
            angle = centre.angle + turn
            parts = self._parts(centre, angle, across) - costs
            away = (angle - self._guess.angle) / spread.degrees
            parts -= _COST * (away * away)
            row, column = divmod(int(parts.argmax()), len(across))
            if parts[row, column] > best.part:
                place = centre.row + float(across[row]), centre.column + float(across[column])
                best = _Fit(GridPose(*place, angle), float(parts[row, column]))
        return best

    def _parts(self, centre: GridPose, angle: float, across: Reals) -> Reals:
        """Scores for one heading at each position around a centre.

        As a fraction of the maximum; (n, n) where n steps are tried along each axis.
        """
        cos, sin = portable.cos_sin(math.radians(angle))
        down = centre.row - self._row + (self._ahead * cos - self._aside * sin)
        right = centre.column - self._column + (self._ahead * sin + self._aside * cos)
        # All positions of a heading at once: turning the scan is costlier than shifting it.
        rows = (down + across[:, None]).astype(np.intp) * self._worths.shape[1]
        columns = (right + across[:, None]).astype(np.intp)
        # The window covers all positions, so "clip" only saves the check of bounds.
        worths = self._worths.ravel().take(rows[:, None] + columns, mode="clip")
        # The sum of 33 hits overflows 16 bits.
        return worths.sum(axis=2, dtype=np.int32) / (_HIT_SCORE * len(self._dist))


def _halves(swing: float) -> Reals:
    """Turns to both sides in steps of half a degree."""
    most = math.ceil(swing / _DEGREES)
    return np.arange(-most, most + 1, dtype=np.float64) * _DEGREES


_EIGHTHS: Final[Reals] = np.arange(-3, 4, dtype=np.float64) * (_DEGREES / 4)


@cache
def _bell(cell: float) -> tuple[int, list[tuple[int, int, int]]]:
    """Score of a hit by its offset (rows, columns) from an obstacle, in ascending order.

    Preceded by the kernel's radius in cells; `cell` is the cell side in metres.
    """
    # In coarse grids a narrower bell would give adjacent cells no score.
    spread = max(_SPREAD / cell, 0.7)
    near = math.ceil(2 * spread)
    offsets = range(-near, near + 1)
    kernel = [
        (round(_HIT_SCORE * portable.exp(-(i * i + j * j) / (2 * spread * spread))), i, j)
        for i in offsets
        for j in offsets
        if portable.hypot(i, j) <= near
    ]
    return near, sorted(kernel)


def _within(first: int, count: int) -> slice:
    """Slice of `count` rows or columns from `first`, without negative indices."""
    return slice(max(first, 0), max(first + count, 0))


def _worths(grid: Cells, row: int, column: int, side: int, cell: float) -> Worths:
    """Score of a hit in each cell of a square of the grid; 0 outside it."""
    near, bell = _bell(cell)
    # A margin as wide as the kernel, so that writing needs no check of bounds.
    table = np.zeros((side + 2 * near, side + 2 * near), np.int16)
    rows, columns = _within(row, side), _within(column, side)
    walls = np.argwhere(obstacles(np.ascontiguousarray(grid[rows, columns])))
    walls += (rows.start - row + near, columns.start - column + near)
    cells, flat = walls[:, 0] * table.shape[1] + walls[:, 1], table.ravel()
    for worth, down, right in bell:  # ascending, so each cell keeps its highest score
        flat[cells + (down * table.shape[1] + right)] = worth
    return np.ascontiguousarray(table[near:-near, near:-near])
