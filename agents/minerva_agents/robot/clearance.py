"""Where a robot can stand and drive: clearance from obstacles, straightened paths, lines of sight.

Unknown cells count as free, otherwise a robot would never explore them.

A robot keeps a distance from the centre of each obstacle cell such that it touches nothing wherever
in the cell the obstacle stands. A robot that is already closer, through an error or because
something approached it, may move anywhere but closer still.

A path on the robot's own grid leads over cell centres and keeps clear of a disc around each
obstacle cell. A door therefore needs up to one and a half cells more than the robot's width, and
whether a path exists depends on where grid lines fall in the door. As a fallback, `Narrows` plans
on the corners, edges and centres of cells, and keeps the body plus `MARGIN` clear of each obstacle
cell's square, in which the laser saw the obstacle. The robot then passes every door wider than
`passable_width`. Such a plan is four times as large, so it is the second choice.

The point (r, c) of the robot's grid, in cells, is (2 r + 0.5, 2 c + 0.5) on the grid of half cells.
The point of a square nearest to a corner, edge or centre of a cell is one of nine points of the
square. So nine obstacles on the fine grid represent one obstacle cell exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np

from minerva_agents.robot.grid import FREE, SURE, Mask, grown, inflate, obstacles
from minerva_agents.robot.planning import nearest
from minerva_agents.robot.pose import Cell, Position, Reals, cell_of, centre_of
from minerva_bus import Cells, portable
from minerva_bus.values import fast_dataclass

Way: TypeAlias = Sequence[Position]

# Rounded up, so that no corner of an obstacle cell comes closer than the radius.
_HALF_DIAGONAL: Final = 0.7072
_TOLERANCE: Final = 1e-6


def room_of(radius: float, cell: float) -> float:
    """Clearance to an obstacle cell's centre, in cells."""
    return radius / cell + _HALF_DIAGONAL


def blocked(grid: Cells, at: Position, room: float) -> Mask:
    """Cells that a robot at position `at` must not enter."""
    walls = obstacles(grid)
    closed = inflate(walls, room)
    here = cell_of(at)
    if closed[here]:
        _open(closed, walls, at, room)
        # The robot must be able to leave its own cell in any case.
        closed[here] = False
    return closed


def _open(closed: Mask, walls: Mask, at: Position, room: float) -> None:
    """Open nearby cells that are no closer to any near obstacle than the robot is now."""
    reach = 2 * math.ceil(room)
    row, column = cell_of(at)
    corner = max(0, row - 2 * reach), max(0, column - 2 * reach)
    window = np.s_[corner[0] : row + 2 * reach + 1, corner[1] : column + 2 * reach + 1]
    far = walls[window].copy()
    centres = np.argwhere(far) + corner + 0.5
    near = centres[portable.hypot(*(centres - at).T) < room]
    far[tuple((near - corner).astype(np.intp).T)] = False
    # Cells near other obstacles, and cells closer to a near obstacle than the robot is now.
    still_closed = inflate(far, room)
    rows, columns = np.ogrid[: far.shape[0], : far.shape[1]]
    for centre in near.tolist():
        down, across = rows + (corner[0] + 0.5 - centre[0]), columns + (corner[1] + 0.5 - centre[1])
        still_closed |= portable.hypot(down, across) < portable.dist(centre, at) - _TOLERANCE
    # Towards the rim of the window, obstacles beyond it are missing, so only the inner part counts.
    inner = np.s_[
        max(0, row - corner[0] - reach) : row - corner[0] + reach + 1,
        max(0, column - corner[1] - reach) : column - corner[1] + reach + 1,
    ]
    closed[window][inner] &= still_closed[inner]


def is_clear(grid: Cells, way: Way, room: float) -> bool:
    """True if straight lines along the path keep `room` cells of clearance.

    An obstacle that is already closer at the start must not come closer still.
    """
    return all(_is_clear(grid, *line, way[0], room) for line in pairwise(way))


