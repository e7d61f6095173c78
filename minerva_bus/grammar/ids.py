"""The ids of many agents as one column.

    Numbered   stem + number for each: fox0, fox1, ...     one int64 an id
    Spelled    any others, at most 64 characters long      a numpy array of bytes

Both are the same texts: they compare, digest and hash alike.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from operator import is_
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.scene import AGENT_ID

LONGEST: Final = 64
_LINES = re.compile(rb"(?:[A-Za-z0-9_][A-Za-z0-9_:-]*+\n)*+")
_NUMBERED = re.compile(r"(.*?)(0|[1-9][0-9]{0,17})", re.DOTALL)
_FACTOR: Final = np.uint64(0x9E3779B97F4A7C15)

Numbers = NDArray[np.int64]
Rows = NDArray[np.intp]


class Ids:
    """n ids in order. Immutable."""

    def __init__(self, stem: str | None, data: NDArray[Any]) -> None:
        self._stem = stem
        self._data = data
        self._joined: tuple[tuple[Ids, ...], Ids] | None = None
        self.chunks = b""
        data.flags.writeable = False

    @staticmethod
    def numbered(stem: str, numbers: NDArray[np.integer[Any]] | range) -> Ids:
        """The stem with each of some whole numbers, from 0, behind it."""
        return Ids(stem, np.array(numbers, np.int64))

    @staticmethod
    def of(texts: Sequence[str]) -> Ids:
        """These very ids."""
        numbers = _numbers(texts)
        if numbers is not None:
            return Ids(*numbers)
        width = _width(texts)
        try:
            return Ids(None, np.array(texts, f"S{width}"))
        except UnicodeEncodeError:  # no ids, then, but that is for others to say
            return Ids(None, np.array([one.encode() for one in texts], f"S{4 * width}"))

    def __len__(self) -> int:
        return len(self._data)

    def __getitem__(self, row: int) -> str:
        if self._stem is None:
            return self._data[row].decode()
        return f"{self._stem}{self._data[row]}"

    def __iter__(self) -> Iterator[str]:
        return iter(self.texts())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Ids):
            return NotImplemented
        if self is other:
            return True
        if self._stem is not None and self._stem == other._stem:
            return np.array_equal(self._data, other._data)
        return len(self) == len(other) and bool((self.spelled == other.spelled).all())

    def __hash__(self) -> int:
        return hash(self.spelled.tobytes())

    @property
    def stem(self) -> str | None:
        """What numbered ids begin with; None for spelled ones."""
        return self._stem

    @property
    def data(self) -> NDArray[Any]:
        """The numbers behind the stem (int64), or the ids as bytes."""
        return self._data

    def texts(self) -> list[str]:
        """The ids as texts."""
        if self._stem is None:
            try:
                return self._data.astype("U").tolist()
            except UnicodeDecodeError:
                return [one.decode() for one in self._data.tolist()]
        return [f"{self._stem}{number}" for number in self._data.tolist()]

    @cached_property
    def column(self) -> NDArray[Any]:
        """The ids as texts in an array, shape (n,): made once for all that show them."""
        made = np.empty(len(self), object)
        made[:] = self.texts()
        made.flags.writeable = False
        return made

    @cached_property
    def spelled(self) -> NDArray[np.bytes_]:
        """The ids as bytes, shape (n,)."""
        if self._stem is None:
            return self._data
        digits = self._data.astype(f"S{len(str(int(self._data.max())))}" if len(self) else "S1")
        return np.strings.add(self._stem.encode(), digits)

    def take(self, rows: NDArray[Any] | slice) -> Ids:
        """The ids of some rows."""
        taken = Ids(self._stem, self._data[rows])
        if "hashes" in self.__dict__:
            taken.__dict__["hashes"] = self.hashes[rows]
        return taken

    @staticmethod
    def concatenated(parts: Sequence[Ids]) -> Ids:
        """The ids of several columns, one after another."""
        first, others = parts[0], tuple(parts[1:])
        if not others:
            return first
        known = first._joined
        if known is None or len(known[0]) != len(others) or not all(map(is_, known[0], others)):
            known = first._joined = others, Ids._in_one(parts)
        return known[1]

    @staticmethod
    def _in_one(parts: Sequence[Ids]) -> Ids:
        stem = parts[0]._stem
        if stem is not None and all(one._stem == stem for one in parts):
            whole = Ids(stem, np.concatenate([one._data for one in parts]))
        else:
            whole = Ids(None, np.concatenate([one.spelled for one in parts]))
        if any("hashes" in one.__dict__ for one in parts):
            whole.__dict__["hashes"] = np.concatenate([one.hashes for one in parts])
        return whole

    @staticmethod
    def in_common(columns: Sequence[Ids]) -> str | None:
        """An id that stands twice in some columns, or None."""
        twice = next((one.duplicate for one in columns if one.duplicate is not None), None)
        if twice is not None or len(columns) == 1:
            return twice
        if all(one._apart(other) for n, one in enumerate(columns) for other in columns[:n]):
            return None
        return Ids.concatenated(columns).duplicate

    def text_of(self, rows: slice) -> bytes:
        """The ids of some rows, each with a line feed behind it."""
        spelled = np.ascontiguousarray(self.take(rows).spelled)
        width = spelled.dtype.itemsize
        lines = np.empty((len(spelled), width + 1), np.uint8)
        lines[:, :width] = spelled.view(np.uint8).reshape(len(spelled), width)
        lines[:, width] = 10
        return lines[lines != 0].tobytes()

    @cached_property
    def hashes(self) -> NDArray[np.uint64]:
        """A polynomial hash of each id's bytes, modulo 2^64; that of `chance.hash_of`."""
        spelled = np.ascontiguousarray(self.spelled)
        width = spelled.dtype.itemsize
        letters = spelled.view(np.uint8).reshape(len(spelled), width)
        found = np.zeros(len(spelled), np.uint64)
        for place in range(width):
            letter = letters[:, place].astype(np.uint64)
            found = np.where(letter != 0, found * _FACTOR + letter, found)
        return found

    @cached_property
    def duplicate(self) -> str | None:
        """An id that stands twice in here, or None."""
        data = self._data
        if self._stem is not None and (data[1:] > data[:-1]).all():
            return None
        hashes = np.sort(data if self._stem is not None else self.hashes)
        if (hashes[1:] != hashes[:-1]).all():
            return None
        ordered = np.sort(data)
        twice = np.flatnonzero(ordered[1:] == ordered[:-1])
        return Ids(self._stem, ordered[twice[:1]])[0] if len(twice) else None

    @cached_property
    def strange(self) -> str | None:
        """One that is no id of an agent, or None."""
        if self._stem is not None:
            some = int(self._data.min()) if len(self) else 0
            whole = AGENT_ID.fullmatch(f"{self._stem}{some}") if some >= 0 else None
            return None if whole is not None else f"{self._stem}{some}"
        for row in range(0, len(self), 65536):
            text = self.text_of(slice(row, row + 65536))
            if _LINES.fullmatch(text) is None:
                return next(one for one in text.decode().split("\n") if not AGENT_ID.fullmatch(one))
        return None

    def rows_of(self, others: Ids) -> Rows:
        """The row of each of some ids in here, -1 where it is not; shape (len(others),)."""
        if self._stem is not None and self._stem == others._stem:
            return self._rows(others._data)
        if self._apart(others):
            return np.full(len(others), -1, np.intp)
        return self._search(others)

    def _apart(self, others: Ids) -> bool:
        """Whether two stems that differ cannot spell the same id, whatever the numbers are."""
        one, other = self._stem, others._stem
        if one is None or other is None or one == other:
            return False
        longer, shorter = (one, other) if len(one) > len(other) else (other, one)
        return not longer.startswith(shorter) or not longer[len(shorter) :].isdigit()

    def row_of(self, one: str) -> int:
        """The row of an id, or -1."""
        return int(self.rows_of(Ids.of([one]))[0])

    def _rows(self, numbers: Numbers) -> Rows:
        data = self._data
        if not len(data):
            return np.full(len(numbers), -1, np.intp)
        if self._consecutive:
            rows = numbers - data[0]
            rows[rows.view(np.uint64) >= len(data)] = -1
            return rows.astype(np.intp, copy=False)
        return _found(data, self._sorter, numbers)

    @cached_property
    def _consecutive(self) -> bool:
        data = self._data
        return int(data[-1]) - int(data[0]) == len(data) - 1 and bool((np.diff(data) == 1).all())

    @cached_property
    def _sorter(self) -> Rows:
        return np.argsort(self._data, kind="stable")

    def _search(self, others: Ids) -> Rows:
        spelled = self.spelled
        if not len(spelled):
            return np.full(len(others), -1, np.intp)
        return _found(spelled, self._speller, others.spelled)

    @cached_property
    def _speller(self) -> Rows:
        return np.argsort(self.spelled, kind="stable")


def _numbers(texts: Sequence[str]) -> tuple[str, Numbers] | None:
    """The one stem of all these ids and their numbers."""
    stem, numbers = None, list[int]()
    for one in texts:
        found = _NUMBERED.fullmatch(one)
        if found is None or (stem is not None and found[1] != stem):
            return None
        stem = found[1]
        numbers.append(int(found[2]))
    return None if stem is None else (stem, np.array(numbers, np.int64))


def _found(column: NDArray[Any], sorter: Rows, wanted: NDArray[Any]) -> Rows:
    places = np.searchsorted(column, wanted, sorter=sorter)
    rows = sorter[np.minimum(places, len(column) - 1)]
    return np.where(column[rows] == wanted, rows, -1)


def _width(texts: Sequence[str]) -> int:
    return max(map(len, texts), default=1)
