"""Upper bounds on visible news, per square block of cells.

A search casts rays only from blocks where they may show enough (see `searching`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import UNKNOWN, Cell, Mask
from minerva_agents.robot.prospects import DARK, NEWS, WALL, Kinds
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
    free = _block_sums((kinds != DARK) & (kinds != WALL), side) > 0
    # A ray passes at most 4 m of unknown space; nine blocks of half a metre are more.
    dark = _block_sums(kinds == DARK, side) * (_box_sums(free.astype(np.int64), 9) > 0)
    news = _block_sums(kinds == NEWS, side) + dark
    reach = math.ceil(sight / cell / side)
    return _box_sums(news, reach) * (cell * cell)


def _block_sums(mask: Mask, side: int) -> NDArray[np.int64]:
    """Number of True cells per block."""
    rows, columns = mask.shape
    padded = np.pad(mask, ((0, -rows % side), (0, -columns % side)))
    shape = padded.shape[0] // side, side, padded.shape[1] // side, side
    return padded.reshape(shape).sum(axis=(1, 3))


def _box_sums(numbers: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
    """Per item, the sum of all items at most `reach` rows and columns away."""
    sums = np.pad(numbers, reach)
    for axis in (0, 1):
        before = np.insert(sums, 0, 0, axis=axis).cumsum(axis=axis)
        count = numbers.shape[axis]
        ends = np.arange(count) + 2 * reach + 1
        sums = before.take(ends, axis=axis) - before.take(np.arange(count), axis=axis)
    return sums
