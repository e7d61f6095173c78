"""Next-best-view search for an unseen marker: maximum news per cost of travel.

News is ground known to be free that the camera has not seen, plus a limited depth of unknown space
behind free cells. The robot goes where it will see much news soon [next best view: Gonzalez-Banos,
Latombe 2002, "Navigation Strategies for Exploring Indoor Environments"]: among all cells, to the
one that maximises

  sqrt(visible news in m²) / (path + turns + AHEAD, in metres)

where turns, on the way and at the viewpoint, cost as much as driving for the same time. A turn on
the spot is one of the candidates, so a robot in a door looks around before it goes on. Each block
of half a metre has one candidate, and the search radius grows only while more distant candidates
can still win. `next_goal` is a pure function of the robot's knowledge.

What a camera would newly see from a cell is computed by ray casting, vectorised. A ray has the
camera's range, ends at known obstacles and passes a limited depth of unknown space, because shadows
end at the next wall. Specks of news, which lie between beams, do not count unless the search is
thorough, and gaps of up to two cells between obstacles are closed: beams that far apart hit one
wall. News left over between ground already seen counts `LEFT_OVER` times: to return for it later
would cost a journey, while open ground ahead remains as large. Without this, a search leaves strips
and corners everywhere and crosses the floor again for each of them. All counts are integers, so
they are identical on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grid import (
    FREE,
    UNKNOWN,
    Mask,
    block_sums,
    box_sums,
    expanses,
    grown,
    grown_to_sides,
    obstacles,
)
from minerva_agents.robot.planning import STEP, Wave
from minerva_agents.robot.pose import Cell, GridPose, wrapped
from minerva_bus import Cells, portable
from minerva_bus.values import fast_dataclass

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


@fast_dataclass
class Goal:
    """Next step of a search: drive along cells, or turn to a heading if there are none.

    `heading` is in degrees; `news` is the area in m² expected to be seen at the end.
    """

    cells: tuple[Cell, ...]
    heading: float
    news: float


@fast_dataclass
class SearchState:
    """What the search depends on.

    `grid` has the codes of `grid`; `closed` marks cells that the robot must not enter. `been`
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


