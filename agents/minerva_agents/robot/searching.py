"""Next-best-view search for an unseen marker: maximum news per cost of travel.

News is ground known to be free that the camera has not seen, plus a limited depth of unknown space
behind free cells. The robot goes where it will see much news soon [next best view: Gonzalez-Banos,
Latombe 2002, "Navigation Strategies for Exploring Indoor Environments"]: among all cells, to the
one that maximises

  sqrt(visible news in m²) / (path + turns + AHEAD, in metres)

where turns, on the way and at the viewpoint, cost as much as driving for the same time. A turn on
the spot is one of the candidates, so a robot in a door looks around before it goes on. Each block
of half a metre has one candidate, and the search radius grows only while more distant candidates
can still win. News that is left over between seen ground counts more (see `prospects`).

`next_goal` is a pure function of the robot's knowledge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.candidates import known_window, news_bounds
from minerva_agents.robot.grids import Mask
from minerva_agents.robot.knowledge import UNKNOWN
from minerva_agents.robot.looking import expanses
from minerva_agents.robot.motion import Cell, GridPose, wrapped
from minerva_agents.robot.prospects import RAYS, Prospects, kinds_of, side_of
from minerva_agents.robot.wave import STEP, Wave
from minerva_bus import Cells, portable

Numbers = NDArray[np.floating[Any]]
Places = NDArray[np.intp]

AHEAD: Final = 0.5
"""Constant added to every path, in metres, so that tiny news nearby does not attract the robot."""

HALF_TURN: Final = 1.0
"""Metres driven in the time of half a turn."""

MIN_NEWS: Final = 0.3
"""Square metres of news below which a look is not worthwhile."""

LARGE_NEWS: Final = 1.0
"""Square metres of news below which a look waits until no larger one is left."""

MAX_NEWS: Final = 30.0
"""Square metres of news above which a view gains no further value."""

_RING: Final = 8.0
"""Initial search radius along paths in metres; doubled as needed."""

# Candidates per ray casting: enough to use numpy well, few enough to stop early. With 32, a search
# takes a quarter longer, with 8 an eighth.
_BATCH_SIZE: Final = 16
_ARCS: Final = (0.0, 60.0, 120.0, 300.0)
"""Angles in degrees that the robot sweeps at a viewpoint."""


@dataclass(frozen=True, slots=True)
class Goal:
    """Next step of a search: drive along cells, or turn to a heading if there are none.

    `heading` is in degrees; `news` is the area in m² expected to be seen at the end.
    """

    cells: tuple[Cell, ...]
    heading: float
    news: float


@dataclass(frozen=True, slots=True)
class SearchState:
    """What the search depends on.

    `grid` has the codes of `knowledge`; `closed` marks cells that the robot must not enter. `been`
    are viewpoints already visited, `dull` cells where a turn revealed nothing new; neither is
    chosen again. `fov` and `sight` are the camera's field of view (degrees) and range (metres);
    `cell` is the cell side in metres. A thorough search does not ignore specks of unseen ground.
    """

    grid: Cells
    closed: Mask
    pose: GridPose
    cell: float
    fov: float = 60.0
    sight: float = 5.0
    been: Sequence[Cell] = ()
    dull: Sequence[Cell] = ()
    is_thorough: bool = False


def next_goal(state: SearchState) -> Goal | None:
    """Next viewpoint or turn, or None if nothing unseen is visible from anywhere.

    A robot that stands near a marker leaves only a narrow strip unseen: the part of its shadow that
    is common to all viewpoints. So a thorough search ends with single cells.
    """
    choice = _Choice(state)
    goal = choice.best(LARGE_NEWS) or choice.best(MIN_NEWS)
    if goal is None and state.is_thorough:
        return choice.best(state.cell * state.cell)
    return goal


def news_at(state: SearchState, cell: Cell) -> float:
    """Square metres of news visible from a cell, in all directions."""
    return float(_views_at(state, cell).sum())


def news_ahead(state: SearchState, cell: Cell, heading: float) -> float:
    """Square metres of news in the camera's view from a cell at a heading in degrees."""
    return float((_views_at(state, cell) * _ahead(state.fov, heading)).sum())


