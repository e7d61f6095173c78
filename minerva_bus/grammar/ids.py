"""The ids of many agents as one column.

    Numbered   a stem and a number: fox0, fox1, ...      one int64 per id
    Spelled    any others of at most 64 characters       a numpy array of bytes
    Pooled     those of a population with births         an entry of an `IdPool` per id

The representation does not matter: equal ids compare, digest and hash alike.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, Final
from weakref import WeakValueDictionary, ref

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.id_pool import IdPool
from minerva_bus.grammar.id_search import rows_in
from minerva_bus.grammar.joining import Joinable
from minerva_bus.grammar.places import Numbers, Places, Rows, hashes_of
from minerva_bus.grammar.row_delta import RowDelta
from minerva_bus.grammar.scene import AGENT_ID

LONGEST: Final = 64
"""Characters of an id in columns; agents with longer ones are nodes."""

_DIGITS: Final = 19
"""Digits of the largest number of an id."""

_LINES = re.compile(rb"(?:[A-Za-z0-9_][A-Za-z0-9_:-]*+\n)*+")
# No leading zeros, which a number would lose; 18 digits always fit into an int64.
_NUMBERED = re.compile(r"(.*?)(0|[1-9][0-9]{0,17})", re.DOTALL)


class Ids(Joinable):
    """n ids in order. Immutable."""

    def __init__(self, stem: str | None, data: NDArray[Any], pool: IdPool | None = None) -> None:
        super().__init__()
        self.stem = stem
        """The common beginning of numbered ids; None for others."""
        self.pool = pool
        """The table of pooled ids; None for others."""
        self.raw = data
        """The numbers after the stem, the entries in the pool, or the spelled ids."""
        self.before: tuple[ref[Ids], RowDelta] | None = None
        """The ids of which `id_changes` has made these, and how."""
        self.chunks = b""
        data.flags.writeable = False

    @staticmethod
    def numbered(stem: str, numbers: NDArray[np.integer[Any]] | range) -> Ids:
        """The stem followed by each of these integers, which are at least 0."""
        return Ids(stem, np.array(numbers, np.int64))

    @staticmethod
    def of(texts: Sequence[str]) -> Ids:
        """The ids with these texts."""
        numbers = _numbered(texts)
        if numbers is not None:
            return Ids(*numbers)
        width = _width(texts)
        try:
            return Ids(None, np.array(texts, f"S{width}"))
        except UnicodeEncodeError:  # Not valid ids; `strange` reports them.
            return Ids(None, np.array([text.encode() for text in texts], f"S{4 * width}"))

    def __len__(self) -> int:
        return len(self.raw)

    def __getitem__(self, row: int) -> str:
        if self.stem is not None:
            return f"{self.stem}{self.raw[row]}"
        return self._item(row).decode()

    def _item(self, row: int) -> Any:
        """The number of a numbered id, or the bytes of another."""
        item = self.raw[row]
        return item if self.pool is None else self.pool.texts(item)

    def __iter__(self) -> Iterator[str]:
        return iter(self.texts())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Ids):
            return NotImplemented
        if self is other:
            return True
        if self.alike(other):
            return np.array_equal(self.raw, other.raw)
        return len(self) == len(other) and bool((self.spelled == other.spelled).all())

    def __hash__(self) -> int:
        return hash(self.text_of(slice(None)))

    def alike(self, other: Ids) -> bool:
        """Whether ids are equal exactly if their numbers or entries are."""
        if self.pool is not None:
            return self.pool is other.pool
        return self.stem is not None and self.stem == other.stem

    @property
    def data(self) -> NDArray[Any]:
        """The numbers after the stem (int64), or the ids as bytes."""
        return self.raw if self.stem is not None else self.spelled

    def texts(self) -> list[str]:
        """The ids as texts."""
        if self.stem is None:
            try:
                # numpy decodes ASCII for all rows at once; other bytes need Python's decoder.
                return self.spelled.astype("U").tolist()
            except UnicodeDecodeError:
                return [item.decode() for item in self.spelled.tolist()]
        return [f"{self.stem}{number}" for number in self.raw.tolist()]

    @cached_property
    def column(self) -> NDArray[Any]:
        """The ids as texts in an array, shape (n,); created once."""
        made = np.empty(len(self), object)
        made[:] = self.texts()
        made.flags.writeable = False
        return made

    @cached_property
    def spelled(self) -> NDArray[np.bytes_]:
        """The ids as bytes, shape (n,)."""
        if self.pool is not None:
            return self.pool.texts(self.raw)
        if self.stem is None:
            return self.raw
        digits = self.raw.astype(f"S{len(str(int(self.raw.max())))}" if len(self) else "S1")
        return np.strings.add(self.stem.encode(), digits)

    def take(self, rows: NDArray[Any] | slice) -> Ids:
        """The ids of some rows."""
        taken = Ids(self.stem, self.raw[rows], self.pool)
        # Hashes that are known are taken along, because computing them spells every id.
        if "hashes" in self.__dict__ and self.pool is None:
            taken.__dict__["hashes"] = self.hashes[rows]
        return taken.sound_like((self,))

    def put(self, rows: Rows, others: Ids) -> Ids:
        """These ids with others in some rows."""
        entries = None if self.pool is None else others.entries_in(self.pool)
        if self.pool is not None and entries is not None:
            data = self.raw.copy()
            data[rows] = entries
            return Ids(None, data, self.pool).sound_like((self, others))
        # With another stem, or none, the result can only be spelled.
        alike = self.stem is not None and self.stem == others.stem
        old, new = (self.raw, others.raw) if alike else (self.spelled, others.spelled)
        data = old.astype(np.promote_types(old.dtype, new.dtype))
        data[rows] = new
        made = Ids(self.stem if alike else None, data)
        if "hashes" in self.__dict__:
            hashes = self.hashes.copy()
            hashes[rows] = others.hashes
            made.__dict__["hashes"] = hashes
        return made.sound_like((self, others))

    def entries_in(self, pool: IdPool) -> Rows | None:
        """The entries of these ids in a pool, added if necessary; None if that is impossible."""
        return self.raw if self.pool is pool else pool.add(self.spelled, self.hashes)

    def sound_like(self, sources: Sequence[Ids]) -> Ids:
        """Mark these ids as valid if all ids that they are made of are known to be valid."""
        if all("strange" in source.__dict__ and source.strange is None for source in sources):
            self.__dict__["strange"] = None
        return self

    def differs(self, other: Ids) -> Rows | None:
        """The rows in which these differ from as many others; None if their stems differ."""
        if self.spells(other):
            return np.empty(0, np.intp)
        if self.stem != other.stem:
            return None
        if self.alike(other):
            return np.flatnonzero(self.raw != other.raw)
        return np.flatnonzero(self.data != other.data)

    def known(self) -> Ids:
        """Equal ids that exist already, with their cached properties; otherwise these."""
        # A cheap key; `spells` compares everything.
        key = (self.stem, len(self), *((self._item(0), self._item(-1)) if len(self) else ()))
        other = _KNOWN.get(key)
        if other is not None and other.spells(self):
            return other
        _KNOWN[key] = self
        return self

    def spells(self, other: Ids) -> bool:
        """Whether other ids are equal, and both numbered or both not."""
        if self is other:
            return True
        if self.stem != other.stem or len(self) != len(other):
            return False
        if self.alike(other):
            return np.array_equal(self.raw, other.raw)
        left, right = self.spelled, other.spelled
        if left.dtype == right.dtype:
            return left.tobytes() == right.tobytes()
        return bool((left == right).all())

    @classmethod
    def _in_one(cls, parts: Sequence[Ids]) -> Ids:
        first = parts[0]
        if all(map(first.alike, parts)):
            data = np.concatenate([part.raw for part in parts])
            whole = Ids(first.stem, data, first.pool)
        else:
            whole = Ids(None, np.concatenate([part.spelled for part in parts]))
        if whole.pool is None and any("hashes" in part.__dict__ for part in parts):
            whole.__dict__["hashes"] = np.concatenate([part.hashes for part in parts])
        return whole.sound_like(parts)

    def text_of(self, rows: slice) -> bytes:
        """The ids of some rows, each followed by a line feed."""
        spelled = np.ascontiguousarray(self.take(rows).spelled)
        width = spelled.dtype.itemsize
        lines = np.empty((len(spelled), width + 1), np.uint8)
        lines[:, :width] = spelled.view(np.uint8).reshape(len(spelled), width)
        lines[:, width] = 10
        # Zero bytes are padding; ids contain none.
        return lines[lines != 0].tobytes()

    @cached_property
    def hashes(self) -> NDArray[np.uint64]:
        """A polynomial hash of each id's bytes, modulo 2^64, equal to `world.rng.hash_of`."""
        if self.pool is not None:
            return self.pool.hashes(self.raw)
        return hashes_of(self.spelled)

    @cached_property
    def distinct(self) -> bool:
        """Whether a quick test proves that no id occurs twice."""
        if self.stem is not None:
            return bool((self.raw[1:] > self.raw[:-1]).all())
        if self.pool is not None:
            entries = np.sort(self.raw)
            return bool((entries[1:] != entries[:-1]).all())
        # Equal hashes leave the question open: `duplicate` then compares the ids.
        hashes = np.sort(self.hashes)
        return bool((hashes[1:] != hashes[:-1]).all())

    @cached_property
    def duplicate(self) -> str | None:
        """An id that occurs twice, or None."""
        if self.distinct:
            return None
        ordered = np.sort(self.raw)
        twice = np.flatnonzero(ordered[1:] == ordered[:-1])
        return Ids(self.stem, ordered[twice[:1]], self.pool)[0] if len(twice) else None

    @cached_property
    def strange(self) -> str | None:
        """An id that is not a valid agent id, or None."""
        if self.stem is not None:
            # One number represents all of them: only a negative one adds another character.
            smallest = int(self.raw.min()) if len(self) else 0
            whole = AGENT_ID.fullmatch(f"{self.stem}{smallest}") if smallest >= 0 else None
            return None if whole is not None else f"{self.stem}{smallest}"
        # In parts, because the text of a million ids would take as much memory again.
        for row in range(0, len(self), 65536):
            text = self.text_of(slice(row, row + 65536))
            if _LINES.fullmatch(text) is None:
                shown = text.decode(errors="backslashreplace").split("\n")
                return next(line for line in shown if not AGENT_ID.fullmatch(line))
        return None

    @property
    def too_long(self) -> bool:
        """Whether an id is longer than those in columns may be."""
        stem = self.stem
        if stem is None:
            return self.raw.dtype.itemsize > LONGEST and self.pool is None
        # The numbers are read only if they can decide it.
        near = len(stem) + _DIGITS > LONGEST and len(self) > 0
        return near and len(stem) + len(str(int(self.raw.max()))) > LONGEST

    def rows_of(self, others: Ids) -> Rows:
        """The row of each of the other ids, -1 if it is not here; shape (len(others),)."""
        return rows_in(self, others)

    def row_of(self, agent_id: str) -> int:
        """The row of an id, or -1."""
        return int(self.rows_of(Ids.of([agent_id]))[0])

    @property
    def consecutive(self) -> bool:
        """Whether these are a stem with consecutive numbers."""
        return self.stem is not None and len(self) > 0 and self.numbers.consecutive

    @cached_property
    def numbers(self) -> Numbers:
        """A table to search in numbered ids, of which there are some."""
        return Numbers(self.raw)

    @cached_property
    def row_of_entry(self) -> Rows:
        """The row of each entry of the pool, -1 for others; one more stands at the end."""
        rows = np.full(int(self.raw.max()) + 2, -1, np.intp)
        rows[self.raw[::-1]] = np.arange(len(self))[::-1]  # The first of several remains.
        return rows

    @cached_property
    def places(self) -> Places:
        """A table to search by hashes."""
        return Places(self.hashes)


# Weak values: ids that are no longer used are released.
_KNOWN: Final[WeakValueDictionary[tuple[Any, ...], Ids]] = WeakValueDictionary()


def _numbered(texts: Sequence[str]) -> tuple[str, NDArray[np.int64]] | None:
    """The common stem of these ids, and their numbers; None if there is none."""
    stem, numbers = None, list[int]()
    for text in texts:
        match = _NUMBERED.fullmatch(text)
        if match is None or (stem is not None and match[1] != stem):
            return None
        stem = match[1]
        numbers.append(int(match[2]))
    return None if stem is None else (stem, np.array(numbers, np.int64))


def _width(texts: Sequence[str]) -> int:
    return max(map(len, texts), default=1)