def known_window(grid: Cells, here: Cell, side: int) -> tuple[int, int, int, int]:
    """The known part of the grid plus a margin: top, left, bottom, right.

    Aligned to whole blocks of `side` cells, so that blocks do not shift as the map grows.
    """
    spans: list[tuple[int, int]] = []
    for axis in (0, 1):
        lines = np.flatnonzero((grid != UNKNOWN).any(axis=1 - axis))
        first = min(int(lines[0]), here[axis]) if lines.size else here[axis]
        last = max(int(lines[-1]), here[axis]) if lines.size else here[axis]
        margin = 3 * side
        begin = max(0, (first - margin) // side * side)
        spans.append((begin, min(grid.shape[axis], last + margin + 1)))
    (top, bottom), (left, right) = spans
    return top, left, bottom, right


def news_bounds(kinds: Kinds, side: int, sight: float, cell: float) -> Numbers:
    """Upper bound on the news visible from each block, in m²: all news within range.

    `side` is that of a block in cells, `sight` the range and `cell` the cell side, in metres.
    """
    free = block_sums((kinds != DARK) & (kinds != WALL), side) > 0
    # A ray passes at most 4 m of unknown space; nine blocks of half a metre are more.
    dark = block_sums(kinds == DARK, side) * (box_sums(free.astype(np.int64), 9) > 0)
    news = block_sums(kinds == NEWS, side) + LEFT_OVER * block_sums(kinds == REST, side) + dark
    reach = math.ceil(sight / cell / side)
    return box_sums(news, reach) * (cell * cell)


# --- what a camera would see ----------------------------------------------------------------------


RAYS: Final = 48
"""Number of rays; ray i points at i * 360 / RAYS degrees in the grid's frame."""

_DEPTH: Final = 4.0
"""Maximum depth of unknown space that a ray passes, in metres."""

LEFT_OVER: Final = 3
"""How many times news counts that is left over."""

WORTH: Final = 3
"""The bits of a kind that say how many times a cell counts as news; a table takes longer."""

NOTHING: Final = 0
NEWS: Final = 1
REST: Final = LEFT_OVER
WALL: Final = 4
DARK: Final = 5

BLOCK: Final = 0.5
"""Side of a block in metres: for sums over many cells, and for candidates of a search."""

_AROUND: Final = 7
"""Blocks in each direction in which more seen than unseen ground makes news left over."""

Kinds = NDArray[np.uint8]
Counts = NDArray[np.int64]


def side_of(cell: float) -> int:
    """Side of a block in cells, for cells of so many metres."""
    return max(1, round(BLOCK / cell))


def kinds_of(grid: Cells, cell: float, is_thorough: bool = False) -> Kinds:
    """Class of each cell for ray casting: nothing, news, left over (rest), dark (unknown) or wall.

    Free and unknown specks are nothing, or, if `is_thorough`, news. `cell` is the cell side in
    metres.
    """
    walls = obstacles(grid)
    kinds = np.zeros(grid.shape, np.uint8)
    kinds[grid == FREE if is_thorough else expanses(grid == FREE)] = NEWS
    dark = _all_expanses(grid == UNKNOWN)
    kinds[dark] = DARK
    if is_thorough:
        kinds[(grid == UNKNOWN) & ~dark] = NEWS
    kinds[_closed(walls)] = WALL
    kinds[(kinds == NEWS) & _left_over(kinds, side_of(cell))] = REST
    return kinds


def _left_over(kinds: Kinds, side: int) -> Mask:
    """Cells of blocks that have more seen than unseen ground and no unknown ground around them."""
    unseen = box_sums(block_sums(kinds == NEWS, side), _AROUND)
    seen = box_sums(block_sums(kinds == NOTHING, side), _AROUND)
    dark = kinds == DARK
    border = box_sums(block_sums(dark & grown_to_sides(~dark & (kinds != WALL)), side), _AROUND)
    blocks = (unseen < seen) & (border == 0)
    rows, columns = kinds.shape
    return blocks.repeat(side, axis=0).repeat(side, axis=1)[:rows, :columns]


class Prospects:
    """Visibility from the cells of a grid of kinds (uint8, rows x columns).

    `sight` is the camera's range in cells, `cell` the cell side in metres.
    """

    def __init__(self, kinds: Kinds, sight: float, cell: float) -> None:
        self._reach = math.ceil(sight) + 1
        # Walls around the grid end all rays, so offsets need no bounds checks.
        padded = np.pad(kinds, self._reach, constant_values=WALL)
        self._width = padded.shape[1]
        self._kinds = padded.ravel()
        self._rows, self._columns, self._weights = _rays(sight)
        self._offsets = self._rows * self._width + self._columns
        self._steps = np.arange(len(self._weights))
        self._dark = max(1, math.floor(_DEPTH / cell))
        self._unit = 2.0 * math.pi / RAYS * cell * cell

    def views(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.float64]:
        """News in square metres along each ray from each of n cells; (n, RAYS)."""
        places = (rows + self._reach) * self._width + columns + self._reach
        seen = self._kinds.take(places[:, None, None] + self._offsets)
        # A wall behind the last step, so that every ray has a first end. Cumulative operations over
        # all cells would take longer than everything else.
        ends = np.ones((*seen.shape[:2], len(self._weights) + 1), np.bool_)
        ends[..., :-1] = seen == WALL
        first = ends.argmax(axis=2)
        # Deep inside unknown space there is probably a wall, so do not count all of it as news.
        dark = seen == DARK
        deep = (dark.sum(axis=2, dtype=np.uint16) > self._dark) & (first > self._dark)
        too_deep = np.cumsum(dark[deep], axis=1, dtype=np.uint16) > self._dark
        first[deep] = np.minimum(first[deep], too_deep.argmax(axis=1))
        is_open = self._steps < first[..., np.newaxis]
        return ((seen & WORTH) * is_open * self._weights).sum(axis=2) * self._unit


@lru_cache(maxsize=8)
def _rays(sight: float) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.int32]]:
    """Offsets in rows and columns of the cells on each ray, (RAYS, n), and the weight per step.

    A step's weight is the width of the ray's sector there, as a fraction of the circle.
    """
    steps = np.arange(1.0, max(sight, 1.5))  # one cell per step, so that no wall is skipped
    down, across = portable.cos_sin(np.radians(np.arange(RAYS) * 360.0 / RAYS))
    rows = np.floor(np.outer(down, steps) + 0.5).astype(np.intp)
    columns = np.floor(np.outer(across, steps) + 0.5).astype(np.intp)
    return rows, columns, np.rint(steps).astype(np.int32)


def _closed(walls: Mask) -> Mask:
    """Walls with gaps of up to two cells closed (morphological closing)."""
    return ~grown(~grown(np.pad(walls, 1)))[1:-1, 1:-1]


def _all_expanses(mask: Mask) -> Mask:
    """`expanses` with the mask continued beyond the grid."""
    return expanses(np.pad(mask, 2, constant_values=True))[2:-2, 2:-2]
