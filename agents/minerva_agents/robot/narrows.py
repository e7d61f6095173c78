"""Ways through doors that are hardly wider than the robot: plans on a grid of half cells.

On the robot's own grid a way leads over the centres of cells, and keeps clear of a disc around each
obstacle's cell. So a door needs up to a cell and a half more than the robot is wide, and whether
the robot finds a way depends on where the grid's lines lie in the door. Where that fails, the robot
plans on the corners, edges and centres of cells, and keeps its body and `MARGIN` clear of each
obstacle's cell itself, a square: the laser has met the obstacle somewhere in it. Then it passes
every door wider than `passable_width`. Such a plan is four times as large, so it comes second.

The point (r, c) of the robot's grid, in cells, is (2 r + 0.5, 2 c + 0.5) on the grid of half cells.
The nearest point of a square to a corner, edge or centre of a cell is itself one of these nine
points of the square. So nine obstacles on the fine grid stand for one obstacle's cell, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from minerva_agents.robot.ground import Position, blocked, cell_of, is_clear, straightened
from minerva_agents.robot.knowledge import FREE, SURE, Cell, Mask, obstacles
from minerva_agents.robot.looking import grown
from minerva_agents.robot.planning import nearest
from minerva_bus import Cells, portable

MARGIN: Final = 0.01
"""Metres between the robot's body and the cell of an obstacle."""

_HALF_STEP: Final = math.sqrt(0.125)
"""Half of a diagonal step between half cells, in cells: so far from its ends is its middle."""


def passable_width(radius: float, cell: float) -> float:
    """The width in metres from which a robot passes a door, wherever the grid's lines lie in it.

    It is the robot's width with a margin, rounded up to whole cells, and one cell more.
    """
    return round((math.ceil(2.0 * _room_of_points(radius, cell)) + 1) * cell, 9)


def is_passable(grid: Cells, way: Sequence[Position], radius: float, cell: float) -> bool:
    """Whether the robot's body keeps clear of all obstacles' cells on straight lines."""
    reach = _room_of_body(radius, cell) + 1.0
    top, left = (max(0, math.floor(min(axis) - reach)) for axis in zip(*way, strict=True))
    bottom, right = (math.ceil(max(axis) + reach) for axis in zip(*way, strict=True))
    fine = _fine(grid[top:bottom, left:right])
    points = [_to_fine((row - top, column - left)) for row, column in way]
    return is_clear(fine, points, 2.0 * _room_of_body(radius, cell))


@dataclass(frozen=True, slots=True)
class Narrows:
    """Where a robot at `at` can go at best; `closed` are the half cells where it must not go."""

    grid: Cells
    at: Position
    closed: Mask
    room: float

    @staticmethod
    def around(grid: Cells, at: Position, radius: float, cell: float) -> Narrows:
        """The narrows of a robot's grid; positions in cells, `radius` and `cell` in metres."""
        fine, at, room = _fine(grid), _to_fine(at), 2.0 * _room_of_points(radius, cell)
        return Narrows(fine, at, blocked(fine, at, room), room)

    @property
    def closed_cells(self) -> Mask:
        """The cells of the robot's grid of which no point is open."""
        near = grown(~self.closed)
        return ~near[1::2, 1::2]

    def way_to(self, targets: Mask) -> list[Position] | None:
        """The way to the nearest of some cells of the robot's grid, or None without one."""
        fine = np.zeros(self.closed.shape, np.bool_)
        fine[1::2, 1::2] = targets
        path = nearest(self.closed, cell_of(self.at), grown(fine) & ~self.closed)
        if path is None:
            return None
        way = straightened(self.grid, self.at, path.cells, self.room)
        return [((row - 0.5) / 2.0, (column - 0.5) / 2.0) for row, column in way]

    def way_to_cell(self, cell: Cell) -> list[Position] | None:
        """The way to a cell of the robot's grid, or None without one."""
        rows, columns = self.closed.shape
        targets = np.zeros((rows // 2, columns // 2), np.bool_)
        targets[cell] = True
        return self.way_to(targets)


def _fine(grid: Cells) -> Cells:
    """The grid of half cells: obstacles at the nine points of each obstacle's cell, else free."""
    rows, columns = grid.shape
    walls = np.zeros((2 * rows + 1, 2 * columns + 1), np.bool_)
    walls[1::2, 1::2] = obstacles(grid)
    return np.where(grown(walls), SURE, FREE).astype(np.int16)


def _to_fine(at: Position) -> Position:
    return 2.0 * at[0] + 0.5, 2.0 * at[1] + 0.5


def _room_of_body(radius: float, cell: float) -> float:
    """How far, in cells, the robot stays from an obstacle's cell."""
    return (radius + MARGIN) / cell


def _room_of_points(radius: float, cell: float) -> float:
    """How far the ends of a step stay away, so that its middle keeps the room of the body."""
    return float(portable.hypot(_room_of_body(radius, cell), _HALF_STEP))
