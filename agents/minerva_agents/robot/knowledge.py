"""What a robot knows of the floor: the cells of its grid, and how laser and camera change them.

| code | a cell that                                                              |
|------|--------------------------------------------------------------------------|
| 0    | is empty of knowledge, as all are at first (the paper's empty cell)      |
| 1    | is free                                                                  |
| 2-9  | holds an obstacle; the number is the evidence for it                     |
| 10   | is free, and the camera has looked at it                                 |
| 11   | is closed: a norm has refused a step there, and no beam opens it         |
| 16+k | holds marker k, of the names that the robot has in `markers`             |

A position is (row, column) in cells, with fractions: it lies in the cell of its floor. Positions
and cells outside the grid are passed over.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import Cells, portable

UNKNOWN: Final = 0
FREE: Final = 1
OBSTACLE: Final = 2
SURE: Final = 9
SEEN: Final = 10
CLOSED: Final = 11
MARKER: Final = 16

Cell: TypeAlias = tuple[int, int]
Mask: TypeAlias = NDArray[np.bool_]
Codes: TypeAlias = NDArray[np.int16]

_HIT: Final = 3
"""Evidence that one hit adds; a beam that passes takes 1 away."""


def _after_passing() -> Cells:
    """What becomes of each code when a beam passes through."""
    codes = np.arange(1 << 15, dtype=np.int16)
    lowered = np.maximum(codes - 1, FREE).astype(np.int16)
    return np.where(codes <= SURE, lowered, codes)


def part_that_counts(frame: int) -> float:
    """The part of its beams that counts against obstacles in a frame.

    A beam may graze the wall that it ends at, on its farther half: it passes many cells that hold
    a bit of that wall before it hits one. So that half counts in one frame of eight only, which
    is enough to forget what has gone away.
    """
    return 1.0 if frame % 8 == 0 else 0.5


def doubt(grid: Cells) -> None:
    """Less evidence for all obstacles; those that are in view are soon as sure as before."""
    grid[:] = np.where(grid <= SURE, np.where(grid > FREE, grid - 1, grid), grid)


_PASSED: Final = _after_passing()
_STEPS: Final = np.arange(100_000, dtype=np.float64)
_NONE: Final = np.empty(0, np.intp)


def at_distance(row: float, column: float, angle: float, dist: float) -> tuple[float, float]:
    """(r + dist cos angle, c + dist sin angle), 4.2.3; the distance in cells, degrees."""
    heading = math.radians(angle)
    return row + dist * portable.cos(heading), column + dist * portable.sin(heading)


def holds(grid: Cells, cell: Cell) -> bool:
    """Whether a cell is one of the grid."""
    return 0 <= cell[0] < grid.shape[0] and 0 <= cell[1] < grid.shape[1]


def mark_obstacle(grid: Cells, row: float, column: float) -> None:
    """More evidence for an obstacle at a position; a marker stays a marker."""
    cell = math.floor(row), math.floor(column)
    if not holds(grid, cell):
        return
    code = int(grid[cell])
    if code < MARKER and code != CLOSED:
        evidence = code if FREE < code <= SURE else FREE
        grid[cell] = min(SURE, evidence + _HIT)


def close(grid: Cells, row: float, column: float) -> None:
    """Nobody may go to a position, whatever the laser sees there; a marker stays a marker."""
    cell = math.floor(row), math.floor(column)
    if holds(grid, cell) and grid[cell] < MARKER:
        grid[cell] = CLOSED


def reopen(grid: Cells) -> None:
    """Try again what was closed: norms need not refuse for ever."""
    grid[grid == CLOSED] = FREE


def mark_marker(grid: Cells, row: float, column: float, marker: int) -> None:
    """The one place of a marker; where it was thought to be before is free."""
    cell = math.floor(row), math.floor(column)
    if holds(grid, cell):
        grid[grid == MARKER + marker] = FREE
        grid[cell] = MARKER + marker


def clear_beam(
    grid: Cells, row: float, column: float, to_row: float, to_column: float, part: float = 1.0
) -> None:
    """The cells that a beam passes before it ends are free.

    All along the beam what was unknown is free now. What was thought an obstacle loses evidence on
    the first `part` of it only.
    """
    cells, count = _passed(grid, row, column, to_row, to_column)
    flat: Codes = grid.reshape(-1)
    codes: Codes = flat.take(cells)
    np.maximum(codes, FREE, out=codes)
    near = codes[: math.ceil(part * count)]
    _PASSED.take(near, out=near, mode="clip")  # which spares a copy; no code is out of bounds
    flat[cells] = codes


def clear_open_beam(
    grid: Cells, row: float, column: float, to_row: float, to_column: float, part: float = 1.0
) -> None:
    """The cells that a beam passes which meets nothing are free, up to a known obstacle.

    A beam may fail to come back from a wall. So it loses evidence only of the first obstacle on
    its way, if that lies on the first `part` of it, and says nothing of what lies behind.
    """
    cells, count = _passed(grid, row, column, to_row, to_column)
    flat: Codes = grid.reshape(-1)
    codes: Codes = flat.take(cells)
    walls = np.flatnonzero(obstacles(codes))
    if walls.size:
        end = int(walls[0])
        cells, codes = cells[: end + 1], codes[: end + 1]
        if end < part * count:
            codes[end] = _PASSED[codes[end]]
    np.maximum(codes, FREE, out=codes)
    flat[cells] = codes


def _passed(
    grid: Cells, row: float, column: float, to_row: float, to_column: float
) -> tuple[NDArray[np.intp], int]:
    """The flat indices of the cells that a beam passes, and their number with those outside.

    From one cell looked up to the next it is one row and one column at most, so none is left out;
    the cell in which the beam ends is none of them.
    """
    down, across = to_row - row, to_column - column
    count = math.ceil(max(abs(down), abs(across)))
    if not count:
        return _NONE, 0
    down, across = down / count, across / count
    last = math.floor((count - 1) * down + row), math.floor((count - 1) * across + column)
    if last == (math.floor(to_row), math.floor(to_column)):
        count -= 1
    steps = _STEPS[:count]
    rows = (steps * down + row).astype(np.intp)
    columns = (steps * across + column).astype(np.intp)
    high, wide = grid.shape
    if not (0 <= row < high > to_row >= 0 <= column < wide > to_column >= 0):
        inside = (steps * down + row >= 0) & (steps * across + column >= 0)
        inside &= (rows < high) & (columns < wide)
        rows, columns = rows[inside], columns[inside]
    rows *= wide
    rows += columns
    return rows, count


def place_of(grid: Cells, marker: int) -> Cell | None:
    """The cell of a marker, or None while it has not been seen."""
    found = int(np.argmax(grid == MARKER + marker))
    row, column = divmod(found, grid.shape[1])
    return (row, column) if grid[row, column] == MARKER + marker else None


def obstacles(grid: Cells) -> Mask:
    """Where there is evidence for an obstacle, or it is closed."""
    found = (grid - OBSTACLE).view(np.uint16) <= SURE - OBSTACLE  # one comparison for two
    return found | (grid == CLOSED)


def free(grid: Cells) -> Mask:
    """Where there is ground that has been seen to be free; a marker is no obstacle."""
    return ((grid == FREE) | (grid >= SEEN)) & (grid != CLOSED)
