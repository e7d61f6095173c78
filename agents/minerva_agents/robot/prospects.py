"""What a camera would see of the unseen from a place: rays over the grid, many places at a time.

A ray goes as far as the camera sees, ends at what is known to be an obstacle, and passes some of
the unknown: the more, the less it is a mere shadow of something, which ends at the next wall. It
counts ground that is free but was not in view, and the unknown. Specks of both, which lie between
beams, count for nothing, and a gap of two cells between obstacles is none: beams that far apart
have met one wall.

All counts are whole numbers, so they are the same on every machine.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import FREE, UNKNOWN, Mask, obstacles
from minerva_agents.robot.looking import expanses, grown
from minerva_bus import Cells, portable

RAYS: Final = 48
"""Directions of the rays: ray i goes at i * 360 / RAYS degrees, in the grid's own directions."""

_DEPTH: Final = 4.0
"""Metres of the unknown that a ray passes."""

NOTHING: Final = 0
NEWS: Final = 1
DARK: Final = 2
WALL: Final = 3

Kinds = NDArray[np.uint8]
Counts = NDArray[np.int64]


def kinds_of(grid: Cells) -> Kinds:
    """What each cell is to a ray: nothing, news, dark (unknown) or a wall."""
    walls = obstacles(grid)
    kinds = np.zeros(grid.shape, np.uint8)
    kinds[expanses(grid == FREE)] = NEWS
    kinds[_all_expanses(grid == UNKNOWN)] = DARK
    kinds[_closed(walls)] = WALL
    return kinds


class Prospects:
    """What is to be seen from the cells of a grid, by its kinds (uint8, rows x columns).

    `sight` is how far the camera sees in cells, `cell` the side of a cell in metres.
    """

    def __init__(self, kinds: Kinds, sight: float, cell: float) -> None:
        self._reach = math.ceil(sight) + 1
        padded = np.pad(kinds, self._reach, constant_values=WALL)
        self._width = padded.shape[1]
        self._kinds = padded.ravel()
        self._rows, self._columns, self._weights = _rays(sight)
        self._offsets = self._rows * self._width + self._columns
        self._dark = max(1, math.floor(_DEPTH / cell))
        self._unit = 2.0 * math.pi / RAYS * cell * cell

    def views(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.float64]:
        """Square metres of news that each ray from each of n cells sees; (n, RAYS)."""
        places = (rows + self._reach) * self._width + columns + self._reach
        seen = self._kinds.take(places[:, None, None] + self._offsets)
        dark = seen == DARK
        ends = seen == WALL
        ends |= np.cumsum(dark, axis=2, dtype=np.uint16) > self._dark
        is_open = ~np.logical_or.accumulate(ends, axis=2)
        news = (dark | (seen == NEWS)) & is_open
        return (news * self._weights).sum(axis=2) * self._unit


@lru_cache(maxsize=8)
def _rays(sight: float) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.int32]]:
    """Rows and columns from a cell to those on each ray, (RAYS, n), and the weight of each step.

    A step's weight is the breadth that the ray stands for there, as a part of the whole circle.
    """
    steps = np.arange(1.0, max(sight, 1.5))  # a cell at a time, or a ray would leave out walls
    angles = [math.radians(i * 360.0 / RAYS) for i in range(RAYS)]
    rows = np.floor(np.outer([portable.cos(one) for one in angles], steps) + 0.5).astype(np.intp)
    columns = np.floor(np.outer([portable.sin(one) for one in angles], steps) + 0.5).astype(np.intp)
    return rows, columns, np.rint(steps).astype(np.int32)


def _closed(walls: Mask) -> Mask:
    """Walls without gaps of one or two cells: grown by a cell and shrunk again."""
    return ~grown(~grown(np.pad(walls, 1)))[1:-1, 1:-1]


def _all_expanses(mask: Mask) -> Mask:
    """As `expanses`, where the mask goes on beyond the grid."""
    return expanses(np.pad(mask, 2, constant_values=True))[2:-2, 2:-2]
