"""What a camera would newly see from a cell: ray casting over the grid, vectorised.

A ray has the camera's range, ends at known obstacles and passes a limited depth of unknown space,
because shadows end at the next wall. It counts free ground that the camera has not seen, and
unknown ground. Specks of both, which lie between beams, do not count unless the search is thorough,
and gaps of up to two cells between obstacles are closed: beams that far apart hit one wall.

News left over between ground already seen counts `LEFT_OVER` times: to return for it later would
cost a journey, while open ground ahead remains as large. Without this, a search leaves strips and
corners everywhere and crosses the floor again for each of them.

All counts are integers, so they are identical on every machine.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.blocks import block_sums, box_sums
from minerva_agents.robot.grids import Mask
from minerva_agents.robot.knowledge import FREE, UNKNOWN, obstacles
from minerva_agents.robot.looking import expanses, grown, grown_to_sides
from minerva_bus import Cells, portable

RAYS: Final = 48
"""Number of rays; ray i points at i * 360 / RAYS degrees in the grid's frame."""

_DEPTH: Final = 4.0
"""Maximum depth of unknown space that a ray passes, in metres."""

LEFT_OVER: Final = 3
"""How many times news counts that is left over."""

WORTH: Final = 3
"""The bits of a kind that say how many times a cell counts as news; a table takes longer."""

NOTHING: Final = 0
NEWS: Final = 1
REST: Final = LEFT_OVER
WALL: Final = 4
DARK: Final = 5

BLOCK: Final = 0.5
"""Side of a block in metres: for sums over many cells, and for candidates of a search."""

_AROUND: Final = 7
"""Blocks in each direction in which more seen than unseen ground makes news left over."""

Kinds = NDArray[np.uint8]
Counts = NDArray[np.int64]


def side_of(cell: float) -> int:
    """Side of a block in cells, for cells of so many metres."""
    return max(1, round(BLOCK / cell))


def kinds_of(grid: Cells, cell: float, is_thorough: bool = False) -> Kinds:
    """Class of each cell for ray casting: nothing, news, left over (rest), dark (unknown) or wall.

    Free and unknown specks are nothing, or, if `is_thorough`, news. `cell` is the cell side in
    metres.
    """
    walls = obstacles(grid)
    kinds = np.zeros(grid.shape, np.uint8)
    kinds[grid == FREE if is_thorough else expanses(grid == FREE)] = NEWS
    dark = _all_expanses(grid == UNKNOWN)
    kinds[dark] = DARK
    if is_thorough:
        kinds[(grid == UNKNOWN) & ~dark] = NEWS
    kinds[_closed(walls)] = WALL
    kinds[(kinds == NEWS) & _left_over(kinds, side_of(cell))] = REST
    return kinds


def _left_over(kinds: Kinds, side: int) -> Mask:
    """Cells of blocks that have more seen than unseen ground and no unknown ground around them."""
    unseen = box_sums(block_sums(kinds == NEWS, side), _AROUND)
    seen = box_sums(block_sums(kinds == NOTHING, side), _AROUND)
    dark = kinds == DARK
    border = box_sums(block_sums(dark & grown_to_sides(~dark & (kinds != WALL)), side), _AROUND)
    blocks = (unseen < seen) & (border == 0)
    rows, columns = kinds.shape
    return blocks.repeat(side, axis=0).repeat(side, axis=1)[:rows, :columns]


class Prospects:
    """Visibility from the cells of a grid of kinds (uint8, rows x columns).

    `sight` is the camera's range in cells, `cell` the cell side in metres.
    """

    def __init__(self, kinds: Kinds, sight: float, cell: float) -> None:
        self._reach = math.ceil(sight) + 1
        # Walls around the grid end all rays, so offsets need no bounds checks.
        padded = np.pad(kinds, self._reach, constant_values=WALL)
        self._width = padded.shape[1]
        self._kinds = padded.ravel()
        self._rows, self._columns, self._weights = _rays(sight)
        self._offsets = self._rows * self._width + self._columns
        self._steps = np.arange(len(self._weights))
        self._dark = max(1, math.floor(_DEPTH / cell))
        self._unit = 2.0 * math.pi / RAYS * cell * cell

    def views(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.float64]:
        """News in square metres along each ray from each of n cells; (n, RAYS)."""
        places = (rows + self._reach) * self._width + columns + self._reach
        seen = self._kinds.take(places[:, None, None] + self._offsets)
        # A wall behind the last step, so that every ray has a first end. Cumulative operations over
        # all cells would take longer than everything else.
        ends = np.ones((*seen.shape[:2], len(self._weights) + 1), np.bool_)
        ends[..., :-1] = seen == WALL
        first = ends.argmax(axis=2)
        # Deep inside unknown space there is probably a wall, so do not count all of it as news.
        dark = seen == DARK
        deep = (dark.sum(axis=2, dtype=np.uint16) > self._dark) & (first > self._dark)
        too_deep = np.cumsum(dark[deep], axis=1, dtype=np.uint16) > self._dark
        first[deep] = np.minimum(first[deep], too_deep.argmax(axis=1))
        is_open = self._steps < first[..., np.newaxis]
        return ((seen & WORTH) * is_open * self._weights).sum(axis=2) * self._unit


@lru_cache(maxsize=8)
def _rays(sight: float) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.int32]]:
    """Offsets in rows and columns of the cells on each ray, (RAYS, n), and the weight per step.

    A step's weight is the width of the ray's sector there, as a fraction of the circle.
    """
    steps = np.arange(1.0, max(sight, 1.5))  # one cell per step, so that no wall is skipped
    down, across = portable.cos_sin(np.radians(np.arange(RAYS) * 360.0 / RAYS))
    rows = np.floor(np.outer(down, steps) + 0.5).astype(np.intp)
    columns = np.floor(np.outer(across, steps) + 0.5).astype(np.intp)
    return rows, columns, np.rint(steps).astype(np.int32)


def _closed(walls: Mask) -> Mask:
    """Walls with gaps of up to two cells closed (morphological closing)."""
    return ~grown(~grown(np.pad(walls, 1)))[1:-1, 1:-1]


def _all_expanses(mask: Mask) -> Mask:
    """`expanses` with the mask continued beyond the grid."""
    return expanses(np.pad(mask, 2, constant_values=True))[2:-2, 2:-2]
