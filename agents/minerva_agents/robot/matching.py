"""Where on its own grid a robot's scan fits best: correlative scan matching.

After Olson, "Real-Time Correlative Scan Matching" (ICRA 2009): of all poses in a window about the
one that the wheels believe in, that one is taken at which the scan hits most of what is known to be
an obstacle. A first search goes over whole cells and half degrees, a second one about its best over
quarters of a cell and eighths of a degree. All of the window is looked at, so nothing is missed
that lies in it, and no start has to be good.

What a hit is worth falls off with the distance from the nearest obstacle, as a normal
distribution does (the likelihood field of Thrun, Burgard and Fox, Probabilistic Robotics, 6.4).
Worths are whole numbers, so their sums are the same on every machine. The wheels count for a
little: of two poses that fit alike, as in a corridor, the one nearer to theirs wins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import obstacles
from minerva_agents.robot.motion import Pose
from minerva_bus import Cells, portable

Reals: TypeAlias = NDArray[np.float64]
Worths: TypeAlias = NDArray[np.int16]

_SPREAD: Final = 0.1
"""Metres, the standard deviation of a hit about its obstacle; beyond two of them it is nothing."""

_BEST: Final = 1000
"""What a hit in an obstacle's own cell is worth."""

_LEAST: Final = 0.15
"""The part of what a scan can be worth that it must be for the pose to count."""

_FEWEST: Final = 8
"""Hits without which there is nothing to match."""

_FARTHEST: Final = 500.0
"""Cells; farther hits are for the map alone."""

_DEGREES: Final = 0.5
_COST: Final = 0.03
"""The part of a scan's worth that a standard deviation from the wheels' pose costs, squared."""

_WIDTH: Final = 3.0
"""Standard deviations to each side of the wheels' pose that are looked at."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Standard deviations of where the wheels believe to be since the last scan."""

    metres: float
    degrees: float

    @staticmethod
    def after(turn: float, dist: float) -> Doubt:
        """After a turn in degrees and a distance in metres: the odometry's motion model.

        Thrun, Burgard and Fox, Probabilistic Robotics, 5.4, with the errors of a robot on wheels
        that is not a good one, and a bit for what no wheel knows of.
        """
        turned = math.radians(turn)
        rotation = portable.hypot(_TURN_BY_TURN * turned, _TURN_BY_DIST * dist)
        driven = portable.hypot(_DIST_BY_DIST * dist, _DIST_BY_TURN * turned)
        moved = portable.hypot(driven, _LEAST_METRES)
        return Doubt(moved, portable.hypot(math.degrees(rotation), _LEAST_DEGREES))


_TURN_BY_TURN: Final = 0.15
_TURN_BY_DIST: Final = 0.1
_DIST_BY_DIST: Final = 0.15
_DIST_BY_TURN: Final = 0.1
_LEAST_METRES: Final = 0.02
_LEAST_DEGREES: Final = 0.5


def match(grid: Cells, guess: Pose, hits: tuple[Reals, Reals], cell: float, doubt: Doubt) -> Pose:
    """The pose at which a scan fits the grid best, or the guess where it does not fit at all.

    `hits` are distances in cells and angles in degrees from the heading, (n,) each; `cell` is the
    side of a cell in metres.
    """
    dist, angle = hits
    near = dist < _FARTHEST
    if np.count_nonzero(near) < _FEWEST:
        return guess
    search = _Search(grid, guess, (dist[near], angle[near]), cell, doubt)
    first = search.over(guess, search.steps, 1.0, _halves(_WIDTH * doubt.degrees))
    second = search.over(first.pose, 3, 0.25, _EIGHTHS)
    return second.pose if second.part >= _LEAST else guess


@dataclass(frozen=True, slots=True)
class _Fit:
    """A pose, and the part of what it can be worth that the scan is worth there."""

    pose: Pose
    part: float


