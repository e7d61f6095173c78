"""Pairs of boxes that may meet: a uniform grid, so that not all pairs are looked at.

Each box is entered in all cells that it reaches into; two meet in a cell, or not at all. Cells are
about as large as boxes, so that few are in one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

_ENTRIES: Final = 16
"""So many cells for each box, on average, are too many: then cells are made larger."""
_FAR: Final = 2.0**30
"""Boxes farther out than so many cells are in the outermost ones."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """n upright boxes; (n, 2) metres each."""

    lower: Floats
    upper: Floats

    def __len__(self) -> int:
        return len(self.lower)

    def take(self, rows: Rows) -> Boxes:
        """Some of them."""
        return Boxes(self.lower[rows], self.upper[rows])


def pairs_among(boxes: Boxes) -> tuple[Rows, Rows]:
    """All pairs of boxes that overlap or touch, each once, the lesser row first; in order."""
    one, other = pairs_between(boxes, boxes)
    once = np.flatnonzero(one < other)
    return one[once], other[once]


def pairs_between(some: Boxes, others: Boxes) -> tuple[Rows, Rows]:
    """All pairs of a box of some and one of others that overlap or touch; in order."""
    if not len(some) or not len(others):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    cell = _cell(some, others)
    here, there = _Entries.of(some, cell), _Entries.of(others, cell)
    one, other = _in_one_cell(here, there)
    corner = np.maximum(here.lowest[one], there.lowest[other])
    first = (corner == here.at[one]) & (corner == here.at[one])
    one, other = here.box[one], there.box[other]
    meet = (some.lower[one] <= others.upper[other]) & (others.lower[other] <= some.upper[one])
    kept = np.flatnonzero(first.all(axis=1) & meet.all(axis=1))
    one, other = one[kept], other[kept]
    order = np.lexsort((other, one))
    return one[order], other[order]


@dataclass(frozen=True, slots=True)
class _Entries:
    """Boxes in cells: which box, in which cell (n, 2), and the box's lowest cell (n, 2)."""

    box: Rows
    at: Rows
    lowest: Rows

    @staticmethod
    def of(boxes: Boxes, cell: float) -> _Entries:
        low, high = _cells(boxes, cell)
        wide = high - low + 1
        counts = wide[:, 0] * wide[:, 1]
        box = np.repeat(np.arange(len(boxes)), counts)
        nth = np.arange(len(box)) - np.repeat(np.cumsum(counts) - counts, counts)
        step = np.stack((nth // wide[box, 1], nth % wide[box, 1]), axis=1)
        return _Entries(box, low[box] + step, low[box])

    @property
    def keys(self) -> NDArray[np.int64]:
        """One number for each cell."""
        return (self.at[:, 0].astype(np.int64) << 32) + self.at[:, 1]


def _cells(boxes: Boxes, cell: float) -> tuple[Rows, Rows]:
    low, high = (
        np.floor(np.clip(corner / cell, -_FAR, _FAR)).astype(np.intp)
        for corner in (boxes.lower, boxes.upper)
    )
    return low, high


def _cell(some: Boxes, others: Boxes) -> float:
    """The side of a cell: twice the middle one of the smaller party's sizes, or more."""
    sizes = (some.upper - some.lower).max(axis=1)
    cell = 2.0 * float(np.median(sizes)) or 1.0
    enough = _ENTRIES * (len(some) + len(others))
    while _entries(some, cell) + _entries(others, cell) > enough:
        cell *= 2.0
    return cell


def _entries(boxes: Boxes, cell: float) -> float:
    low, high = _cells(boxes, cell)
    wide = (high - low + 1).astype(np.float64)
    return float((wide[:, 0] * wide[:, 1]).sum())


def _in_one_cell(some: _Entries, others: _Entries) -> tuple[Rows, Rows]:
    """Pairs of entries that are in the same cell."""
    keys = others.keys
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    begin, end = (np.searchsorted(keys, some.keys, side) for side in ("left", "right"))
    counts = end - begin
    one = np.repeat(np.arange(len(counts)), counts)
    nth = np.arange(len(one)) - np.repeat(np.cumsum(counts) - counts, counts)
    return one, order[begin[one] + nth]
