"""Exact shortest paths on a grid of free and blocked cells, and waves of approximate distances.

A grid is indexed [row, column]; row grows along world x, column along world y. A move goes to one
of eight neighbours and costs 1 straight or sqrt(2) diagonally. A diagonal needs both adjacent cells
free, so no corner is cut.

The search is A* [Hart, Nilsson, Raphael 1968; the paper, 4.2.5] over jump points, in windows of
growing size. Both reduce time and memory without changing the length of a path. Among equally short
paths, only the one that goes diagonally as early as possible is followed, so a search stops only
where such a path may turn [Harabor, Grastien 2011, "Online Graph Pruning for Pathfinding on Grid
Maps"]. numpy computes the next jump point for all cells at once [Harabor, Grastien 2014, "Improving
Jump Point Search"].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from heapq import heappop, heappush
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grid import MapError, Mask, check_grid
from minerva_agents.robot.pose import Cell
from minerva_bus.values import fast_dataclass

_MARGIN: Final = 48
"""Cells around the ends of a path in the first window."""
_GROWTH: Final = 4
"""Factor by which the margin grows from window to window."""


@fast_dataclass
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


@fast_dataclass
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


# A direction is an index into this ring, counter-clockwise; odd indices are diagonals.
# --- jump points ----------------------------------------------------------------------------------


_RING: Final = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_LINES_AT_ONCE: Final = 512

# Costs are integers so that equal lengths compare equal regardless of summation order. Two
# different lengths of n moves differ by at least about 1 / (3 n); 60 bits are far finer than that.
STRAIGHT: Final = 1 << 60
DIAGONAL: Final = math.isqrt(2 << 120)

LEAP: Final = 255
"""Marks a jump that does not fit in a byte: go `LEAP - 1` cells and look up again."""

Bytes: TypeAlias = NDArray[np.uint8]


@fast_dataclass
class Direction:
    """One of eight directions: index, flat cell offset, cost per move, and jump table.

    `jumps[cell]` is the number of cells to the next cell where a path may turn or end, 0 if a wall
    comes first, or LEAP.
    """

    number: int
    step: int
    cost: int
    jumps: bytes

    def jump(self, cell: int) -> int:
        """Number of cells to the next jump point, at any distance; 0 if a wall comes first."""
        moves = 0
        # Tables have one byte per cell, so a long jump consists of several entries.
        while self.jumps[cell] == LEAP:
            cell += (LEAP - 1) * self.step
            moves += LEAP - 1
        return moves + self.jumps[cell]


@fast_dataclass
class Jumps:
    """A flattened grid with a blocked border, and the jump tables of all directions.

    `corners` holds, per cell, the walls that a straight path has just passed (see `_corners`).
    `ways[direction][corners[cell]]` are the directions in which a path may continue.
    """

    width: int
    targets: bytes
    corners: bytes
    directions: tuple[Direction, ...]
    ways: tuple[tuple[tuple[Direction, ...], ...], ...]

    def flat(self, cell: tuple[int, int]) -> int:
        """Flat index of a cell."""
        return (cell[0] + 1) * self.width + cell[1] + 1

    def cell(self, flat: int) -> tuple[int, int]:
        """Cell of a flat index."""
        row, column = divmod(flat, self.width)
        return row - 1, column - 1


def jumps_of(blocked: Mask, targets: Mask) -> Jumps:
    """Jump tables of a grid for paths that end in `targets`; both bool, of one shape.

    Needs about 12 bytes per cell, and 20 during construction.
    """
    width = blocked.shape[1] + 2
    steps = [row * width + column for row, column in _RING]
    free = np.pad(~blocked, 1).ravel()
    ends = np.pad(targets, 1).ravel()
    corners = _corners(free, steps)
    tables: list[Bytes] = [np.empty(0, np.uint8)] * 8
    # Straight tables first: a diagonal may turn wherever a straight move from it can.
    for number in (0, 2, 4, 6):
        turns = ends | (corners & (3 << number) != 0)
        tables[number] = _table(_open(free, steps, number), turns, steps[number], width)
    for number in (1, 3, 5, 7):
        turns = ends | (tables[number - 1] > 0) | (tables[(number + 1) % 8] > 0)
        tables[number] = _table(_open(free, steps, number), turns, steps[number], width)
    directions = tuple(
        [
            Direction(number, step, DIAGONAL if number & 1 else STRAIGHT, table.tobytes())
            for number, (step, table) in enumerate(zip(steps, tables, strict=True))
        ]
    )
    # The search reads single cells, which is much faster in bytes than in arrays.
    return Jumps(width, ends.tobytes(), corners.tobytes(), directions, _ways(directions))


def _ahead(flat: Mask, step: int) -> Mask:
    """Value of the cell one step ahead, for each cell.

    Values that wrap around land on border cells, which are blocked anyway.
    """
    return np.roll(flat, -step)


def _open(free: Mask, steps: Sequence[int], number: int) -> Mask:
    """Cells that permit a move in a direction; a diagonal needs both adjacent cells free."""
    is_open = free & _ahead(free, steps[number])
    if number & 1:
        is_open &= _ahead(free, steps[number - 1]) & _ahead(free, steps[(number + 1) % 8])
    return is_open


def _corners(free: Mask, steps: Sequence[int]) -> Bytes:
    """Corners that a straight move has just passed: free beside, blocked beside and behind.

    Bit d stands for direction d (0, 2, 4, 6) with the corner on its left, bit d + 1 for the corner
    on its right.
    """
    corners = np.zeros(free.shape, np.uint8)
    for number in (0, 2, 4, 6):
        passed = free & _ahead(free, -steps[number])
        for bit, side in ((number, (number + 2) % 8), (number + 1, (number - 2) % 8)):
            beside = _ahead(free, steps[side])
            corner = passed & beside & ~_ahead(beside, -steps[number])
            corners |= corner.astype(np.uint8) << bit
    return corners


def _ways(directions: Sequence[Direction]) -> tuple[tuple[tuple[Direction, ...], ...], ...]:
    """Directions in which an early-diagonal shortest path may continue, by arrival and corners."""
    return tuple(
        [
            tuple(
                [tuple([directions[way] for way in _ways_on(number, bits)]) for bits in range(256)]
            )
            for number in range(8)
        ]
    )


def _ways_on(number: int, corners: int) -> list[int]:
    """Continuations of a move: a diagonal continues straight on or to either side.

    A straight move continues, and turns around passed corners, where no shorter path exists.
    """
    left, right = (number + 1) % 8, (number - 1) % 8
    if number & 1:
        return [left, number, right]
    ways = [number]
    if corners >> number & 1:
        ways += [left, (number + 2) % 8]
    if corners >> number & 2:
        ways += [right, (number - 2) % 8]
    return ways


def _table(is_open: Mask, turns: Mask, step: int, width: int) -> Bytes:
    """Per flat cell, the number of cells to the next turn, 0 if a move before it is blocked."""
    opens, ends = _lines(is_open, step, width), _lines(turns, step, width)
    table = np.empty(opens.shape, np.uint8)
    for first in range(0, opens.shape[1], _LINES_AT_ONCE):
        lines = np.s_[:, first : first + _LINES_AT_ONCE]
        table[lines] = _along(opens[lines], ends[lines], step > 0)
    flat = (table.T if abs(step) == 1 else table).ravel()
    return flat[: is_open.size]


def _lines(flat: Mask, step: int, width: int) -> Mask:
    """The flat grid as (places, lines), with cells one step apart in consecutive places.

    For a step of 1 these are the grid's rows; otherwise the grid is folded into rows as long as the
    step, so diagonals become columns too.
    """
    fold = abs(step)
    if fold == 1:
        return flat.reshape(-1, width).T
    padded = np.zeros(-(-flat.size // fold) * fold, np.bool_)
    padded[: flat.size] = flat
    return padded.reshape(-1, fold)


def _along(is_open: Mask, turns: Mask, forward: bool) -> Bytes:
    """Jump distances along lines, (places, lines), in one direction.

    A stop is encoded as twice its place, plus one if it is not a turn.
    """
    if not forward:
        return _along(is_open[::-1], turns[::-1], True)[::-1]
    places = np.arange(0, 2 * len(is_open), 2, dtype=np.int32)[:, np.newaxis]
    beyond = np.int32(2 * len(is_open) + 1)
    stops = np.full((len(is_open) + 1, is_open.shape[1]), beyond)
    stops[:-1] = np.where(turns, places, np.where(is_open, beyond, places + np.int32(1)))
    ahead = np.minimum.accumulate(stops[::-1], axis=0)[::-1][1:]
    distances = np.minimum((ahead - places) >> 1, LEAP)
    return np.where(is_open & (ahead & 1 == 0), distances, 0).astype(np.uint8)


# --- waves ----------------------------------------------------------------------------------------


STEP: Final = 1.06
"""Mean length of a step in cells."""

Flats = NDArray[np.intp]


class Wave:
    """A breadth-first wave from a start cell on a grid (bool, rows x columns) of passable cells.

    It advances ring by ring, only as far as needed. A ring is the set of cells that the next step
    reaches. Odd steps go to the four sides, even steps also to the diagonals, so rings are
    octagons: n steps are n cells straight on and 1.06 n at 45 degrees, at most 1.12 n. That is
    accurate enough to compare paths, and numpy processes a whole ring at a time.

    `steps` is the number of steps to each cell, -1 where the wave has not arrived; (rows, columns)
    int32.
    """

    def __init__(self, passable: Mask, start: Cell) -> None:
        # With a blocked border, steps to neighbours need no checks of bounds.
        rows, self._width = passable.shape[0] + 2, passable.shape[1] + 2
        padded = np.zeros((rows, self._width), np.bool_)
        padded[1:-1, 1:-1] = passable
        self._free = padded.ravel()
        self._fresh = self._free.copy()
        width = self._width
        self._sides = np.array([[width], [-width], [1], [-1]], np.intp)
        self._diagonals = np.array([[down + across] for down, across in self._corners], np.intp)
        self._may_cut = _may_cut(padded)
        self._owner = np.empty(self._free.size, np.int32)
        self._steps = np.full(self._free.size, -1, np.int32)
        origin = (start[0] + 1) * self._width + start[1] + 1
        self._ring: Flats = np.array([origin], np.intp)
        self._fresh[origin] = False
        self._steps[origin] = 0
        self._count = 0
        self._reached: list[Flats] = [self._ring]

    @property
    def steps(self) -> NDArray[np.int32]:
        """Steps to each cell so far, -1 where not reached."""
        return self._steps.reshape(-1, self._width)[1:-1, 1:-1]

    @property
    def is_over(self) -> bool:
        """True once every reachable cell has been reached."""
        return not self._ring.size

    def grow(self, limit: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Advance to at most `limit` steps; rows and columns of all reached cells, in order."""
        while self._ring.size and self._count < limit:
            self._count += 1
            self._ring = self._next_ring()
            self._steps[self._ring] = self._count
            self._reached.append(self._ring)
        rows, columns = np.divmod(np.concatenate(self._reached), self._width)
        return rows - 1, columns - 1

    def path_to(self, cell: Cell) -> list[Cell]:
        """Cells from the start to a reached cell, each adjacent to the previous."""
        flat, path = (cell[0] + 1) * self._width + cell[1] + 1, list[int]()
        while True:
            path.append(flat)
            count = int(self._steps[flat])
            if not count:
                break
            flat = self._before(flat, count)
        return [(index // self._width - 1, index % self._width - 1) for index in reversed(path)]

    def _next_ring(self) -> Flats:
        ring = self._ring
        cells = (ring + self._sides).ravel()
        # Diagonals on every second ring only: the wave grows as an octagon, close to a circle.
        if self._count % 2 == 0:
            diagonals = (ring + self._diagonals)[self._may_cut[:, ring]]
            cells = np.concatenate((cells, diagonals))
        cells = cells[self._fresh[cells]]
        self._fresh[cells] = False
        # A cell that several neighbours reach keeps the last number written, so exactly one of
        # its copies remains; much faster than np.unique.
        numbers = np.arange(cells.size, dtype=np.int32)
        self._owner[cells] = numbers
        return cells[self._owner[cells] == numbers]

    @property
    def _corners(self) -> tuple[tuple[int, int], ...]:
        width = self._width
        return (width, 1), (width, -1), (-width, 1), (-width, -1)

    def _before(self, flat: int, count: int) -> int:
        """A predecessor of a cell on the previous ring, chosen deterministically."""
        width = self._width
        for step in (width, -width, 1, -1):
            if self._steps[flat + step] == count - 1:
                return flat + step
        for down, across in self._corners:
            is_free = self._free[flat + down] and self._free[flat + across]
            if is_free and self._steps[flat + down + across] == count - 1:
                return flat + down + across
        raise AssertionError(f"no cell of ring {count - 1} is beside cell {flat} of ring {count}")


def _may_cut(free: Mask) -> NDArray[np.bool_]:
    """Of each cell, which of its four diagonals cut no corner of a blocked cell; (4, cells).

    The diagonals have the order of `Wave._corners`; those of the border are False.
    """
    below, above = free[2:, 1:-1], free[:-2, 1:-1]
    right, left = free[1:-1, 2:], free[1:-1, :-2]
    both = below & right, below & left, above & right, above & left
    result = np.zeros((len(both), *free.shape), np.bool_)
    result[:, 1:-1, 1:-1] = both
    return result.reshape(len(both), -1)