class _Search:
    """A scan over a part of the grid that holds all of it, wherever in the window it is."""

    def __init__(
        self,
        grid: Cells,
        guess: Pose,
        hits: tuple[Reals, Reals],
        cell: float,
        doubt: Doubt,
    ) -> None:
        self._dist, angle = hits
        headings = np.radians(angle)
        self._ahead = self._dist * portable.cos(headings)
        self._aside = self._dist * portable.sin(headings)
        self._guess = guess
        self._doubt = Doubt(doubt.metres / cell, doubt.degrees)
        self.steps = math.ceil(_WIDTH * doubt.metres / cell)
        around = math.ceil(float(self._dist.max())) + self.steps + 3
        self._row, self._column = math.floor(guess.row) - around, math.floor(guess.column) - around
        self._worths = _worths(grid, self._row, self._column, 2 * around + 1, cell)

    def over(self, centre: Pose, steps: int, step: float, turns: Reals) -> _Fit:
        """The best of the poses about a centre, `steps` steps to each side and all turns."""
        across = np.arange(-steps, steps + 1, dtype=np.float64) * step
        rows = (centre.row - self._guess.row + across) ** 2
        columns = (centre.column - self._guess.column + across) ** 2
        costs = _COST * (rows[:, None] + columns) / (self._doubt.metres * self._doubt.metres)
        best = _Fit(centre, -math.inf)
        for turn in turns.tolist():
            angle = centre.angle + turn
            parts = self._parts(centre, angle, across) - costs
            away = (angle - self._guess.angle) / self._doubt.degrees
            parts -= _COST * (away * away)
            row, column = divmod(int(parts.argmax()), len(across))
            if parts[row, column] > best.part:
                place = centre.row + float(across[row]), centre.column + float(across[column])
                best = _Fit(Pose(*place, angle), float(parts[row, column]))
        return best

    def _parts(self, centre: Pose, angle: float, across: Reals) -> Reals:
        """What the scan is worth with a heading at each of the places about a centre.

        Of what it can be worth; (n, n) where n steps across are tried in each direction.
        """
        turn = math.radians(angle)
        cos, sin = portable.cos(turn), portable.sin(turn)
        down = centre.row - self._row + (self._ahead * cos - self._aside * sin)
        right = centre.column - self._column + (self._ahead * sin + self._aside * cos)
        rows = (down + across[:, None]).astype(np.intp) * self._worths.shape[1]
        columns = (right + across[:, None]).astype(np.intp)
        worths = self._worths.ravel().take(rows[:, None] + columns, mode="clip")
        return worths.sum(axis=2, dtype=np.int32) / (_BEST * len(self._dist))


def _halves(swing: float) -> Reals:
    """Turns to both sides in half degrees."""
    most = math.ceil(swing / _DEGREES)
    return np.arange(-most, most + 1, dtype=np.float64) * _DEGREES


_EIGHTHS: Final[Reals] = np.arange(-3, 4, dtype=np.float64) * (_DEGREES / 4)


@cache
def _bell(cell: float) -> tuple[int, list[tuple[int, int, int]]]:
    """What a hit is worth so many rows and columns from an obstacle, the least first.

    Before it, how many rows and columns that reaches, for cells of so many metres.
    """
    spread = max(_SPREAD / cell, 0.7)
    near = math.ceil(2 * spread)
    away = range(-near, near + 1)
    made = [
        (round(_BEST * portable.exp(-(i * i + j * j) / (2 * spread * spread))), i, j)
        for i in away
        for j in away
    ]
    return near, sorted([one for one in made if portable.hypot(one[1], one[2]) <= near])


def _within(first: int, count: int) -> slice:
    """So many rows or columns from one on, without those before the grid."""
    return slice(max(first, 0), max(first + count, 0))


def _worths(grid: Cells, row: int, column: int, side: int, cell: float) -> Worths:
    """What a hit in each cell of a square of the grid is worth; outside of it nothing is known."""
    near, bell = _bell(cell)
    made = np.zeros((side + 2 * near, side + 2 * near), np.int16)
    rows, columns = _within(row, side), _within(column, side)
    walls = np.argwhere(obstacles(np.ascontiguousarray(grid[rows, columns])))
    walls += (rows.start - row + near, columns.start - column + near)
    cells, flat = walls[:, 0] * made.shape[1] + walls[:, 1], made.ravel()
    for worth, down, right in bell:  # the nearer, the later: so each cell keeps the most
        flat[cells + (down * made.shape[1] + right)] = worth
    return np.ascontiguousarray(made[near:-near, near:-near])
