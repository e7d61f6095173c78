"""From cells to walls: rectangles that cover them, and the sides that are seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.bool_]
Whole = NDArray[np.int64]


def rectangles(mask: Cells) -> Whole:
    """Rectangles (n, 4) of row, column, rows, columns that cover each true cell exactly once.

    Runs along the columns; those that go on unchanged in the next row are one rectangle.
    """
    row, first, past = _runs(mask)
    order = np.lexsort((row, past, first))
    row, first, past = row[order], first[order], past[order]
    same = (first[1:] == first[:-1]) & (past[1:] == past[:-1]) & (row[1:] == row[:-1] + 1)
    heads = np.flatnonzero(~np.concatenate([[False], same])) if row.size else row
    rows = np.diff(heads, append=row.size)
    return np.stack([row[heads], first[heads], rows, past[heads] - first[heads]], axis=1)


def sides(mask: Cells) -> Whole:
    """Sides (n, 5) between true cells and others: row, column, row, column, which way they face.

    The two corners of a side come so that the true cells lie left of the way from one to the
    other. It faces down the rows (0), up the rows (1), down the columns (2) or up them (3).
    """
    padded = np.pad(mask, 1)
    down, up = padded[1:, :] & ~padded[:-1, :], padded[:-1, :] & ~padded[1:, :]
    left, right = padded[:, 1:] & ~padded[:, :-1], padded[:, :-1] & ~padded[:, 1:]
    found = [
        _sides(down[:, 1:-1], 0),
        _sides(up[:, 1:-1], 1),
        _sides(left[1:-1, :].T, 2),
        _sides(right[1:-1, :].T, 3),
    ]
    return np.concatenate(found)


def enclosed(hollow: Cells, wall: Cells) -> Cells:
    """Which hollow cells are walled in: no way over hollow cells leads off, or to other cells."""
    beside = np.pad(~(hollow | wall), 1, constant_values=True)
    near = beside[2:, 1:-1] | beside[:-2, 1:-1] | beside[1:-1, 2:] | beside[1:-1, :-2]
    found, before = hollow & near, -1
    while (count := int(found.sum())) != before:
        before = count
        found = _spread(_spread(found, hollow).T, hollow.T).T
    return hollow & ~found


def _spread(found: Cells, hollow: Cells) -> Cells:
    """The runs of hollow cells along the columns of which something is found."""
    if not hollow.size:
        return hollow
    opens = np.ones(hollow.shape, np.bool_)
    opens[:, 1:] = hollow[:, 1:] != hollow[:, :-1]
    starts = np.flatnonzero(opens)
    touched = np.logical_or.reduceat(found.ravel(), starts)
    lengths = np.diff(starts, append=hollow.size)
    return np.repeat(touched, lengths).reshape(hollow.shape) & hollow


def _sides(edges: Cells, way: int) -> Whole:
    line, first, past = _runs(edges)
    start, end = (past, first) if way in (0, 3) else (first, past)
    corners = (line, start, line, end) if way < 2 else (start, line, end, line)
    return np.stack([*corners, np.full_like(line, way)], axis=1)


def _runs(mask: Cells) -> tuple[Whole, Whole, Whole]:
    """Rows, first columns and the columns behind the last of all runs of true cells."""
    padded = np.pad(mask, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    row, first = np.nonzero(steps == 1)
    _, past = np.nonzero(steps == -1)
    return row, first, past
