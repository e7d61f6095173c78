"""Cells of a matrix as few rectangles: colour ranges, and runs merged across rows."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Integers: TypeAlias = NDArray[np.int64]


def color_ranges(cells: NDArray[Any], colors: Iterable[tuple[int, str]]) -> NDArray[np.uint16]:
    """For each cell the number of its colour range, from 1; 0 below the first. Same shape."""
    numbers = np.zeros(cells.shape, np.uint16)
    for least, _ in colors:
        numbers += cells >= least
    return numbers


def rectangles(numbers: NDArray[np.uint16], drawn: NDArray[np.bool_]) -> tuple[Integers, ...]:
    """Rectangles that cover each cell whose number is `drawn` exactly once.

    Runs along the columns that continue unchanged in the next row merge to one rectangle. Returns
    five columns (n,), sorted by number, column and length of the run, and row: number, row, column,
    rows, columns.
    """
    rows, columns = numbers.shape
    if not numbers.size:
        return (np.empty(0, np.int64),) * 5
    opens = np.ones(numbers.shape, np.bool_)
    np.not_equal(numbers[:, 1:], numbers[:, :-1], out=opens[:, 1:])
    starts = np.flatnonzero(opens)
    lengths = np.diff(starts, append=numbers.size)
    number = numbers.ravel()[starts].astype(np.int64)
    shown = drawn[number]
    row, column = np.divmod(starts[shown], columns)
    # One integer for (number, column, length, row): after sorting, a run and its continuation in
    # the next row are neighbours that differ by 1. No row has the number `rows`, so no other pair
    # does.
    shape = number[shown] * columns + column
    runs = np.sort((shape * (columns + 1) + lengths[shown]) * (rows + 1) + row)
    heads = np.flatnonzero(np.diff(runs, prepend=-2) != 1)
    shape, row = np.divmod(runs[heads], rows + 1)
    shape, length = np.divmod(shape, columns + 1)
    number, column = np.divmod(shape, columns)
    return number, row, column, np.diff(heads, append=runs.size), length


def mask_rectangles(mask: NDArray[np.bool_]) -> Integers:
    """Rectangles (n, 4) of row, column, rows, columns that cover each true cell exactly once."""
    covered = rectangles(mask.astype(np.uint16), np.array([False, True]))
    return np.stack(covered[1:], axis=1)
