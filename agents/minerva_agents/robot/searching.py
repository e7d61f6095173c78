"""Where to look next for a marker that has not been seen: the most news for the way there.

News is ground that is known to be free but that the camera has not had in view, and some metres of
the unknown behind what is free. The robot goes where it would have much of it in view and where it
comes soon, which is the next best view of exploration [Gonzalez-Banos, Latombe 2002, "Navigation
Strategies for Exploring Indoor Environments"]: of all places to the one with the highest

    square root of the news in view in m² / (way + turns + AHEAD in metres)

where a turn, to the place and round at it, costs as much as driving that takes as long. To turn
where it stands is one of the choices, so a robot in a door looks round before it goes on. Places
lie in blocks of half a metre, one in each, and the choice is widened only while what lies farther
off can be better.

`next_goal` is a function of what is known, and of nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import UNKNOWN, Cell, Mask
from minerva_agents.robot.looking import expanses
from minerva_agents.robot.motion import Pose, wrapped
from minerva_agents.robot.prospects import DARK, NEWS, RAYS, WALL, Kinds, Prospects, kinds_of
from minerva_agents.robot.wave import STEP, Wave
from minerva_bus import Cells, portable

Numbers = NDArray[np.floating[Any]]
Places = NDArray[np.intp]

AHEAD: Final = 0.5
"""Metres that every way has more, so that the robot does not run after every speck beside it."""

HALF_TURN: Final = 1.0
"""Metres that take as long as half a turn."""

LEAST: Final = 0.3
"""Square metres of news below which no look is worth anything."""

LARGE: Final = 1.0
"""Square metres of news below which a look waits until nothing larger is left."""

MOST: Final = 30.0
"""Square metres above which no view is worth more."""

BLOCK: Final = 0.5
"""Metres, the side of the blocks of which each has one place to look from."""

_RING: Final = 8.0
"""Metres of way by which the choice is widened at first; then twice as far, and so on."""

_BATCH: Final = 32
_ARCS: Final = (0.0, 60.0, 120.0, 300.0)
"""Degrees that a robot turns to look round at a place, from one edge of an arc to the other."""


@dataclass(frozen=True, slots=True)
class Goal:
    """What to do next: go along cells, or turn to a heading where there are none.

    `heading` is in degrees, `news` the square metres that are to be seen at the end.
    """

    cells: tuple[Cell, ...]
    heading: float
    news: float


@dataclass(frozen=True, slots=True)
class Known:
    """What a robot knows when it decides where to look.

    `grid` has the codes of `knowledge`, `closed` is where the robot must not go. `been` are cells
    that it has gone to for a look, `dull` those where a turn has shown nothing new: neither is
    chosen twice. `fov` and `sight` are the camera's, degrees and metres, `cell` the side of a cell
    in metres.
    """

    grid: Cells
    closed: Mask
    pose: Pose
    cell: float
    fov: float = 60.0
    sight: float = 5.0
    been: Sequence[Cell] = ()
    dull: Sequence[Cell] = ()


def next_goal(known: Known) -> Goal | None:
    """Where to look next, or None where nothing is left that could be seen from anywhere."""
    choice = _Choice(known)
    return choice.best(LARGE) or choice.best(LEAST)


def news_at(known: Known, cell: Cell) -> float:
    """Square metres of news in view from a cell, to all sides."""
    return float(_views_at(known, cell).sum())


def news_ahead(known: Known, cell: Cell, heading: float) -> float:
    """Square metres of news in the camera's view from a cell in a direction in degrees."""
    return float((_views_at(known, cell) * _ahead(known.fov, heading)).sum())


def _views_at(known: Known, cell: Cell) -> Numbers:
    reach = math.ceil(known.sight / known.cell) + 3
    top, left = max(0, cell[0] - reach), max(0, cell[1] - reach)
    window = known.grid[top : cell[0] + reach + 1, left : cell[1] + reach + 1]
    prospects = Prospects(kinds_of(window), known.sight / known.cell, known.cell)
    return prospects.views(np.array([cell[0] - top]), np.array([cell[1] - left]))[0]


def _ahead(fov: float, heading: float) -> Mask:
    """Which of the rays a camera that looks in a direction has in view."""
    return _apart(np.arange(RAYS) * (360.0 / RAYS), heading) <= fov / 2


