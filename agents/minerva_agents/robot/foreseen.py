"""What a robot's grid will look like, and where the robot can get on it, computed from the map.

The grid makes walls thicker than they are, by up to one cell on each side of an opening and by more
in oblique walls. Whether an opening is too narrow depends on where the lines of the grid fall. So a
run asks the robot's own planner before the start, instead of estimating from a width.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.arriving import NEAR, cells_with_view
from minerva_agents.robot.grids import Mask
from minerva_agents.robot.ground import blocked, room_of
from minerva_agents.robot.knowledge import FREE, SURE, obstacles
from minerva_agents.robot.looking import grown
from minerva_agents.robot.motion import Cell, Position, Reals, cell_of
from minerva_agents.robot.narrows import Narrows
from minerva_agents.robot.occupancy import OccupancyMap
from minerva_agents.robot.placing import regions
from minerva_bus import Cells

_INSIDE = 1e-6
"""Depth of a hit in an obstacle, in cells of the map; it decides between two cells of the grid."""


def known_grid(floor: OccupancyMap, empty: Cells, x: float, y: float, cell: float) -> Cells:
    """A robot's grid once a laser has seen every surface of the map.

    Args:
        floor: the map; everything outside it counts as an obstacle.
        empty: a grid without knowledge.
        x: of the outer corner of its cell (0, 0), in metres.
        y: likewise.
        cell: side of its cells in metres.

    """
    grid = np.full_like(empty, FREE)
    solid = np.pad(floor.obstacles, 1, constant_values=True)
    for rows, columns in _surfaces(solid, 1 + math.ceil(2.0 * floor.resolution / cell)):
        xs, ys = floor.point(rows - 1.0, columns - 1.0)
        grid[_lines(xs - x, cell, grid.shape[0]), _lines(ys - y, cell, grid.shape[1])] = SURE
    return grid


def _surfaces(solid: Mask, count: int) -> Iterator[tuple[Reals, Reals]]:
    """Rows and columns of `count` points on each side that an obstacle shares with a free cell."""
    along = np.linspace(_INSIDE, 1.0 - _INSIDE, count)
    for walls, is_turned in ((solid, False), (solid.T, True)):
        for step, depth in ((1, 1.0 - _INSIDE), (-1, _INSIDE)):
            # `roll` wraps around only from border to border, and both are solid.
            across, beside = np.nonzero(walls & ~np.roll(walls, -step, axis=0))
            first = np.repeat(across.astype(np.float64) + depth, count)
            second: Reals = np.add.outer(beside, along).ravel()
            yield (second, first) if is_turned else (first, second)


def _lines(metres: Reals, cell: float, count: int) -> NDArray[np.intp]:
    """Rows or columns of the grid at these distances from its first."""
    return np.floor(metres / cell).astype(np.intp).clip(0, count - 1)


def is_within_reach(reachable: Mask, grid: Cells, place: Cell, cell: float) -> bool:
    """True if a robot gets as near to a marker, in view of it, as arrival demands."""
    return bool((reachable & cells_with_view(obstacles(grid), place, NEAR / cell)).any())


def reachable_cells(grid: Cells, at: Position, radius: float, cell: float, fine: bool) -> Mask:
    """Cells to which a robot at `at`, in cells, finds a way; `fine`: also through narrow openings.

    `radius` and `cell` are in metres.
    """
    if not fine:
        labels = regions(~blocked(grid, at, room_of(radius, cell)))
        return labels == labels[cell_of(at)]
    narrows = Narrows.around(grid, at, radius, cell)
    labels = regions(~narrows.closed)
    return grown(labels == labels[cell_of(narrows.at)])[1::2, 1::2]
