"""Exact shortest paths on a grid of free and blocked cells.

A grid is indexed [row, column]; row grows along world x, column along world y. A move goes to one
of eight neighbours and costs 1 straight or sqrt(2) diagonally. A diagonal needs both adjacent cells
free, so no corner is cut.

The search is A* [Hart, Nilsson, Raphael 1968; the paper, 4.2.5] over the jump points of module
`jumps`, in windows of growing size. Both reduce time and memory without changing the length of a
path.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise
from typing import Final

import numpy as np

from minerva_agents.robot.grids import MapError, Mask, check_grid
from minerva_agents.robot.jumps import DIAGONAL, LEAP, STRAIGHT, Jumps, jumps_of
from minerva_agents.robot.motion import Cell

_MARGIN: Final = 48
"""Cells around the ends of a path in the first window."""
_GROWTH: Final = 4
"""Factor by which the margin grows from window to window."""


@dataclass(frozen=True, slots=True)
class Window:
    """The cells (row, column) with top <= row < bottom and left <= column < right of a grid."""

    top: int
    left: int
    bottom: int
    right: int
    shape: tuple[int, int]

    @property
    def cut(self) -> tuple[slice, slice]:
        """Slices of the window."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def inside(self, cell: Cell) -> Cell:
        """A grid cell in the window's coordinates."""
        return cell[0] - self.top, cell[1] - self.left

    def way_out(self, ends: Sequence[Cell]) -> float:
        """Lower bound on the length of paths between the ends that leave the window.

        The shortest path via a line of cells just outside on an empty grid, infinite where the
        window ends at the grid's border. With one end: a path from it to that line.
        """
        return min(
            [_over(line, axis, ends) for axis, line in self._lines_outside()], default=math.inf
        )

    def _lines_outside(self) -> Iterator[tuple[int, int]]:
        for axis, (low, high) in enumerate(((self.top, self.bottom), (self.left, self.right))):
            if low > 0:
                yield axis, low - 1
            if high < self.shape[axis]:
                yield axis, high


def windows(shape: tuple[int, int], ends: Sequence[Cell]) -> Iterator[Window]:
    """Windows of growing size around the ends of a path; the last is the whole grid.

    Windows of half the grid or more are skipped, because the whole grid costs little more.
    """
    margin = _MARGIN
    while True:
        top, left = (max(0, min(end[axis] for end in ends) - margin) for axis in (0, 1))
        bottom, right = (
            min(shape[axis], max(end[axis] for end in ends) + margin + 1) for axis in (0, 1)
        )
        if 2 * (bottom - top) * (right - left) >= shape[0] * shape[1]:
            yield Window(0, 0, *shape, shape)
            return
        yield Window(top, left, bottom, right, shape)
        margin *= _GROWTH


def _over(line: int, axis: int, ends: Sequence[Cell]) -> float:
    """Octile length of a path from the first end via a line to the other end, if any.

    Computed by mirroring the other end at the line.
    """
    first, last = ends[0], ends[-1]
    if len(ends) == 1:
        return float(abs(line - first[axis]))
    across = abs(line - first[axis]) + abs(line - last[axis])
    along = abs(first[1 - axis] - last[1 - axis])
    return max(across, along) + (math.sqrt(2.0) - 1.0) * min(across, along)


@dataclass(frozen=True, slots=True)
class GridPath:
    """Cells from start to goal, each adjacent to the previous, and the length in cells.

    The length is computed from the counts of straight and diagonal moves, so it has no summation
    error.
    """

    cells: tuple[Cell, ...]
    length: float


def shortest_path(blocked: Mask, start: Cell, goal: Cell) -> GridPath | None:
    """A shortest path between two cells of a bool grid, or None.

    The heuristic is the octile distance, the path length on an empty grid. The paper (4.2.5) uses
    the Euclidean distance to the goal; with eight moves, the octile distance is at least that and
    never above the true length. It is admissible, yields the same lengths and expands fewer cells.
    Ties are broken deterministically.

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


def nearest(blocked: Mask, start: Cell, targets: Mask) -> GridPath | None:
    """A shortest path to the target cell nearest by path, or None if none is reachable.

    Dijkstra's algorithm (1959), which ends at the first settled target: the step to the nearest
    frontier in exploration. `blocked` and `targets` are bool grids of one shape; blocked targets
    are ignored. Raises MapError for other grids and for a start outside them.
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


