"""A robot's evidence grid: cell codes, and how laser and camera update them.

| code | meaning                                                                  |
  |------|--------------------------------------------------------------------------|
  | 0    | unknown, as all cells are initially (the paper's empty cell)             |
  | 1    | free                                                                     |
  | 2-9  | obstacle; the number is the evidence for it                              |
  | 10   | free, and inspected by the camera                                        |
  | 11   | closed: a norm rejected a step there, and no beam reopens it             |
  | 16+k | holds marker k, an index into the robot's `markers`                      |

A position is (row, column) in fractional cells. Positions and cells outside the grid are ignored.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Mask
from minerva_agents.robot.motion import Cell
from minerva_bus import Cells

UNKNOWN: Final = 0
FREE: Final = 1
OBSTACLE: Final = 2
SURE: Final = 9
SEEN: Final = 10
CLOSED: Final = 11
MARKER: Final = 16

Codes: TypeAlias = NDArray[np.int16]

_HIT: Final = 3
"""Evidence added by a hit; a passing beam removes 1."""


def after_passing(code: int, near: bool = True) -> int:
    """The code of a cell after a beam has passed; only near obstacles lose evidence."""
    return max(code - 1 if near and code <= SURE else code, FREE)


def after_hit(code: int) -> int:
    """The code of a cell after a hit; markers and closed cells stay."""
    if code >= MARKER or code == CLOSED:
        return code
    # All other codes stand for no evidence.
    return min(SURE, (code if FREE < code <= SURE else FREE) + _HIT)


def clearing_part(frame: int) -> float:
    """Fraction of each beam that counts as evidence against obstacles in this frame.

    A beam that grazes the wall it ends at passes many cells that contain a bit of that wall, all in
    its far half. So the far half counts in one of eight frames only, which suffices to forget
    obstacles that moved away.
    """
    return 1.0 if frame % 8 == 0 else 0.5


def doubt(grid: Cells) -> None:
    """Reduce the evidence for all obstacles; visible ones recover within a few frames."""
    grid[:] = np.where(grid <= SURE, np.where(grid > FREE, grid - 1, grid), grid)


LONGEST: Final = 100_000
"""Samples of a beam that need no allocation."""

_STEPS: Final = np.arange(LONGEST, dtype=np.float64)
_NONE: Final = np.empty(0, np.intp)


def holds(grid: Cells, cell: Cell) -> bool:
    """True if the cell lies on the grid."""
    return 0 <= cell[0] < grid.shape[0] and 0 <= cell[1] < grid.shape[1]


def mark_obstacle(grid: Cells, row: float, column: float) -> None:
    """Add evidence for an obstacle at a position; markers are not overwritten."""
    cell = math.floor(row), math.floor(column)
    if not holds(grid, cell):
        return
    grid[cell] = after_hit(int(grid[cell]))


def close(grid: Cells, row: float, column: float) -> None:
    """Close a position regardless of later scans; markers are not overwritten."""
    cell = math.floor(row), math.floor(column)
    if holds(grid, cell) and grid[cell] < MARKER:
        grid[cell] = CLOSED


def reopen(grid: Cells) -> None:
    """Reopen all closed cells: a norm need not reject a step forever."""
    grid[grid == CLOSED] = FREE


def mark_marker(grid: Cells, row: float, column: float, marker: int) -> None:
    """Set the cell of a marker; its previous cell becomes free."""
    cell = math.floor(row), math.floor(column)
    if holds(grid, cell):
        grid[grid == MARKER + marker] = FREE
        grid[cell] = MARKER + marker


def clear_open_beam(
    grid: Cells, row: float, column: float, to_row: float, to_column: float, part: float = 1.0
) -> None:
    """Mark the cells along a beam without a hit as free, up to the first known obstacle.

    A beam may fail to return from a wall. So only the first obstacle loses evidence, and only on
    the first `part` of the beam; cells behind it stay unchanged.
    """
    cells, count = _passed(grid, row, column, to_row, to_column)
    flat: Codes = grid.reshape(-1)
    codes: Codes = flat.take(cells)
    walls = np.flatnonzero(obstacles(codes))
    if walls.size:
        end = int(walls[0])
        cells, codes = cells[: end + 1], codes[: end + 1]
        if end < part * count:
            codes[end] = after_passing(int(codes[end]))
    np.maximum(codes, FREE, out=codes)
    flat[cells] = codes


def _passed(
    grid: Cells, row: float, column: float, to_row: float, to_column: float
) -> tuple[NDArray[np.intp], int]:
    """Flat indices of the cells that a beam passes, and their count including those off the grid.

    Consecutive samples are at most one row and one column apart, so no cell is skipped; the cell in
    which the beam ends is excluded.
    """
    down, across = to_row - row, to_column - column
    count = math.ceil(max(abs(down), abs(across)))
    if not count:
        return _NONE, 0
    down, across = down / count, across / count
    last = math.floor((count - 1) * down + row), math.floor((count - 1) * across + column)
    if last == (math.floor(to_row), math.floor(to_column)):
        count -= 1
    high, wide = grid.shape
    # Steps of a beam that ends off the grid are a little shorter than a cell, hence two more.
    enough = max(high, wide) + 2
    steps = _STEPS[:count] if enough <= _STEPS.size else np.arange(min(count, enough), dtype=float)
    rows = (steps * down + row).astype(np.intp)
    columns = (steps * across + column).astype(np.intp)
    # A beam with both ends on the grid stays on it. Otherwise positions are tested before the
    # conversion, which rounds small negative numbers to 0.
    if not (0 <= row < high > to_row >= 0 <= column < wide > to_column >= 0):
        inside = (steps * down + row >= 0) & (steps * across + column >= 0)
        inside &= (rows < high) & (columns < wide)
        rows, columns = rows[inside], columns[inside]
    rows *= wide
    rows += columns
    return rows, count


def place_of(grid: Cells, marker: int) -> Cell | None:
    """The cell of a marker, or None if it has not been seen."""
    index = int(np.argmax(grid == MARKER + marker))
    row, column = divmod(index, grid.shape[1])
    return (row, column) if grid[row, column] == MARKER + marker else None


def obstacles(grid: Cells) -> Mask:
    """Mask of obstacle and closed cells."""
    matches = (grid - OBSTACLE).view(np.uint16) <= SURE - OBSTACLE  # one comparison for two
    return matches | (grid == CLOSED)


def free(grid: Cells) -> Mask:
    """Mask of cells known to be free; markers are not obstacles."""
    return ((grid == FREE) | (grid >= SEEN)) & (grid != CLOSED)