def _is_clear(grid: Cells, begin: Position, end: Position, first: Position, room: float) -> bool:
    (row, column), (to_row, to_column) = begin, end
    top = max(0, math.floor(min(row, to_row) - room))
    left = max(0, math.floor(min(column, to_column) - room))
    bottom = math.ceil(max(row, to_row) + room)
    right = math.ceil(max(column, to_column) + room)
    rows, columns = obstacles(grid[top:bottom, left:right]).nonzero()
    if not rows.size:
        return True
    down, across = to_row - row, to_column - column
    rows, columns = rows + (top + 0.5 - row), columns + (left + 0.5 - column)
    # The lower bound avoids a division by 0 for a line without length.
    along = (rows * down + columns * across) / max(down * down + across * across, _TOLERANCE)
    along.clip(0.0, 1.0, out=along)
    nearest = portable.hypot(rows - along * down, columns - along * across)
    # The usual case. A line that comes closer is clear only if the robot is too close already.
    if nearest.min() > room:
        return True
    at_first = portable.hypot(rows + (row - first[0]), columns + (column - first[1]))
    return bool((nearest > np.minimum(at_first, room) - _TOLERANCE).all())


def corners(cells: Sequence[Cell]) -> list[Cell]:
    """First cell, turning cells and last cell of a path."""
    turns = [
        here
        for before, here, after in zip(cells, cells[1:], cells[2:], strict=False)
        if (here[0] - before[0], here[1] - before[1]) != (after[0] - here[0], after[1] - here[1])
    ]
    return [cells[0], *turns, *cells[1:][-1:]]


def straightened(grid: Cells, at: Position, cells: Sequence[Cell], room: float) -> list[Position]:
    """A path of cells as positions, with corners cut where clearance allows."""
    turns = [centre_of(cell) for cell in corners(cells)]
    way = [] if _leaves_at_once(grid, at, turns, room) else [turns[0]]
    here, ahead = at if not way else turns[0], turns[1:]
    while ahead:
        while len(ahead) > 1 and is_clear(grid, (here, ahead[1]), room):
            ahead.pop(0)
        here = ahead.pop(0)
        way.append(here)
    return way


def _leaves_at_once(grid: Cells, at: Position, turns: Way, room: float) -> bool:
    """True if the first corner is reachable without driving to the centre of the current cell."""
    if len(turns) < 2:
        return False
    # If even the centre of the robot's own cell is out of reach, a detour over it cannot help.
    return is_clear(grid, (at, turns[1]), room) or not is_clear(grid, (at, turns[0]), room)


def sees(walls: Mask, here: Position, there: Position) -> bool:
    """True if no obstacle lies between two positions; the end cells do not count."""
    return bool(all_that_see(walls, np.array([here[0]]), np.array([here[1]]), there)[0])


def all_that_see(walls: Mask, rows: Reals, columns: Reals, there: Position) -> Mask:
    """Of n positions, (n,) rows and columns, those that `sees` says see another, (n,)."""
    down, across = there[0] - rows, there[1] - columns
    # Two samples per cell, so that a line skips no cell except at corners.
    counts = 2 * np.ceil(np.maximum(np.abs(down), np.abs(across))).astype(np.intp) + 1
    result = np.ones(len(rows), np.bool_)
    for count in sorted(set(counts.tolist())):
        lines = np.flatnonzero(counts == count)
        parts = np.arange(1, count) / count
        firsts, seconds = rows[lines, np.newaxis], columns[lines, np.newaxis]
        passed = (
            np.floor(firsts + parts * down[lines, np.newaxis]).astype(np.intp),
            np.floor(seconds + parts * across[lines, np.newaxis]).astype(np.intp),
        )
        is_end = (passed[0] == np.floor(firsts)) & (passed[1] == np.floor(seconds))
        last = cell_of(there)
        is_end |= (passed[0] == last[0]) & (passed[1] == last[1])
        result[lines] = ~(walls[passed] & ~is_end).any(axis=1)
    return result