def _views_at(state: SearchState, cell: Cell) -> Numbers:
    reach = math.ceil(state.sight / state.cell) + 3
    top, left = max(0, cell[0] - reach), max(0, cell[1] - reach)
    window = state.grid[top : cell[0] + reach + 1, left : cell[1] + reach + 1]
    kinds = kinds_of(window, state.cell, state.is_thorough)
    prospects = Prospects(kinds, state.sight / state.cell, state.cell)
    return prospects.views(np.array([cell[0] - top]), np.array([cell[1] - left]))[0]


def _ahead(fov: float, heading: float) -> Mask:
    """Mask of the rays within the camera's field of view at a heading."""
    return _apart(np.arange(RAYS) * (360.0 / RAYS), heading) <= fov / 2


def _apart(angles: Numbers, heading: float | Numbers) -> Numbers:
    """Absolute angle between directions, 0 to 180 degrees."""
    return np.abs((angles - heading + 180.0) % 360.0 - 180.0)


def value(news: Numbers) -> Numbers:
    """Value of square metres of news, before the cost of travel."""
    return np.sqrt(np.minimum(news, MAX_NEWS))


class _Choice:
    """One selection of a goal, on the known part of the grid."""

    def __init__(self, state: SearchState) -> None:
        self._state = state
        self._side = side_of(state.cell)
        here = math.floor(state.pose.row), math.floor(state.pose.column)
        self._top, self._left, bottom, right = known_window(state.grid, here, self._side)
        window = np.s_[self._top : bottom, self._left : right]
        grid = state.grid[window]
        self._here = here[0] - self._top, here[1] - self._left
        kinds = kinds_of(grid, state.cell, state.is_thorough)
        self._prospects = Prospects(kinds, state.sight / state.cell, state.cell)
        self._bounds = news_bounds(kinds, self._side, state.sight, state.cell)
        # Specks of unknown cells, which lie between beams, are passable.
        passable = ~state.closed[window] & ~expanses(grid == UNKNOWN)
        self._passable = passable

    def best(self, least: float) -> Goal | None:
        """The best viewpoint or turn among those with at least `least` m² of news."""
        self._least = least
        goal, best = self._turn()
        for cell in (self._here, *map(self._inside, self._state.been)):
            self._bounds[cell[0] // self._side, cell[1] // self._side] = 0.0
        self._wave = Wave(self._passable, self._here)
        passed, most, cell, news = 0, _RING, None, 0.0
        # Near cells first: farther ones are examined only as long as they could still be better.
        while True:
            rows, columns = self._wave.grow(math.ceil(most / (STEP * self._state.cell)))
            new = self._first_in_blocks(rows[passed:], columns[passed:])
            passed = len(rows)
            better = self._best_of(*new, best)
            if better is not None:
                cell, best, news = better
            # Even the largest news at this distance would be worth less than the best so far.
            if self._wave.is_over or best >= float(value(np.array(MAX_NEWS))) / (most + AHEAD):
                break
            most *= 2
        if cell is None:
            return goal
        path = [(row + self._top, col + self._left) for row, col in self._wave.path_to(cell)]
        return Goal(tuple(path), 0.0, news)

    def _inside(self, cell: Cell) -> Cell:
        return cell[0] - self._top, cell[1] - self._left

    def _turn(self) -> tuple[Goal | None, float]:
        """The best turn on the spot and its value; None and 0 without any."""
        state, (row, column) = self._state, self._here
        blocks = {(cell[0] // self._side, cell[1] // self._side) for cell in state.dull}
        absolute = (row + self._top) // self._side, (column + self._left) // self._side
        if absolute in blocks:
            return None, 0.0
        views = self._prospects.views(np.array([row]), np.array([column]))
        views[:, _ahead(state.fov, state.pose.angle)] = 0.0  # already in view, so no news
        _, worths = self._arcs(views, np.zeros(1), np.array([state.pose.angle]))
        if not worths.any():
            return None, 0.0
        return self._sector(views[0]), float(worths[0])

    def _sector(self, views: Numbers) -> Goal:
        """The best heading for one look, given the cost of turning to it."""
        angles = np.arange(RAYS) * (360.0 / RAYS)
        width = round(self._state.fov / 360.0 * RAYS)
        news = _around(views[np.newaxis], width)[0]
        turns = _apart(angles, self._state.pose.angle) / 180.0 * HALF_TURN
        worths = value(news) / (turns + AHEAD)
        best = int(np.argmax(worths))
        return Goal((), wrapped(float(angles[best])), float(news[best]))

    def _first_in_blocks(self, rows: Places, columns: Places) -> tuple[Places, Places]:
        """The first cell of each promising block, in order of path length."""
        wide = self._bounds.shape[1]
        blocks = rows // self._side * wide + columns // self._side
        # Cells are in the order of path length, and `unique` gives the index of the first.
        first = np.unique(blocks, return_index=True)[1]
        first = first[self._bounds.ravel()[blocks[first]] >= self._least]
        return rows[first], columns[first]

    def _best_of(
        self, rows: Places, columns: Places, best: float
    ) -> tuple[Cell, float, float] | None:
        """The best candidate if it beats `best`: cell, value, news."""
        pose, cell = self._state.pose, self._state.cell
        news_bounds = self._bounds[rows // self._side, columns // self._side]
        metres = self._wave.steps[rows, columns] * (STEP * cell)
        down = rows + (self._top + 0.5 - pose.row)
        across = columns + (self._left + 0.5 - pose.column)
        bearings = np.degrees(portable.atan2(across, down))
        # The first turn, estimated from the bearing of the candidate instead of its path.
        metres += _apart(bearings, pose.angle) / 180.0 * HALF_TURN
        bounds = value(news_bounds) / (metres + AHEAD)
        # In the order of upper bounds, so that most candidates need no ray casting.
        order = np.argsort(-bounds, kind="stable")
        chosen = None
        for begin in range(0, len(order), _BATCH_SIZE):
            batch = order[begin : begin + _BATCH_SIZE]
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
        """News and value of sweeping by the best angle at each candidate; (n,) each.

        `views` is (n, RAYS), `metres` the path length to each candidate, `arrival` the heading
        there.
        """
        angles = np.arange(RAYS) * (360.0 / RAYS)
        apart = _apart(angles, arrival[:, np.newaxis])
        seen, best = views.sum(axis=1), np.zeros(len(views))
        for sweep in _ARCS:
            width = min(RAYS, round((self._state.fov + sweep) / 360.0 * RAYS))
            news = _around(views, width)
            turn = np.maximum(apart - sweep / 2, 0.0) + sweep
            cost = metres[:, np.newaxis] + turn / 180.0 * HALF_TURN + AHEAD
            worths = np.where(news >= self._least, value(news), 0.0) / cost
            best = np.maximum(best, worths.max(axis=1))
        return seen, best


def _around(views: Numbers, width: int) -> Numbers:
    """Per ray, the sum over the `width` rays around it; (n, RAYS)."""
    if width >= RAYS:
        return np.repeat(views.sum(axis=1, keepdims=True), RAYS, axis=1)
    before = width // 2
    # A sliding sum over the circle, as a difference of cumulative sums, which begin with 0.
    first = np.zeros((len(views), 1), views.dtype)
    around = (first, views[:, RAYS - before :], views, views[:, : width - before])
    sums = np.cumsum(np.concatenate(around, axis=1), axis=1)
    return sums[:, width : width + RAYS] - sums[:, :RAYS]
