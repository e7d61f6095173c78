"""Where a search looks for viewpoints: the known part of the grid, and bounds on visible news.

Rays are cast only from blocks where they may show enough (see `searching`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.blocks import block_sums, box_sums
from minerva_agents.robot.knowledge import UNKNOWN
from minerva_agents.robot.motion import Cell
from minerva_agents.robot.prospects import DARK, LEFT_OVER, NEWS, REST, WALL, Kinds
from minerva_bus import Cells

Numbers = NDArray[np.floating[Any]]


def known_window(grid: Cells, here: Cell, side: int) -> tuple[int, int, int, int]:
    """The known part of the grid plus a margin: top, left, bottom, right.

    Aligned to whole blocks of `side` cells, so that blocks do not shift as the map grows.
    """
    spans: list[tuple[int, int]] = []
    for axis in (0, 1):
        lines = np.flatnonzero((grid != UNKNOWN).any(axis=1 - axis))
        first = min(int(lines[0]), here[axis]) if lines.size else here[axis]
        last = max(int(lines[-1]), here[axis]) if lines.size else here[axis]
        margin = 3 * side
        begin = max(0, (first - margin) // side * side)
        spans.append((begin, min(grid.shape[axis], last + margin + 1)))
    (top, bottom), (left, right) = spans
    return top, left, bottom, right


def news_bounds(kinds: Kinds, side: int, sight: float, cell: float) -> Numbers:
    """Upper bound on the news visible from each block, in m²: all news within range.

    `side` is that of a block in cells, `sight` the range and `cell` the cell side, in metres.
    """
    free = block_sums((kinds != DARK) & (kinds != WALL), side) > 0
    # A ray passes at most 4 m of unknown space; nine blocks of half a metre are more.
    dark = block_sums(kinds == DARK, side) * (box_sums(free.astype(np.int64), 9) > 0)
    news = block_sums(kinds == NEWS, side) + LEFT_OVER * block_sums(kinds == REST, side) + dark
    reach = math.ceil(sight / cell / side)
    return box_sums(news, reach) * (cell * cell)