# --- narrow openings ------------------------------------------------------------------------------


MARGIN: Final = 0.01
"""Clearance between the robot's body and an obstacle cell, in metres."""

_HALF_STEP: Final = math.sqrt(0.125)
"""Half of a diagonal step between half cells, in cells: distance from its ends to its middle."""


def passable_width(radius: float, cell: float) -> float:
    """Width in metres of doors that a robot passes wherever the grid lines fall.

    The robot's width with a margin, rounded up to whole cells, plus one cell.
    """
    # Rounding removes errors such as that of 3 * 0.1.
    return round((math.ceil(2.0 * _room_of_points(radius, cell)) + 1) * cell, 9)


def is_passable(grid: Cells, way: Sequence[Position], radius: float, cell: float) -> bool:
    """True if the robot's body stays clear of all obstacle cells along straight lines."""
    reach = _room_of_body(radius, cell) + 1.0
    # Only the surroundings of the path are refined, because it is tested in every frame.
    top, left = (max(0, math.floor(min(axis) - reach)) for axis in zip(*way, strict=True))
    bottom, right = (math.ceil(max(axis) + reach) for axis in zip(*way, strict=True))
    fine = _fine(grid[top:bottom, left:right])
    points = [_to_fine((row - top, column - left)) for row, column in way]
    return is_clear(fine, points, 2.0 * _room_of_body(radius, cell))


@fast_dataclass
class Narrows:
    """Reachable space of a robot at `at` with minimal clearance.

    `closed` are blocked half cells.
    """

    grid: Cells
    at: Position
    closed: Mask
    room: float

    @staticmethod
    def around(grid: Cells, at: Position, radius: float, cell: float) -> Narrows:
        """Build from a robot's grid; positions in cells, `radius` and `cell` in metres."""
        fine, at, room = _fine(grid), _to_fine(at), 2.0 * _room_of_points(radius, cell)
        return Narrows(fine, at, blocked(fine, at, room), room)

    @property
    def closed_cells(self) -> Mask:
        """Cells of the robot's grid without any open point."""
        # The centre of a cell has odd indices; its corners and edges are the eight points around
        # it.
        near = grown(~self.closed)
        return ~near[1::2, 1::2]

    def way_to(self, targets: Mask) -> list[Position] | None:
        """Path to the nearest target cell of the robot's grid, or None."""
        fine = np.zeros(self.closed.shape, np.bool_)
        fine[1::2, 1::2] = targets
        # Each of the nine points of a target cell counts.
        path = nearest(self.closed, cell_of(self.at), grown(fine) & ~self.closed)
        if path is None:
            return None
        way = straightened(self.grid, self.at, path.cells, self.room)
        return [((row - 0.5) / 2.0, (column - 0.5) / 2.0) for row, column in way]

    def way_to_cell(self, cell: Cell) -> list[Position] | None:
        """Path to a cell of the robot's grid, or None."""
        rows, columns = self.closed.shape
        targets = np.zeros((rows // 2, columns // 2), np.bool_)
        targets[cell] = True
        return self.way_to(targets)


def _fine(grid: Cells) -> Cells:
    """The grid of half cells: obstacles at the nine points of each obstacle cell, else free."""
    rows, columns = grid.shape
    walls = np.zeros((2 * rows + 1, 2 * columns + 1), np.bool_)
    walls[1::2, 1::2] = obstacles(grid)
    return np.where(grown(walls), SURE, FREE).astype(np.int16)


def _to_fine(at: Position) -> Position:
    return 2.0 * at[0] + 0.5, 2.0 * at[1] + 0.5


def _room_of_body(radius: float, cell: float) -> float:
    """Clearance of the robot's centre to an obstacle cell, in cells."""
    return (radius + MARGIN) / cell


def _room_of_points(radius: float, cell: float) -> float:
    """Clearance of a step's ends such that its middle keeps the clearance of the body."""
    return float(portable.hypot(_room_of_body(radius, cell), _HALF_STEP))
