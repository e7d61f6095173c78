"""Broad phase: candidate pairs of boxes from a uniform grid, without testing all pairs.

Each box is entered into all cells that it overlaps; boxes that meet share a cell. Cells are about
the size of boxes, so that few boxes share one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

_MAX_CELLS_PER_BOX: Final = 16
"""Maximum mean number of cells per box; above it, cells are enlarged."""
_MAX_CELL: Final = 2.0**30
"""Boxes beyond this many cells from the origin are put into the outermost cells."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """n axis-aligned boxes; corners of shape (n, 2) in metres."""

    lower: Floats
    upper: Floats

    def __len__(self) -> int:
        return len(self.lower)

    def take(self, rows: Rows) -> Boxes:
        """The boxes of these rows."""
        return Boxes(self.lower[rows], self.upper[rows])


def pairs_among(boxes: Boxes) -> tuple[Rows, Rows]:
    """All pairs of boxes that overlap or touch, each once, lower row first, in order."""
    first, second = pairs_between(boxes, boxes)
    unique = np.flatnonzero(first < second)
    return first[unique], second[unique]


def pairs_between(boxes: Boxes, others: Boxes) -> tuple[Rows, Rows]:
    """All pairs between two sets of boxes that overlap or touch, in order."""
    if not len(boxes) or not len(others):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    cell = _cell(boxes, others)
    here, there = _Entries.of(boxes, cell), _Entries.of(others, cell)
    first, second = _in_one_cell(here, there)
    # A pair that shares several cells counts in one of them only: the lowest that both overlap.
    corner = np.maximum(here.lowest[first], there.lowest[second])
    unique = corner == here.at[first]
    first, second = here.box[first], there.box[second]
    meet = (boxes.lower[first] <= others.upper[second]) & (
        others.lower[second] <= boxes.upper[first]
    )
    kept = np.flatnonzero(unique.all(axis=1) & meet.all(axis=1))
    first, second = first[kept], second[kept]
    order = np.lexsort((second, first))
    return first[order], second[order]


@dataclass(frozen=True, slots=True)
class _Entries:
    """Boxes by cell: the box, its cell (n, 2), and the lowest cell of the box (n, 2)."""

    box: Rows
    at: Rows
    lowest: Rows

    @staticmethod
    def of(boxes: Boxes, cell: float) -> _Entries:
        low, high = _cells(boxes, cell)
        wide = high - low + 1
        counts = wide[:, 0] * wide[:, 1]
        box = np.repeat(np.arange(len(boxes)), counts)
        # Number each row within its box, without a loop.
        nth = np.arange(len(box)) - np.repeat(np.cumsum(counts) - counts, counts)
        step = np.stack((nth // wide[box, 1], nth % wide[box, 1]), axis=1)
        return _Entries(box, low[box] + step, low[box])

    @property
    def keys(self) -> NDArray[np.int64]:
        """One integer per cell."""
        # Cell numbers fit in 32 bits because of _MAX_CELL, so keys are unique.
        return (self.at[:, 0].astype(np.int64) << 32) + self.at[:, 1]


def _cells(boxes: Boxes, cell: float) -> tuple[Rows, Rows]:
    low, high = (
        np.floor(np.clip(corner / cell, -_MAX_CELL, _MAX_CELL)).astype(np.intp)
        for corner in (boxes.lower, boxes.upper)
    )
    return low, high


def _cell(boxes: Boxes, others: Boxes) -> float:
    """Side of a cell: at least twice the median size of the first set."""
    sizes = (boxes.upper - boxes.lower).max(axis=1)
    # Points only: the median size is 0, so any cell will do.
    cell = 2.0 * float(np.median(sizes)) or 1.0
    # The median ignores outliers, so one huge box among small ones could fill millions of cells.
    # Larger cells bound the memory.
    enough = _MAX_CELLS_PER_BOX * (len(boxes) + len(others))
    while _entries(boxes, cell) + _entries(others, cell) > enough:
        cell *= 2.0
    return cell


def _entries(boxes: Boxes, cell: float) -> float:
    low, high = _cells(boxes, cell)
    wide = (high - low + 1).astype(np.float64)
    # As floats: a box may span 2^62 cells, and the sum of several would overflow an integer.
    return float((wide[:, 0] * wide[:, 1]).sum())


def _in_one_cell(boxes: _Entries, others: _Entries) -> tuple[Rows, Rows]:
    """Pairs of entries in the same cell."""
    # A join by cell: sort one side, then find the range of equal keys for each entry of the other.
    keys = others.keys
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    begin, end = (np.searchsorted(keys, boxes.keys, side) for side in ("left", "right"))
    counts = end - begin
    first = np.repeat(np.arange(len(counts)), counts)
    nth = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    return first, order[begin[first] + nth]
