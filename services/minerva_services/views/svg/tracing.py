"""SVG paths of a matrix: one per colour, made of rectangles merged from its runs."""

from __future__ import annotations

import weakref
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.volumes import color_ranges, rectangles

Colors: TypeAlias = tuple[tuple[int, str], ...]
"""Lowest value and colour of each range, ascending, as in `Raster.colors`."""
Paths: TypeAlias = tuple[tuple[str, str], ...]
"""A colour and the path data of all its cells; cell [row, column] is the unit square at them."""
Columns: TypeAlias = NDArray[np.int64]


class Tracer:
    """Traces matrices, and caches the paths of read-only ones while the matrix exists.

    A map is the same array in every picture, so only the first one costs time.
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
        # A writeable matrix may change in place, so its paths cannot be cached.
        if not cells.flags.writeable:
            forget = weakref.ref(cells, lambda _: self._known.pop(key, None))
            self._known[key] = forget, paths
        return paths


def trace(cells: NDArray[Any], colors: Colors) -> Paths:
    """The paths of a matrix (rows, columns), x along its rows and y along its columns.

    Each cell is in exactly one path, or in none if its value has no colour.
    """
    drawn = np.array([False, *(color != "" for _, color in colors)])
    tone, *columns = rectangles(color_ranges(cells, colors), drawn)
    tones = np.arange(1, len(colors) + 1)
    first = np.searchsorted(tone, tones, "left")
    last = np.searchsorted(tone, tones, "right")
    return tuple(
        (color, _path_data(*(numbers[first[at] : last[at]] for numbers in columns)))
        for at, (_, color) in enumerate(colors)
        if first[at] < last[at]
    )


def _path_data(row: Columns, column: Columns, rows: Columns, columns: Columns) -> str:
    """`M<row> <column>h<rows>v<columns>h-<rows>z` for each rectangle, all at once.

    Texts of equal width form a byte matrix; padding zero bytes are removed at the end.
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
    """Decimal digits of non-negative numbers (n,) as ASCII (n, width), padded with zero bytes."""
    powers = 10 ** np.arange(len(str(numbers.max())) - 1, -1, -1)
    digits = (numbers[:, None] // powers % 10 + ord("0")).astype(np.uint8)
    # Leading zeros; the last digit stays, so 0 remains "0".
    digits[:, :-1][numbers[:, None] < powers[:-1]] = 0
    return digits