def _cell_of(grid: Mask, cell: Cell, who: str, name: str) -> Cell:
    """The cell as Python integers (numpy's would overflow in costs). Raises MapError if outside."""
    rows, columns = grid.shape
    row, column = int(cell[0]), int(cell[1])
    if (row, column) != tuple(cell) or not (0 <= row < rows and 0 <= column < columns):
        raise MapError(
            f"{who}: {name} {tuple(cell)} is outside the grid; "
            f"expected a whole row below {rows} and column below {columns}, both from 0"
        )
    return row, column


def _search(blocked: Mask, start: Cell, targets: Mask, goal: Cell | None) -> GridPath | None:
    """A* to the goal, or Dijkstra's algorithm to the nearest target without a goal.

    A window's result is final if no path that leaves the window can be shorter.
    """
    if blocked[start]:
        return None
    if targets[start]:
        return GridPath((start,), 0.0)
    ends = [start] if goal is None else [start, goal]
    path = None
    for window in windows(blocked.shape, ends):
        path = _search_window(window, blocked[window.cut], targets[window.cut], start, goal)
        if path is not None and path.length <= window.way_out(ends):
            break
    return path


def _search_window(
    window: Window, blocked: Mask, targets: Mask, start: Cell, goal: Cell | None
) -> GridPath | None:
    if not targets.any():
        return None
    jumps = jumps_of(blocked, targets)
    estimate = _no_estimate if goal is None else _octile_to(jumps, window.inside(goal))
    turns = _turns(jumps, jumps.flat(window.inside(start)), estimate)
    cells = [jumps.cell(turn) for turn in turns]
    return _path_along([(row + window.top, column + window.left) for row, column in cells])


def _turns(jumps: Jumps, origin: int, estimate: Callable[[int], int]) -> list[int]:
    """A* over jump points: the flat turning cells of a shortest path with both ends, or [].

    A cell has one cost and one arrival direction, that of the first path of this cost. For each
    continuation that only another direction would allow, an equally short path avoids the cell.
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
            # Rarely, a jump is longer than a table entry can hold.
            if moves == LEAP:
                moves = way.jump(cell)
            after = cell + moves * way.step
            total = cost + moves * way.cost
            if after not in costs or total < costs[after]:
                costs[after], arrivals[after] = total, 8 * cell + way.number
                remaining = estimate(after)
                # Of equal bounds, the cell nearest to the goal comes first; its index makes ties
                # deterministic.
                heappush(queue, (total + remaining, remaining, after))
        cell, cost = _cheapest(queue, costs)
        if cell < 0:
            return []
        ways = jumps.ways[arrivals[cell] % 8][jumps.corners[cell]]
    return _back(arrivals, cell)


def _cheapest(queue: list[tuple[int, int, int]], costs: dict[int, int]) -> tuple[int, int]:
    """The next cell of the queue and its cost, or (-1, 0) if the queue is empty."""
    while queue:
        bound, remaining, cell = heappop(queue)
        # Entries with another cost have been replaced by cheaper ones.
        if bound - remaining == costs[cell]:
            return cell, bound - remaining
    return -1, 0


def _back(arrivals: dict[int, int], cell: int) -> list[int]:
    """The cells up to this one; an arrival encodes 8 times the previous cell plus the direction."""
    turns = [cell]
    while cell in arrivals:
        cell = arrivals[cell] // 8
        turns.append(cell)
    return turns[::-1]


def _octile_to(jumps: Jumps, goal: Cell) -> Callable[[int], int]:
    """Heuristic: cost from a flat cell to the goal on an empty grid."""
    row, column = goal[0] + 1, goal[1] + 1
    width, saved = jumps.width, 2 * STRAIGHT - DIAGONAL

    def estimate(cell: int) -> int:
        across, along = abs(cell // width - row), abs(cell % width - column)
        return STRAIGHT * (across + along) - saved * (across if across < along else along)

    return estimate


def _no_estimate(cell: int) -> int:
    return 0


def _path_along(turns: Sequence[Cell]) -> GridPath | None:
    """The path along turning cells, or None without any."""
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
    return GridPath(tuple(cells), len(cells) - 1 - diagonals + math.sqrt(2.0) * diagonals)
