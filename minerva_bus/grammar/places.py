"""Search for the rows of values in an array: numbers, and texts by a table of hashes."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]
Hashes = NDArray[np.uint64]

_SPREAD: Final = np.uint64(0xBF58476D1CE4E5B9)
_FACTOR: Final = 0x9E3779B97F4A7C15
_AT_ONCE: Final = 4096


def _powers(base: int, count: int) -> Hashes:
    return np.array([pow(base, exponent, 1 << 64) for exponent in range(count)], np.uint64)


@cache
def _weights(width: int) -> tuple[Hashes, Hashes]:
    """The weight of each letter, and by their number the factor that removes zero bytes."""
    return _powers(_FACTOR, width)[::-1].copy(), _powers(pow(_FACTOR, -1, 1 << 64), width + 1)


def hashes_of(texts: NDArray[np.bytes_]) -> Hashes:
    """The polynomial hash h -> h * factor + byte, modulo 2^64, of each text; shape (n,)."""
    count, width = len(texts), texts.dtype.itemsize
    weights, behind = _weights(width)
    letters = np.ascontiguousarray(texts).view(np.uint8).reshape(count, width)
    hashes = np.empty(count, np.uint64)
    # In blocks, because letters as 64-bit integers take eight times their memory.
    for at in range(0, count, _AT_ONCE):
        hashes[at : at + _AT_ONCE] = letters[at : at + _AT_ONCE].astype(np.uint64) @ weights
    # Each zero byte of padding has multiplied the hash by the factor; its inverse undoes that.
    return hashes * behind[width - np.strings.str_len(texts)]


def found_in(column: NDArray[Any], sorter: Rows, wanted: NDArray[Any]) -> Rows:
    """The row of each wanted value in a column that is not empty, -1 if it is not there."""
    places = np.searchsorted(column, wanted, sorter=sorter)
    rows = sorter[np.minimum(places, len(column) - 1)]
    return np.where(column[rows] == wanted, rows, -1)


class Numbers:
    """The rows of n integers, n > 0."""

    def __init__(self, numbers: NDArray[np.int64]) -> None:
        self._numbers = numbers
        self._sorter: Rows | None = None
        span = int(numbers[-1]) - int(numbers[0])
        # The ends are compared first, because that needs no pass over the array.
        self.consecutive = span == len(numbers) - 1 and bool((np.diff(numbers) == 1).all())
        """Whether each number is the previous one plus 1."""

    def rows_of(self, wanted: NDArray[np.int64]) -> Rows:
        """A row of each wanted number, -1 if it is not there; shape (len(wanted),)."""
        numbers = self._numbers
        if self.consecutive:
            rows = wanted - numbers[0]
            # As unsigned integers, negative differences are large: one comparison finds both kinds.
            rows[rows.view(np.uint64) >= len(numbers)] = -1
            return rows.astype(np.intp, copy=False)
        if self._sorter is None:
            self._sorter = np.argsort(numbers, kind="stable")
        return found_in(numbers, self._sorter, wanted)


class Places:
    """The first row of each of n hashes, n > 0.

    A table of at least 4 n slots finds most of them directly; the few whose slot is taken are
    sorted. This is several times faster than sorting all. Rows may be added while they are not
    many more than n.
    """

    def __init__(self, hashes: Hashes) -> None:
        bits = (4 * len(hashes)).bit_length()
        self._hashes = hashes
        self._shift = np.uint64(64 - bits)
        self._table = np.zeros(1 << bits, np.int32)
        self._others = np.empty(0, np.intp)
        """The rows whose slot has another row, in the order of their hashes."""
        self._other_hashes = np.empty(0, np.uint64)
        self._enter(np.arange(len(hashes)), self._slots(hashes))

    def extend(self, hashes: Hashes, begin: int) -> None:
        """Add rows from `begin` on; `hashes` are those of all rows."""
        self._hashes = hashes
        slots = self._slots(hashes[begin:])
        rows = np.arange(begin, len(hashes))
        # A slot with 0 is free, unless it is that of row 0.
        free = (self._table[slots] == 0) & (slots != self._slots(hashes[:1])[0])
        self._enter(rows[free], slots[free])
        self._keep(rows[~free])

    def _enter(self, rows: Rows, slots: Rows) -> None:
        """Write rows to free slots."""
        self._table[slots[::-1]] = rows[::-1]  # Reversed, so that the first of several remains.
        self._keep(rows[self._table[slots] != rows])

    def _keep(self, rows: Rows) -> None:
        """Sort rows whose slot is taken into the others."""
        rows = rows[np.argsort(self._hashes[rows], kind="stable")]
        hashes = self._hashes[rows]
        places = np.searchsorted(self._other_hashes, hashes, side="right")
        self._others = np.insert(self._others, places, rows)
        self._other_hashes = np.insert(self._other_hashes, places, hashes)

    def _slots(self, hashes: Hashes) -> Rows:
        return ((hashes * _SPREAD) >> self._shift).astype(np.intp)

    def rows_of(self, wanted: Hashes) -> Rows:
        """The row of each wanted hash, -1 if it is not there; shape (len(wanted),)."""
        rows = self._table[self._slots(wanted)].astype(np.intp)
        missed = np.flatnonzero(self._hashes[rows] != wanted)
        if len(missed) and len(self._others):
            hashes = wanted[missed]
            places = np.searchsorted(self._other_hashes, hashes)
            places = np.minimum(places, len(self._others) - 1)
            there = self._other_hashes[places] == hashes
            rows[missed] = np.where(there, self._others[places], -1)
        else:
            rows[missed] = -1
        return rows
