"""What the camera has inspected, and what a search for a marker has still to inspect.

A laser covers a whole room from its door; a camera sees only what lies ahead. So a robot that
searches for a marker records which free cells its camera has seen.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Mask
from minerva_agents.robot.knowledge import FREE, SEEN, UNKNOWN, free
from minerva_agents.robot.motion import GridPose
from minerva_bus import Cells, portable


def look(grid: Cells, pose: GridPose, fov: float, reach: float) -> None:
    """Mark visible free cells as seen: `fov` degrees wide, `reach` cells far, up to a wall."""
    # Neighbouring rays are at most one cell apart at full range.
    rays = 2 + int(math.radians(fov) * reach)
    headings = np.radians(pose.angle + fov * (np.arange(rays) / (rays - 1) - 0.5))
    down, across = portable.cos_sin(headings)
    steps = np.arange(int(reach) + 1, dtype=np.float64)
    rows, columns = _along(pose.row, steps, down), _along(pose.column, steps, across)
    inside = (rows >= 0) & (rows < grid.shape[0]) & (columns >= 0) & (columns < grid.shape[1])
    # Positions off the grid read cell 0, but they end their ray, so its code has no effect.
    flat = np.where(inside, rows * grid.shape[1] + columns, 0)
    cells = grid.reshape(-1)
    codes = cells[flat]
    ends = (codes != FREE) & (codes < SEEN) | ~inside
    # Cells that the edge of the view only cuts count as seen. To count only those completely in
    # view makes a search depend on single cells and take more than twice as many frames.
    open_cells = flat[~np.logical_or.accumulate(ends, axis=1) & (codes == FREE)]
    cells[open_cells] = SEEN


def forget_looks(grid: Cells) -> None:
    """Reset inspected cells to free."""
    grid[grid == SEEN] = FREE


def frontier(grid: Cells) -> Mask:
    """Free cells adjacent to unknown ones.

    Gaps between two beams do not count as unknown.
    """
    return free(grid) & grown_to_sides(expanses(grid == UNKNOWN))


def out_of_view(grid: Cells) -> Mask:
    """Free cells that the camera has not seen, without specks."""
    return expanses(grid == FREE)


def expanses(mask: Mask) -> Mask:
    """The mask without regions less than three cells wide."""
    return grown(_all_around(mask))


def grown_to_sides(mask: Mask) -> Mask:
    """The mask dilated by its four-neighbourhood."""
    result = mask.copy()
    result[1:] |= mask[:-1]
    result[:-1] |= mask[1:]
    result[:, 1:] |= mask[:, :-1]
    result[:, :-1] |= mask[:, 1:]
    return result


def _along(
    origin: float, steps: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.intp]:
    return np.floor(np.outer(slopes, steps) + origin).astype(np.intp)


def _all_around(mask: Mask) -> Mask:
    """Cells whose eight neighbours are all True; never at the border."""
    down = mask[:-2] & mask[1:-1] & mask[2:]
    result = np.zeros(mask.shape, np.bool_)
    result[1:-1, 1:-1] = down[:, :-2] & down[:, 1:-1] & down[:, 2:]
    return result


def grown(mask: Mask) -> Mask:
    """The mask dilated by its eight-neighbourhood."""
    down = mask.copy()
    down[1:] |= mask[:-1]
    down[:-1] |= mask[1:]
    result = down.copy()
    result[:, 1:] |= down[:, :-1]
    result[:, :-1] |= down[:, 1:]
    return result
