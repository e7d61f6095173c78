"""Cell lists: points sorted by the cells of a grid, and the pairs in cells that touch."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
Rows = NDArray[np.int64]

_MOST: Final = 2
"""Cells per point; more would mostly be empty."""
_FEW: Final = 64
"""Cells that are made for any number of points."""
_BLOCK: Final = 1 << 14
"""Candidates that are compared at once, so that their arrays stay in the cache."""
_CROWDED: Final = 32
"""Candidates per point up to which coarse cells take less time than a tree."""
_COARSE: Final = 2.0
"""Area of a cell, in squares of the radius, from which most candidates are no neighbours."""


@dataclass(frozen=True, slots=True)
class Axis:
    """One direction of a grid: `count` cells of equal length, from `start` to `start + length`."""

    start: float
    length: float
    count: int

    def cells(self, at: Numbers) -> Rows:
        """The cell of each coordinate.

        Coordinates closer than the length of a cell are in cells that touch.
        """
        if self.count == 1:
            return np.zeros(len(at), np.int64)
        cells = ((at - self.start) * (self.count / self.length)).astype(np.int64)
        return np.minimum(cells, self.count - 1)


@dataclass(frozen=True, slots=True)
class Candidates:
    """Points sorted by cell, and the places of those that may be near each point.

    Attributes:
        rows: the row of the point in each place; points at the edges of a periodic plane also have
            places beyond the opposite edges.
        start: the place of each point, twice.
        low: first place of those that may be near, and come later than the point.
        high: the place after the last of these.
        coarse: whether cells are much larger than the radius.

    """

    rows: Rows
    start: Rows
    low: Rows
    high: Rows
    coarse: bool

    def win(self) -> bool:
        """Whether comparing all candidates takes less time than a tree."""
        points = len(self.start) // 2
        return not self.coarse or int((self.high - self.low).sum()) <= _CROWDED * points

    def blocks(self) -> Iterator[tuple[Rows, Rows]]:
        """Places of the pairs of points that may be near each other, each pair once."""
        counts = self.high - self.low
        ends = np.cumsum(counts)
        total = int(ends[-1]) if len(ends) else 0
        borders = np.searchsorted(ends, np.arange(_BLOCK, total, _BLOCK), side="right")
        borders = np.unique(np.concatenate(([0], borders, [len(ends)])))
        for begin, end in zip(borders[:-1].tolist(), borders[1:].tolist(), strict=True):
            number = counts[begin:end]
            before = int(ends[begin] - counts[begin])
            offset = self.low[begin:end] - (ends[begin:end] - number - before)
            first = np.repeat(self.start[begin:end], number)
            yield first, np.arange(len(first)) + np.repeat(offset, number)


def grid(x: Numbers, y: Numbers, reach: float, size: tuple[float, float] | None) -> (
    tuple[Axis, Axis] | None
):  # fmt: skip
    """The two axes of a grid whose cells are at least `reach` long; None if there is none.

    A periodic plane of `size` has at least three cells in both directions, or a cell would touch
    another one twice.
    """
    least = 1 if size is None else 3
    starts = (float(x.min()), float(y.min())) if size is None else (0.0, 0.0)
    lengths = (float(x.max()) - starts[0], float(y.max()) - starts[1]) if size is None else size
    most = max(_MOST * len(x), _FEW)
    # The length between numbers near the limits of reals is infinite.
    full = [int(min(n / reach, most)) if math.isfinite(n) else least for n in lengths]
    across, down = (max(number, 1) for number in full)
    if min(across, down) < least:
        return None
    columns = across
    if across * down > most:
        columns = min(max(int(across * math.sqrt(most / (across * down))), least), across)
        down = min(max(most // columns, least), down)
        columns = min(max(most // down, least), across)
    return Axis(starts[0], lengths[0], columns), Axis(starts[1], lengths[1], down)


def candidates(
    x: Numbers, y: Numbers, reach: float, size: tuple[float, float] | None
) -> Candidates | None:
    """What each point is to be compared with, or None if the plane is too small for cells.

    Args:
        x: coordinates, from 0 to below the width in a periodic plane.
        y: likewise.
        reach: the least length of a cell.
        size: (width, height) of a periodic plane.

    """
    axes = grid(x, y, reach, size)
    if axes is None:
        return None
    across, down = axes
    tall = down.count + 2  # a row of cells beyond each edge; empty ones in a bounded plane
    cells = across.cells(x) * tall + down.cells(y) + 1
    rows = np.arange(len(x))
    if size is not None:
        rows, cells = _wrapped(rows, cells, across.count, down.count)
    places = order_of(cells, below=(across.count + 1) * tall)
    cells = cells[places]
    starts = np.zeros((across.count + 1) * tall + 1, np.int64)
    np.cumsum(np.bincount(cells, minlength=len(starts) - 1), out=starts[1:])
    own = np.flatnonzero(places < len(x))
    cells = cells[own]
    # A point is compared with the rest of its cell and the next one, and with the three cells of
    # the next column: the other four cells that touch its own have it among theirs.
    low = np.concatenate((own + 1, starts[cells + tall - 1]))
    high = np.concatenate((starts[cells + 2], starts[cells + tall + 2]))
    area = math.prod(max(axis.length / axis.count / reach, 1.0) for axis in axes)
    return Candidates(rows[places], np.concatenate((own, own)), low, high, area > _COARSE)


def order_of(*keys: Rows, below: int) -> Rows:
    """The stable order by the first key, then by the next ones; keys are integers >= 0."""
    # numpy sorts numbers of 16 bits digit by digit, in a fifth of the time of larger ones.
    shifts = range(0, max(below.bit_length(), 1), 16)
    return np.lexsort([(key >> shift).astype(np.uint16) for key in keys[::-1] for shift in shifts])


def _wrapped(rows: Rows, cells: Rows, across: int, down: int) -> tuple[Rows, Rows]:
    """Points with their copies beyond the edges: above, below, and right of the last column."""
    tall = down + 2
    level = cells % tall
    bottom, top = np.flatnonzero(level == 1), np.flatnonzero(level == down)
    rows = np.concatenate((rows, bottom, top))
    cells = np.concatenate((cells, cells[bottom] + down, cells[top] - down))
    left = np.flatnonzero(cells < tall)
    return np.concatenate((rows, rows[left])), np.concatenate((cells, cells[left] + across * tall))