def _apart(angles: Numbers, heading: float | Numbers) -> Numbers:
    """Degrees between directions, 0 to 180."""
    return np.abs((angles - heading + 180.0) % 360.0 - 180.0)


def value(news: Numbers) -> Numbers:
    """What square metres of news are worth, before the way there."""
    return np.sqrt(np.minimum(news, MOST))


class _Choice:
    """One choice of a goal, on the part of the grid that is known."""

    def __init__(self, known: Known) -> None:
        self._known = known
        self._side = max(1, round(BLOCK / known.cell))
        here = math.floor(known.pose.row), math.floor(known.pose.column)
        self._top, self._left, bottom, right = _extent(known.grid, here, self._side)
        window = np.s_[self._top : bottom, self._left : right]
        grid = known.grid[window]
        self._here = here[0] - self._top, here[1] - self._left
        kinds = kinds_of(grid)
        self._prospects = Prospects(kinds, known.sight / known.cell, known.cell)
        self._chances = _chances(kinds, self._side, known)
        passable = ~known.closed[window] & ~expanses(grid == UNKNOWN)
        self._passable = passable

    def best(self, least: float) -> Goal | None:
        """The place or turn that is worth most, of those that show so many square metres."""
        self._least = least
        goal, best = self._turn()
        for cell in (self._here, *map(self._inside, self._known.been)):
            self._chances[cell[0] // self._side, cell[1] // self._side] = 0.0
        self._wave = Wave(self._passable, self._here)
        passed, most, cell, news = 0, _RING, None, 0.0
        while True:
            rows, columns = self._wave.grow(math.ceil(most / (STEP * self._known.cell)))
            new = self._first_in_blocks(rows[passed:], columns[passed:])
            passed = len(rows)
            better = self._best_of(*new, best)
            if better is not None:
                cell, best, news = better
            if self._wave.is_over or best >= float(value(np.array(MOST))) / (most + AHEAD):
                break
            most *= 2
        if cell is None:
            return goal
        path = [(row + self._top, col + self._left) for row, col in self._wave.path_to(cell)]
        return Goal(tuple(path), 0.0, news)

    def _inside(self, cell: Cell) -> Cell:
        return cell[0] - self._top, cell[1] - self._left

    def _turn(self) -> tuple[Goal | None, float]:
        """The turn on the spot that is worth most, and its worth; of less than 0 for none."""
        known, (row, column) = self._known, self._here
        blocks = {(cell[0] // self._side, cell[1] // self._side) for cell in known.dull}
        absolute = (row + self._top) // self._side, (column + self._left) // self._side
        if absolute in blocks:
            return None, 0.0
        views = self._prospects.views(np.array([row]), np.array([column]))
        views[:, _ahead(known.fov, known.pose.angle)] = 0.0  # what is in view brings no more
        _, worths = self._arcs(views, np.zeros(1), np.array([known.pose.angle]))
        if not worths.any():
            return None, 0.0
        return self._sector(views[0]), float(worths[0])

    def _sector(self, views: Numbers) -> Goal:
        """The one look that is worth most for the turn to it."""
        angles = np.arange(RAYS) * (360.0 / RAYS)
        width = round(self._known.fov / 360.0 * RAYS)
        news = _around(views[np.newaxis], width)[0]
        turns = _apart(angles, self._known.pose.angle) / 180.0 * HALF_TURN
        worths = value(news) / (turns + AHEAD)
        best = int(np.argmax(worths))
        return Goal((), wrapped(float(angles[best])), float(news[best]))

    def _first_in_blocks(self, rows: Places, columns: Places) -> tuple[Places, Places]:
        """Of cells in the order of their ways the first in each block that has a chance."""
        wide = self._chances.shape[1]
        blocks = rows // self._side * wide + columns // self._side
        first = np.unique(blocks, return_index=True)[1]
        first = first[self._chances.ravel()[blocks[first]] >= self._least]
        return rows[first], columns[first]

    def _best_of(
        self, rows: Places, columns: Places, best: float
    ) -> tuple[Cell, float, float] | None:
        """The place that is worth most if it is worth more than the best so far; worth, news."""
        pose, cell = self._known.pose, self._known.cell
        chances = self._chances[rows // self._side, columns // self._side]
        metres = self._wave.steps[rows, columns] * (STEP * cell)
        down = rows + (self._top + 0.5 - pose.row)
        across = columns + (self._left + 0.5 - pose.column)
        bearings = np.degrees(portable.atan2(across, down))
        metres += _apart(bearings, pose.angle) / 180.0 * HALF_TURN
        bounds = value(chances) / (metres + AHEAD)
        order = np.argsort(-bounds, kind="stable")
        chosen = None
        for begin in range(0, len(order), _BATCH):
            batch = order[begin : begin + _BATCH]
            if bounds[batch[0]] <= best:
                break
            views = self._prospects.views(rows[batch], columns[batch])
            news, worths = self._arcs(views, metres[batch], bearings[batch])
            top = int(np.argmax(worths))
            if worths[top] > best:
                best = float(worths[top])
                at = int(rows[batch[top]]), int(columns[batch[top]])
                chosen = at, best, float(news[top])
        return chosen

    def _arcs(self, views: Numbers, metres: Numbers, arrival: Numbers) -> tuple[Numbers, Numbers]:
        """What is seen at each place by looking round as far as is best, and its worth; (n,) each.

        `views` is (n, RAYS), `metres` the way to each place, `arrival` the heading there.
        """
        angles = np.arange(RAYS) * (360.0 / RAYS)
        apart = _apart(angles, arrival[:, np.newaxis])
        seen, best = views.sum(axis=1), np.zeros(len(views))
        for sweep in _ARCS:
            width = min(RAYS, round((self._known.fov + sweep) / 360.0 * RAYS))
            news = _around(views, width)
            turn = np.maximum(apart - sweep / 2, 0.0) + sweep
            cost = metres[:, np.newaxis] + turn / 180.0 * HALF_TURN + AHEAD
            worths = np.where(news >= self._least, value(news), 0.0) / cost
            best = np.maximum(best, worths.max(axis=1))
        return seen, best


def _around(views: Numbers, width: int) -> Numbers:
    """For each ray the sum over as many rays around it; (n, RAYS)."""
    if width >= RAYS:
        return np.repeat(views.sum(axis=1, keepdims=True), RAYS, axis=1)
    before = width // 2
    around = np.concatenate((views[:, RAYS - before :], views, views[:, : width - before]), axis=1)
    sums = np.cumsum(np.pad(around, ((0, 0), (1, 0))), axis=1)
    return sums[:, width : width + RAYS] - sums[:, :RAYS]


def _extent(grid: Cells, here: Cell, side: int) -> tuple[int, int, int, int]:
    """The part of the grid that is known, and some more: top, left, bottom, right.

    It begins with a whole block, so that blocks are the same ones whatever is known.
    """
    spans: list[tuple[int, int]] = []
    for axis in (0, 1):
        known = np.flatnonzero((grid != UNKNOWN).any(axis=1 - axis))
        first = min(int(known[0]), here[axis]) if known.size else here[axis]
        last = max(int(known[-1]), here[axis]) if known.size else here[axis]
        margin = 3 * side
        begin = max(0, (first - margin) // side * side)
        spans.append((begin, min(grid.shape[axis], last + margin + 1)))
    (top, bottom), (left, right) = spans
    return top, left, bottom, right


def _chances(kinds: Kinds, side: int, known: Known) -> Numbers:
    """The most that can be seen from each block in square metres: all news as near as that."""
    free = _blocks((kinds != DARK) & (kinds != WALL), side) > 0
    dark = _blocks(kinds == DARK, side) * (_boxes(free.astype(np.int64), 9) > 0)
    news = _blocks(kinds == NEWS, side) + dark
    reach = math.ceil(known.sight / known.cell / side)
    return _boxes(news, reach) * (known.cell * known.cell)


def _blocks(mask: Mask, side: int) -> NDArray[np.int64]:
    """How many cells of each block are True."""
    rows, columns = mask.shape
    padded = np.pad(mask, ((0, -rows % side), (0, -columns % side)))
    shape = padded.shape[0] // side, side, padded.shape[1] // side, side
    return padded.reshape(shape).sum(axis=(1, 3))


def _boxes(numbers: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
    """For each item the sum of all that are at most `reach` rows and columns away."""
    sums = np.pad(numbers, reach)
    for axis in (0, 1):
        before = np.insert(sums, 0, 0, axis=axis).cumsum(axis=axis)
        count = numbers.shape[axis]
        ends = np.arange(count) + 2 * reach + 1
        sums = before.take(ends, axis=axis) - before.take(np.arange(count), axis=axis)
    return sums
