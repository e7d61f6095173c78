"""Visible sides of cells, for wall meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.bool_]
Integers = NDArray[np.int64]


def sides(mask: Cells) -> Integers:
    """Sides (n, 5) between true and false cells: row, column, row, column, facing direction.

    The corners are ordered such that true cells lie to the left of the way from the first to the
    second. Directions: down the rows (0), up the rows (1), down the columns (2), up the columns
    (3).
    """
    # With padding, the border of the matrix is a side as well.
    padded = np.pad(mask, 1)
    down, up = padded[1:, :] & ~padded[:-1, :], padded[:-1, :] & ~padded[1:, :]
    left, right = padded[:, 1:] & ~padded[:, :-1], padded[:, :-1] & ~padded[:, 1:]
    edges = [
        _sides(down[:, 1:-1], 0),
        _sides(up[:, 1:-1], 1),
        _sides(left[1:-1, :].T, 2),
        _sides(right[1:-1, :].T, 3),
    ]
    return np.concatenate(edges)


def enclosed(hollow: Cells, wall: Cells) -> Cells:
    """Hollow cells that are enclosed by walls: no path over hollow cells leads outside."""
    beside = np.pad(~(hollow | wall), 1, constant_values=True)
    near = beside[2:, 1:-1] | beside[:-2, 1:-1] | beside[1:-1, 2:] | beside[1:-1, :-2]
    reachable, before = hollow & near, -1
    # Each pass fills whole runs in both directions, so few passes suffice.
    while (count := int(reachable.sum())) != before:
        before = count
        reachable = _spread(_spread(reachable, hollow).T, hollow.T).T
    return hollow & ~reachable


def _spread(reached: Cells, hollow: Cells) -> Cells:
    """Runs of hollow cells along the columns that contain a reached cell."""
    if not hollow.size:
        return hollow
    opens = np.ones(hollow.shape, np.bool_)
    # Each line begins a run, because runs must not continue from one line to the next.
    opens[:, 1:] = hollow[:, 1:] != hollow[:, :-1]
    starts = np.flatnonzero(opens)
    touched = np.logical_or.reduceat(reached.ravel(), starts)
    lengths = np.diff(starts, append=hollow.size)
    return np.repeat(touched, lengths).reshape(hollow.shape) & hollow


def _sides(edges: Cells, way: int) -> Integers:
    line, first, past = _runs(edges)
    start, end = (past, first) if way in (0, 3) else (first, past)
    corners = (line, start, line, end) if way < 2 else (start, line, end, line)
    return np.stack([*corners, np.full_like(line, way)], axis=1)


def _runs(mask: Cells) -> tuple[Integers, Integers, Integers]:
    """Row, first column and end column of all runs of true cells."""
    padded = np.pad(mask, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    row, first = np.nonzero(steps == 1)
    _, past = np.nonzero(steps == -1)
    return row, first, past
