"""What the camera has looked at, and where a search for a marker has still to look.

A laser sees a whole room from its door; the camera sees only what lies ahead. So a robot that
looks for a marker remembers which free cells its camera has had in view.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import FREE, SEEN, UNKNOWN, Mask, free
from minerva_agents.robot.motion import Pose
from minerva_bus import Cells, portable

Reals = NDArray[np.floating[Any]]


def look(grid: Cells, pose: Pose, fov: float, reach: float) -> None:
    """Mark the free cells ahead as seen: `fov` degrees wide, `reach` cells far, up to a wall.

    Only a cell that lies in view with all of its area counts: in one that the edge of the view
    cuts, a marker may stay out of view, and the robot would never look there again.
    """
    rays = 2 + int(math.radians(fov) * reach)
    headings = [math.radians(pose.angle + fov * (i / (rays - 1) - 0.5)) for i in range(rays)]
    steps = np.arange(int(reach) + 1, dtype=np.float64)
    rows = _along(pose.row, steps, [portable.cos(heading) for heading in headings])
    columns = _along(pose.column, steps, [portable.sin(heading) for heading in headings])
    inside = (rows >= 0) & (rows < grid.shape[0]) & (columns >= 0) & (columns < grid.shape[1])
    flat = np.where(inside, rows * grid.shape[1] + columns, 0)
    cells = grid.reshape(-1)
    codes = cells[flat]
    ends = (codes != FREE) & (codes < SEEN) | ~inside
    is_new = ~np.logical_or.accumulate(ends, axis=1) & (codes == FREE)
    is_whole = _in_view(rows[is_new] - pose.row, columns[is_new] - pose.column, pose, fov, reach)
    cells[flat[is_new][is_whole]] = SEEN


def _in_view(down: Reals, across: Reals, pose: Pose, fov: float, reach: float) -> Mask:
    """Whether all of each cell is in view; `down` and `across` lead to its first corner, (n,)."""
    far_down, far_across = np.maximum(-down, down + 1.0), np.maximum(-across, across + 1.0)
    is_near = far_down * far_down + far_across * far_across <= reach * reach
    if fov >= 360.0:
        return is_near
    left, right = (_beside(down, across, pose.angle, side * fov / 2) for side in (-1.0, 1.0))
    return is_near & (left & right if fov <= 180.0 else left | right)


def _beside(down: Reals, across: Reals, angle: float, edge: float) -> Mask:
    """Whether all of each cell lies on the inner side of an edge that is so far off the angle."""
    sign, heading = math.copysign(1.0, edge), math.radians(angle + edge)
    sin, cos = sign * portable.sin(heading), sign * portable.cos(heading)
    return down * sin - across * cos + min(sin, 0.0) - max(cos, 0.0) >= 0.0


def forget_looks(grid: Cells) -> None:
    """Free cells are free again and have not been looked at."""
    grid[grid == SEEN] = FREE


def frontier(grid: Cells) -> Mask:
    """Free cells beside the unknown.

    Gaps between two beams do not count as unknown.
    """
    return free(grid) & grown_to_sides(expanses(grid == UNKNOWN))


def out_of_view(grid: Cells) -> Mask:
    """Free cells that the camera has not had in view; specks do not count."""
    return expanses(grid == FREE)


def expanses(mask: Mask) -> Mask:
    """What is left of a mask without all that is less than three cells wide."""
    return grown(_all_around(mask))


def grown_to_sides(mask: Mask) -> Mask:
    """Where a cell or one of those at its four sides is True."""
    made = mask.copy()
    made[1:] |= mask[:-1]
    made[:-1] |= mask[1:]
    made[:, 1:] |= mask[:, :-1]
    made[:, :-1] |= mask[:, 1:]
    return made


def _along(origin: float, steps: NDArray[np.float64], slopes: list[float]) -> NDArray[np.intp]:
    return np.floor(np.outer(slopes, steps) + origin).astype(np.intp)


def _all_around(mask: Mask) -> Mask:
    """Where a cell and its eight neighbours are True; never at the rim."""
    down = mask[:-2] & mask[1:-1] & mask[2:]
    made = np.zeros(mask.shape, np.bool_)
    made[1:-1, 1:-1] = down[:, :-2] & down[:, 1:-1] & down[:, 2:]
    return made


def grown(mask: Mask) -> Mask:
    """Where a cell or one of its eight neighbours is True."""
    down = mask.copy()
    down[1:] |= mask[:-1]
    down[:-1] |= mask[1:]
    made = down.copy()
    made[:, 1:] |= down[:, :-1]
    made[:, :-1] |= down[:, 1:]
    return made
