"""Shortest paths on a grid of free and blocked cells, exact and fast.

A grid is indexed [row, column]; row grows along world x, column along world y. A move goes to one
of the eight neighbours: it costs 1 straight and sqrt(2) diagonally, and a diagonal needs both
cells that it passes between to be free, so that no corner is cut.

The search is A* [Hart, Nilsson, Raphael 1968; the paper, 4.2.5] over jump points: of all the
equally short paths only one that goes diagonally as early as it can is followed, so the queue
holds only the cells where such a path may turn [Harabor, Grastien 2011, "Online Graph Pruning for
Pathfinding on Grid Maps"]. Where each of the eight rays from a cell ends is looked up in tables
that numpy fills for the whole grid at once [Harabor, Grastien 2014, "Improving Jump Point
Search"]. This changes the time that a search takes, never the length of what it finds.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Cell, Grid, MapError, check_grid

# Costs are whole numbers so that equal lengths compare equal however they were summed. Two
# different lengths of n moves are at least about 1 / (3 n) apart, 60 bits are far finer than that.
_STRAIGHT = 1 << 60
_DIAGONAL = math.isqrt(2 << 120)

# A direction is an index into this ring, counter-clockwise; the odd ones are diagonals.
_RING = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))


@dataclass(frozen=True, slots=True)
class Path:
    """Cells from start to goal, each a neighbour of the one before, and the length in cells.

    The length is computed once from the numbers of straight and diagonal moves, so it carries no
    error of summation.
    """

    cells: tuple[Cell, ...]
    length: float


def shortest_path(blocked: Grid, start: Cell, goal: Cell) -> Path | None:
    """A shortest path between two cells of a grid (bool, rows x columns), or None without one.

    The estimate of what remains is the octile distance, the length of the path if nothing were
    blocked. The paper (4.2.5) weighs cells by the Euclidean distance to the goal; with these eight
    moves the octile distance is never below that and never above the true length, so it is
    admissible, finds the same lengths and looks at fewer cells. Ties are broken always alike.

    A blocked start or goal has no path. Raises MapError for a grid that is not 2-D bool and for
    cells outside it.
    """
    check_grid(blocked, "shortest_path", "blocked")
    start = _cell_of(blocked, start, "shortest_path", "start")
    goal = _cell_of(blocked, goal, "shortest_path", "goal")
    if blocked[goal]:
        return None
    targets = np.zeros(blocked.shape, np.bool_)
    targets[goal] = True
    return _search(blocked, start, targets, _octile_to(goal, blocked.shape[1] + 2))


def nearest(blocked: Grid, start: Cell, targets: Grid) -> Path | None:
    """A shortest path to whichever target cell is nearest by path, or None if none is reachable.

    Dijkstra's search (1959), which ends at the first target that it settles: the step to the next
    frontier in exploration. `blocked` and `targets` are bool grids of one shape; blocked targets
    do not count. Raises MapError for other grids and for a start outside them.
    """
    check_grid(blocked, "nearest", "blocked")
    check_grid(targets, "nearest", "targets")
    start = _cell_of(blocked, start, "nearest", "start")
    if targets.shape != blocked.shape:
        raise MapError(
            f"nearest: targets is {targets.shape}, expected the shape of blocked, {blocked.shape}"
        )
    reachable = targets & ~blocked
    return _search(blocked, start, reachable, lambda _: 0) if reachable.any() else None


def _cell_of(grid: Grid, cell: Cell, who: str, name: str) -> Cell:
    """The cell in Python's own integers (numpy's would overflow in the costs), if it is inside."""
    rows, columns = grid.shape
    row, column = int(cell[0]), int(cell[1])
    if (row, column) != tuple(cell) or not (0 <= row < rows and 0 <= column < columns):
        raise MapError(
            f"{who}: {name} {tuple(cell)} is no cell of the grid; "
            f"expected a whole row below {rows} and column below {columns}, both from 0"
        )
    return row, column


@dataclass(frozen=True, slots=True)
class _Tables:
    """A grid with a blocked rim, flattened, and for each direction where the ray from a cell ends.

    `jumps[direction][cell]` is the first cell ahead where a path may turn or end, 0 (a cell of the
    rim) if a wall comes first.
    """

    width: int
    steps: tuple[int, ...]
    free: bytes
    targets: bytes
    jumps: tuple[memoryview, ...]


def _search(
    blocked: Grid, start: Cell, targets: Grid, estimate: Callable[[int], int]
) -> Path | None:
    """A* over jump points to the cheapest target; with an estimate of 0 it is Dijkstra's search.

    A state is a cell and the direction of arrival, because that decides which ways on are worth
    a look: state = 8 * cell + direction.
    """
    if blocked[start]:
        return None
    if targets[start]:
        return Path((start,), 0.0)
    tables = _tables(blocked, targets)
    origin = (start[0] + 1) * tables.width + start[1] + 1
    parents: dict[int, int] = {}
    costs: dict[int, int] = {}
    queue: list[tuple[int, int, int]] = []

    def push_successors(cell: int, state: int, cost: int, directions: tuple[int, ...]) -> None:
        for direction in directions:
            after = tables.jumps[direction][cell]
            if not after:
                continue
            moves = (after - cell) // tables.steps[direction]
            total = cost + moves * (_DIAGONAL if direction & 1 else _STRAIGHT)
            key = after * 8 + direction
            if key not in costs or total < costs[key]:
                costs[key], parents[key] = total, state
                remaining = estimate(after)
                heappush(queue, (total + remaining, remaining, key))

    push_successors(origin, origin * 8, 0, tuple(range(8)))
    while queue:
        bound, remaining, state = heappop(queue)
        cell, direction = divmod(state, 8)
        if tables.targets[cell]:
            return _path(tables.width, origin, state, parents)
        cost = bound - remaining
        if cost == costs[state]:
            push_successors(cell, state, cost, _ways_on(tables, cell, direction))
    return None


def _ways_on(tables: _Tables, cell: int, direction: int) -> tuple[int, ...]:
    """The directions that an early-diagonal shortest path may take on from a cell.

    From a diagonal: on, or straight to either side of it. From a straight move: on, and round the
    corner on each side where the cell behind is blocked, for only then is there no shorter way.
    """
    left, right = (direction + 1) % 8, (direction - 1) % 8
    if direction & 1:
        return left, direction, right
    ways = [direction]
    behind = cell - tables.steps[direction]
    for diagonal, side in ((left, (direction + 2) % 8), (right, (direction - 2) % 8)):
        step = tables.steps[side]
        if tables.free[cell + step] and not tables.free[behind + step]:
            ways += [diagonal, side]
    return tuple(ways)


def _tables(blocked: Grid, targets: Grid) -> _Tables:
    width = blocked.shape[1] + 2
    steps = tuple(row * width + column for row, column in _RING)
    free = np.pad(~blocked, 1).ravel()
    ends = np.pad(targets, 1).ravel()
    jumps: list[NDArray[np.int32]] = [np.empty(0, np.int32)] * 8
    for direction in (0, 2, 4, 6):
        turns = ends | _corners(free, steps, direction)
        is_open = free & _ahead(free, steps[direction])
        jumps[direction] = _jumps(is_open, turns, steps[direction])
    for direction in (1, 3, 5, 7):
        sides = (direction - 1, (direction + 1) % 8)
        turns = ends | (jumps[sides[0]] > 0) | (jumps[sides[1]] > 0)
        is_open = free & _ahead(free, steps[direction])
        for side in sides:
            is_open &= _ahead(free, steps[side])
        jumps[direction] = _jumps(is_open, turns, steps[direction])
    views = tuple(memoryview(jump.tobytes()).cast("i") for jump in jumps)
    return _Tables(width, steps, free.tobytes(), ends.tobytes(), views)


def _ahead(flat: Grid, step: int) -> Grid:
    """For each cell the value of the cell one step ahead.

    What is rolled in from the other end lands on cells of the rim, which are blocked anyway.
    """
    return np.roll(flat, -step)


def _corners(free: Grid, steps: tuple[int, ...], direction: int) -> Grid:
    """Cells where a straight move has just passed a corner: free beside, blocked beside-behind."""
    found = np.zeros(free.shape, np.bool_)
    for side in ((direction + 2) % 8, (direction - 2) % 8):
        beside = _ahead(free, steps[side])
        found |= beside & ~_ahead(beside, -steps[direction])
    return found & free & _ahead(free, -steps[direction])


def _jumps(is_open: Grid, turns: Grid, step: int) -> NDArray[np.int32]:
    """For each cell the next turn along the steps, if every move up to it is open; else 0."""
    stop = np.roll(_first_along(turns | ~is_open, step), -step)
    return np.where(is_open & turns[stop], stop, 0).astype(np.int32)


def _first_along(stops: Grid, step: int) -> NDArray[np.int32]:
    """For each flat cell the index of the first stop along the steps, itself included; else 0.

    Cells that are a step apart stand one above the other once the flat grid is folded into rows
    as long as the step; so diagonals become columns, and one accumulation answers for all of them.
    """
    fold, size = abs(step), stops.size
    rows = -(-size // fold)
    index = np.arange(rows * fold, dtype=np.int32)
    mark = np.zeros(rows * fold, np.bool_)
    mark[:size] = stops
    if step < 0:
        column = np.where(mark, index, 0).reshape(rows, fold)
        return np.maximum.accumulate(column, axis=0).ravel()[:size]
    beyond = np.int32(rows * fold)
    column = np.where(mark, index, beyond).reshape(rows, fold)
    first = np.minimum.accumulate(column[::-1], axis=0)[::-1].ravel()[:size]
    return np.where(first == beyond, np.int32(0), first)


def _octile_to(goal: Cell, width: int) -> Callable[[int], int]:
    """The cost from a flat cell to the goal if nothing were blocked."""
    row, column = goal[0] + 1, goal[1] + 1
    saved = 2 * _STRAIGHT - _DIAGONAL

    def estimate(cell: int) -> int:
        across, along = abs(cell // width - row), abs(cell % width - column)
        return _STRAIGHT * (across + along) - saved * min(across, along)

    return estimate


def _path(width: int, origin: int, state: int, parents: dict[int, int]) -> Path:
    corners = [state // 8]
    while corners[-1] != origin:
        state = parents[state]
        corners.append(state // 8)
    points = [(flat // width - 1, flat % width - 1) for flat in reversed(corners)]
    cells = [points[0]]
    diagonals = 0
    for (row, column), (to_row, to_column) in pairwise(points):
        down, along = to_row - row, to_column - column
        moves = max(abs(down), abs(along))
        diagonals += min(abs(down), abs(along))
        down, along = down // moves, along // moves
        cells += [(row + n * down, column + n * along) for n in range(1, moves + 1)]
    return Path(tuple(cells), len(cells) - 1 - diagonals + math.sqrt(2.0) * diagonals)
