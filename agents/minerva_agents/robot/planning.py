"""Shortest paths on a grid of free and blocked cells, exact and fast.

A grid is indexed [row, column]; row grows along world x, column along world y. A move goes to one
of the eight neighbours: it costs 1 straight and sqrt(2) diagonally, and a diagonal needs both
cells that it passes between to be free, so that no corner is cut.

The search is A* [Hart, Nilsson, Raphael 1968; the paper, 4.2.5] over the jump points of the
module `jumps`, in the windows of the module `windows`. Both change the time and the memory that a
search takes, never the length of its path.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np

from minerva_agents.robot.grids import Cell, Grid, MapError, check_grid
from minerva_agents.robot.jumps import DIAGONAL, LEAP, STRAIGHT, Jumps, jumps_of
from minerva_agents.robot.windows import Window, windows


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
    return _search(blocked, start, targets, goal)


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
    return _search(blocked, start, reachable, None) if reachable.any() else None


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


def _search(blocked: Grid, start: Cell, targets: Grid, goal: Cell | None) -> Path | None:
    """A* to the goal, or Dijkstra's search for the nearest target where there is no goal.

    What a search of a window finds holds if no path that leaves the window can be shorter.
    """
    if blocked[start]:
        return None
    if targets[start]:
        return Path((start,), 0.0)
    ends = [start] if goal is None else [start, goal]
    path = None
    for window in windows(blocked.shape, ends):
        path = _search_window(window, blocked[window.cut], targets[window.cut], start, goal)
        if path is not None and path.length <= window.way_out(ends):
            break
    return path


def _search_window(
    window: Window, blocked: Grid, targets: Grid, start: Cell, goal: Cell | None
) -> Path | None:
    if not targets.any():
        return None
    jumps = jumps_of(blocked, targets)
    estimate = _nothing if goal is None else _octile_to(jumps, window.inside(goal))
    turns = _turns(jumps, jumps.flat(window.inside(start)), estimate)
    cells = [jumps.cell(turn) for turn in turns]
    return _path([(row + window.top, column + window.left) for row, column in cells])


def _turns(jumps: Jumps, origin: int, estimate: Callable[[int], int]) -> list[int]:
    """A* over jump points: the flat cells where a shortest path turns, with both ends, or none.

    A cell has one cost and one direction of arrival, that of the first path of this cost. For each
    way on that only another direction would open, there is a path as short that avoids the cell.
    """
    arrivals: dict[int, int] = {}
    costs = {origin: 0}
    queue: list[tuple[int, int, int]] = []
    cell, cost, ways = origin, 0, jumps.directions
    while not jumps.targets[cell]:
        for way in ways:
            moves = way.jumps[cell]
            if not moves:
                continue
            if moves == LEAP:
                moves = way.jump(cell)
            after = cell + moves * way.step
            total = cost + moves * way.cost
            if after not in costs or total < costs[after]:
                costs[after], arrivals[after] = total, 8 * cell + way.number
                remaining = estimate(after)
                heappush(queue, (total + remaining, remaining, after))
        cell, cost = _cheapest(queue, costs)
        if cell < 0:
            return []
        ways = jumps.ways[arrivals[cell] % 8][jumps.corners[cell]]
    return _back(arrivals, cell)


def _cheapest(queue: list[tuple[int, int, int]], costs: dict[int, int]) -> tuple[int, int]:
    """The next cell of the queue and its cost, or (-1, 0) if there is none."""
    while queue:
        bound, remaining, cell = heappop(queue)
        if bound - remaining == costs[cell]:
            return cell, bound - remaining
    return -1, 0


def _back(arrivals: dict[int, int], cell: int) -> list[int]:
    """The cells up to this one; an arrival is 8 times the cell before plus the direction."""
    turns = [cell]
    while cell in arrivals:
        cell = arrivals[cell] // 8
        turns.append(cell)
    return turns[::-1]


def _octile_to(jumps: Jumps, goal: Cell) -> Callable[[int], int]:
    """The cost from a flat cell to the goal if nothing were blocked."""
    row, column = goal[0] + 1, goal[1] + 1
    width, saved = jumps.width, 2 * STRAIGHT - DIAGONAL

    def estimate(cell: int) -> int:
        across, along = abs(cell // width - row), abs(cell % width - column)
        return STRAIGHT * (across + along) - saved * (across if across < along else along)

    return estimate


def _nothing(cell: int) -> int:
    return 0


def _path(turns: Sequence[Cell]) -> Path | None:
    """The path along its turns; none of them is no path."""
    if not turns:
        return None
    cells = [turns[0]]
    diagonals = 0
    for (row, column), (to_row, to_column) in pairwise(turns):
        down, along = to_row - row, to_column - column
        moves = max(abs(down), abs(along))
        diagonals += min(abs(down), abs(along))
        down, along = down // moves, along // moves
        cells += [(row + n * down, column + n * along) for n in range(1, moves + 1)]
    return Path(tuple(cells), len(cells) - 1 - diagonals + math.sqrt(2.0) * diagonals)
