"""Paths through openings hardly wider than the robot, planned on a grid of half cells.

On the robot's own grid a path leads over cell centres and keeps clear of a disc around each
obstacle cell. A door therefore needs up to one and a half cells more than the robot's width, and
whether a path exists depends on where grid lines fall in the door. As a fallback, the robot plans
on the corners, edges and centres of cells, and keeps its body plus `MARGIN` clear of each obstacle
cell's square, in which the laser saw the obstacle. It then passes every door wider than
`passable_width`. Such a plan is four times as large, so it is the second choice.

The point (r, c) of the robot's grid, in cells, is (2 r + 0.5, 2 c + 0.5) on the grid of half cells.
The point of a square nearest to a corner, edge or centre of a cell is one of nine points of the
square. So nine obstacles on the fine grid represent one obstacle cell exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from minerva_agents.robot.grids import Mask
from minerva_agents.robot.ground import blocked, is_clear, straightened
from minerva_agents.robot.knowledge import FREE, SURE, obstacles
from minerva_agents.robot.looking import grown
from minerva_agents.robot.motion import Cell, Position, cell_of
from minerva_agents.robot.planning import nearest
from minerva_bus import Cells, portable

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


@dataclass(frozen=True, slots=True)
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
