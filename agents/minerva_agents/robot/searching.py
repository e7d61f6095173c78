"""Where to look next for a marker that has not been seen: the most news for the way there.

What has not been seen falls into regions: ground that is known to be free but that the camera has
not had in view, and the first half metre of the unknown beside free ground. Walls part them; what
lies behind a wall is no news from before it. The larger the region and the shorter the way to its
edge, the more a place there is worth. A corner of less than two square metres waits until
nothing larger is left.

A way has a metre more, so that the robot does not run after every speck beside it, and up to
another one for turning, which takes as long as driving that far. Size counts for little, with a
power of 0.3: what is near is finished before the robot leaves for something larger. The numbers
were chosen by trial on the office plan, from starts around the reception to all rooms, and the
power on the office plan and the depot. They are no optimum, and a slightly different threshold or
price of turning may lead through the rooms in another order.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import FREE, UNKNOWN, Cell, Mask, free, obstacles
from minerva_agents.robot.looking import expanses, frontier, grown_to_sides, out_of_view
from minerva_agents.robot.motion import Pose
from minerva_agents.robot.placing import lower, regions
from minerva_agents.robot.planning import Path, nearest, shortest_path
from minerva_bus import Cells, portable

_DEPTH: Final = 0.5
_LEAST: Final = 2.0
_MOST: Final = 9.0
"""Square metres above which no region is worth more; nobody sees more at one time."""

_POWER: Final = 0.3
_AHEAD: Final = 1.0
_HALF_TURN: Final = 1.0
_MOST_BLOCKS: Final = 6000
_SIDE: Final = 2

Numbers = NDArray[np.float64]


def path_to_news(grid: Cells, closed: Mask, pose: Pose, cell: float) -> Path | None:
    """The path to the place that is worth its way most; None where all has been seen.

    `closed` is where the robot must not go, `cell` the side of a cell in metres.
    """
    here = math.floor(pose.row), math.floor(pose.column)
    news = (frontier(grid) | out_of_view(grid)) & ~closed
    if not news.any():
        return None
    metres = _distances(closed, here) * cell + _turns(grid, pose) * _HALF_TURN
    worth = np.where(news, _gain(grid, news, cell) / (metres + _AHEAD), 0.0)
    row, column = divmod(int(np.argmax(worth)), grid.shape[1])
    path = shortest_path(closed, here, (row, column)) if worth[row, column] else None
    return path or nearest(closed, here, news)


def _gain(grid: Cells, news: Mask, cell: float) -> Numbers:
    """What the region at each cell or beside it is worth; small ones only if no news is larger."""
    area = np.minimum(_areas(_unseen(grid, round(_DEPTH / cell))) * (cell * cell), _MOST)
    large = area >= _LEAST
    if (news & large).any():
        area[~large] = 0.0
    return area**_POWER


def _unseen(grid: Cells, depth: int) -> Mask:
    """Free ground out of view, and the unknown up to `depth` cells from what is free."""
    near, no_wall = free(grid), ~obstacles(grid)
    for _ in range(depth):
        near = grown_to_sides(near) & no_wall
    return (grid == FREE) | expanses(near & (grid == UNKNOWN))


def _areas(mask: Mask) -> Numbers:
    """For each cell how many cells the largest region has that it or one beside it belongs to."""
    labels = regions(mask)
    counts = np.bincount(labels.ravel())
    counts[labels[~mask]] = 0
    own = counts[labels].astype(np.float64)
    most = own.copy()
    np.maximum(most[1:], own[:-1], out=most[1:])
    np.maximum(most[:-1], own[1:], out=most[:-1])
    np.maximum(most[:, 1:], own[:, :-1], out=most[:, 1:])
    np.maximum(most[:, :-1], own[:, 1:], out=most[:, :-1])
    return most


def _turns(grid: Cells, pose: Pose) -> Numbers:
    """For each cell how far the robot has to turn to face it, 0 to 1 for half a turn."""
    rows, columns = np.ogrid[: grid.shape[0], : grid.shape[1]]
    bearings = np.degrees(portable.atan2(columns + 0.5 - pose.column, rows + 0.5 - pose.row))
    return np.abs((bearings - pose.angle + 180.0) % 360.0 - 180.0) / 180.0


def _distances(closed: Mask, here: Cell) -> Numbers:
    """The length of the way to each cell, in cells, to the accuracy of blocks of cells."""
    rows, columns = closed.shape
    side = max(_SIDE, math.ceil(math.sqrt(closed.size / 4 / _MOST_BLOCKS)))
    padded = np.pad(~closed, ((0, -rows % side), (0, -columns % side)))
    shape = padded.shape[0] // side, side, padded.shape[1] // side, side
    blocks = np.where(padded.reshape(shape).any(axis=(1, 3)), np.inf, -1.0)
    lower(blocks, (here[0] // side, here[1] // side))
    blocks[blocks < 0] = np.inf
    return np.repeat(np.repeat(blocks * side, side, axis=0), side, axis=1)[:rows, :columns]
