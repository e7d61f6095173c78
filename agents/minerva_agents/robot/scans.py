"""A whole scan on the evidence grid: all beams in one pass of array operations.

The result is that of one beam after another: a beam marks the cells that it passes as free, then
the cell at its end as an obstacle. Only the order of passes and hits of the same cell matters, and
few cells have both, so these alone are processed in order.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import MapError, Mask
from minerva_agents.robot.knowledge import (
    FREE,
    LONGEST,
    MARKER,
    SURE,
    Codes,
    after_hit,
    after_passing,
)
from minerva_agents.robot.motion import Reals
from minerva_bus import Cells

_AT_ONCE: Final = 1 << 20
"""Samples of beams in one pass, which bounds memory."""

# Most of these cells are the ends of beams: a call for each would take a tenth of a scan's time.
_AFTER_HIT: Final = tuple(map(after_hit, range(MARKER)))

Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class _Passes:
    """Cells that beams pass, in order: flat indices, the beam, and whether it is near enough."""

    cells: Places
    beams: Places
    near: Mask


def mark_scan(
    grid: Cells, row: float, column: float, rows: Reals, columns: Reals, part: float = 1.0
) -> None:
    """Mark what beams with a hit at their ends show.

    Unknown cells become free along each beam; obstacles lose evidence on its first `part` only. The
    cells at the ends gain evidence; markers and closed cells stay.

    Args:
        grid: the evidence grid, which is changed.
        row: of the laser, in cells.
        column: likewise.
        rows: of the ends of n beams in their order, (n,), in cells.
        columns: likewise.
        part: fraction of a beam on which it counts against obstacles.

    Raises:
        MapError: the end of a beam is not finite.

    """
    longest = np.maximum(np.abs(rows - row), np.abs(columns - column))
    if not np.isfinite(longest).all():
        raise MapError("a beam ends at infinity; give its distance in metres")
    counts = np.ceil(longest)
    passes = np.cumsum(np.minimum(counts, _most_samples(grid))) // _AT_ONCE
    borders = [0, *(1 + np.flatnonzero(passes[1:] != passes[:-1])).tolist(), len(rows)]
    for begin, end in pairwise(borders):
        ends = rows[begin:end], columns[begin:end]
        _mark(grid, (row, column), ends, counts[begin:end], part)


def _mark(
    grid: Cells, start: tuple[float, float], ends: tuple[Reals, Reals], counts: Reals, part: float
) -> None:
    flat: Codes = grid.reshape(-1)
    passes = _passes(grid, start, ends, counts, part)
    high, wide = grid.shape
    rows, columns = np.floor(ends[0]), np.floor(ends[1])
    hitting = np.flatnonzero((rows >= 0) & (rows < high) & (columns >= 0) & (columns < wide))
    hits = rows[hitting].astype(np.intp) * wide + columns[hitting].astype(np.intp)
    is_hit = np.zeros(flat.size, np.bool_)
    is_hit[hits] = True
    both = is_hit[passes.cells]
    _clear(flat, passes.cells[~both], passes.near[~both])
    # A hit follows the passes of its own beam.
    cells = np.concatenate((passes.cells[both], hits))
    kinds = np.concatenate((passes.near[both].astype(np.intp), np.full(len(hits), 2)))
    order = np.argsort(np.concatenate((2 * passes.beams[both], 2 * hitting + 1)), kind="stable")
    codes = dict(zip(hits.tolist(), flat[hits].tolist(), strict=True))
    for cell, kind in zip(cells[order].tolist(), kinds[order].tolist(), strict=True):
        code = codes[cell]
        if kind < 2:
            codes[cell] = after_passing(code, kind == 1)
        elif code < MARKER:
            codes[cell] = _AFTER_HIT[code]
    flat[list(codes)] = list(codes.values())


def _clear(flat: Codes, cells: Places, near: Mask) -> None:
    """Mark cells as free; each near pass of an obstacle removes 1 of its evidence."""
    codes = flat[cells]
    flat[cells] = np.maximum(codes, FREE)
    doubted = cells[near & (codes > FREE) & (codes <= SURE)]
    obstacles, times = np.unique(doubted, return_counts=True)
    flat[obstacles] = np.maximum(flat[obstacles] - times, FREE)


def _passes(
    grid: Cells, start: tuple[float, float], ends: tuple[Reals, Reals], counts: Reals, part: float
) -> _Passes:
    """The cells that beams pass before their ends, each once per beam.

    Consecutive samples are at most one row and one column apart, so no cell is skipped.
    """
    (row, column), (high, wide) = start, grid.shape
    steps = np.maximum(counts, 1.0)
    down, across = (ends[0] - row) / steps, (ends[1] - column) / steps
    back = np.maximum(counts - 1, 0)
    ended = np.floor(back * down + row) == np.floor(ends[0])
    ended &= np.floor(back * across + column) == np.floor(ends[1])
    counts = np.where(ended & (counts > 0), counts - 1, counts)
    lengths = np.minimum(counts, _most_samples(grid)).astype(np.intp)
    beams = np.repeat(np.arange(len(counts)), lengths)
    number = np.arange(len(beams)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    rows, columns = number * down[beams] + row, number * across[beams] + column
    inside = (rows >= 0) & (columns >= 0) & (rows < high) & (columns < wide)
    if not inside.all():
        beams, rows, columns = beams[inside], rows[inside], columns[inside]
        lengths = np.bincount(beams, minlength=len(counts))
        number = np.arange(len(beams)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    cells = rows.astype(np.intp) * wide + columns.astype(np.intp)
    near = number < np.ceil(part * counts)[beams]
    # Two samples may be in one cell: the last one counts.
    last = np.ones(len(cells), np.bool_)
    last[:-1] = (cells[1:] != cells[:-1]) | (beams[1:] != beams[:-1])
    return _Passes(cells[last], beams[last], near[last])


def _most_samples(grid: Cells) -> int:
    """Samples of a beam after which it has left the grid."""
    # Steps of a beam that ends off the grid are a little shorter than a cell, hence two more.
    return max(LONGEST, max(grid.shape) + 2)
