"""From a matrix to paths: one for each colour, made of as few rectangles as its runs allow."""

from __future__ import annotations

import weakref
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Colors: TypeAlias = tuple[tuple[int, str], ...]
"""Least value of a range and its colour, ascending, as in `Raster.colors`."""
Paths: TypeAlias = tuple[tuple[str, str], ...]
"""A colour and the path data of all its cells; cell [row, column] is the unit square at them."""
Columns: TypeAlias = NDArray[np.int64]


class Tracer:
    """Traces matrices, and remembers a read-only one's paths for as long as the matrix lives.

    A map stands in every picture as the very same array: only its first picture pays for it.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[int, Colors], tuple[weakref.ref[NDArray[Any]], Paths]] = {}

    def paths(self, cells: NDArray[Any], colors: Colors) -> Paths:
        """The paths of a matrix (rows, columns) in the colours of its values."""
        key = id(cells), colors
        known = self._known.get(key)
        if known is not None and known[0]() is cells:
            return known[1]
        paths = trace(cells, colors)
        if not cells.flags.writeable:
            forget = weakref.ref(cells, lambda _: self._known.pop(key, None))
            self._known[key] = forget, paths
        return paths


def trace(cells: NDArray[Any], colors: Colors) -> Paths:
    """The paths of a matrix (rows, columns), x along its rows and y along its columns.

    Each cell is in exactly one path, or in none where its value has no colour.
    """
    drawn = np.array([False, *(color != "" for _, color in colors)])
    tone, *rectangles = _rectangles(_tones(cells, colors), drawn)
    tones = np.arange(1, len(colors) + 1)
    first = np.searchsorted(tone, tones, "left")
    last = np.searchsorted(tone, tones, "right")
    return tuple(
        (color, _path_data(*(numbers[first[at] : last[at]] for numbers in rectangles)))
        for at, (_, color) in enumerate(colors)
        if first[at] < last[at]
    )


def _tones(cells: NDArray[Any], colors: Colors) -> NDArray[np.uint16]:
    """For each cell the number of its range, from 1; 0 below the first. Same shape."""
    tones = np.zeros(cells.shape, np.uint16)
    for least, _ in colors:
        tones += cells >= least
    return tones


def _rectangles(tones: NDArray[np.uint16], drawn: NDArray[np.bool_]) -> tuple[Columns, ...]:
    """Runs along the columns, those that go on unchanged in the next row merged.

    Returns five columns (n,), sorted by the first: tone, row, column, rows, columns.
    """
    rows, columns = tones.shape
    if not tones.size:
        return (np.empty(0, np.int64),) * 5
    opens = np.ones(tones.shape, np.bool_)
    np.not_equal(tones[:, 1:], tones[:, :-1], out=opens[:, 1:])
    starts = np.flatnonzero(opens)
    lengths = np.diff(starts, append=tones.size)
    tone = tones.ravel()[starts].astype(np.int64)
    shown = drawn[tone]
    row, column = np.divmod(starts[shown], columns)
    # One number for (tone, column, length, row): sorted, a run and its continuation in the next
    # row are neighbours that differ by 1. No row has the number `rows`, so nothing else does.
    shape = tone[shown] * columns + column
    runs = np.sort((shape * (columns + 1) + lengths[shown]) * (rows + 1) + row)
    heads = np.flatnonzero(np.diff(runs, prepend=-2) != 1)
    shape, row = np.divmod(runs[heads], rows + 1)
    shape, length = np.divmod(shape, columns + 1)
    tone, column = np.divmod(shape, columns)
    return tone, row, column, np.diff(heads, append=runs.size), length


def _path_data(row: Columns, column: Columns, rows: Columns, columns: Columns) -> str:
    """`M<row> <column>h<rows>v<columns>h-<rows>z` for each rectangle, all at once.

    Texts of one width stand in a byte matrix; zero bytes fill up and are dropped at the end.
    """
    height, width = _digits(rows), _digits(columns)
    pieces = ["M", _digits(row), " ", _digits(column), "h", height, "v", width, "h-", height, "z"]
    table = np.concatenate([_repeated(piece, row.size) for piece in pieces], axis=1)
    return table[table != 0].tobytes().decode("ascii")


def _repeated(piece: str | NDArray[np.uint8], times: int) -> NDArray[np.uint8]:
    if not isinstance(piece, str):
        return piece
    return np.tile(np.frombuffer(piece.encode("ascii"), np.uint8), (times, 1))


def _digits(numbers: Columns) -> NDArray[np.uint8]:
    """Decimal digits of numbers (n,) from 0 as ASCII (n, width), zero bytes before the first."""
    powers = 10 ** np.arange(len(str(numbers.max())) - 1, -1, -1)
    digits = (numbers[:, None] // powers % 10 + ord("0")).astype(np.uint8)
    digits[:, :-1][numbers[:, None] < powers[:-1]] = 0
    return digits
