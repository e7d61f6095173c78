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
from typing import Any, Final, cast
from weakref import WeakValueDictionary, ref

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.id_pool import IdPool
from minerva_bus.grammar.joining import Joinable
from minerva_bus.grammar.places import Numbers, Places, Rows, found_in, hashes_of
from minerva_bus.grammar.row_delta import RowDelta
from minerva_bus.grammar.scene import AGENT_ID

LONGEST: Final = 64
_LINES = re.compile(rb"(?:[A-Za-z0-9_][A-Za-z0-9_:-]*+\n)*+")
# No leading zeros, which a number would lose; 18 digits always fit into an int64.
_NUMBERED = re.compile(r"(.*?)(0|[1-9][0-9]{0,17})", re.DOTALL)
_NUMBER = re.compile(r"0|[1-9][0-9]{0,17}")


class Ids(Joinable):
    """n ids in order. Immutable."""

    def __init__(self, stem: str | None, data: NDArray[Any], pool: IdPool | None = None) -> None:
        super().__init__()
        self._stem = stem
        self._pool = pool
        # The numbers after the stem, the spelled ids, or the entries in the pool.
        self._raw = data
        self._before: tuple[ref[Ids], RowDelta] | None = None
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
        return len(self._raw)

    def __getitem__(self, row: int) -> str:
        if self._stem is not None:
            return f"{self._stem}{self._raw[row]}"
        return self._item(row).decode()

    def _item(self, row: int) -> Any:
        """The number of a numbered id, or the bytes of another."""
        item = self._raw[row]
        return item if self._pool is None else self._pool.texts(item)

    def __iter__(self) -> Iterator[str]:
        return iter(self.texts())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Ids):
            return NotImplemented
        if self is other:
            return True
        if self._alike(other):
            return np.array_equal(self._raw, other._raw)
        return len(self) == len(other) and bool((self.spelled == other.spelled).all())

    def __hash__(self) -> int:
        return hash(self.text_of(slice(None)))

    def _alike(self, other: Ids) -> bool:
        """Whether ids are equal exactly if their numbers or entries are."""
        if self._pool is not None:
            return self._pool is other._pool
        return self._stem is not None and self._stem == other._stem

    @property
    def stem(self) -> str | None:
        """The common beginning of numbered ids; None for spelled ones."""
        return self._stem

    @property
    def data(self) -> NDArray[Any]:
        """The numbers after the stem (int64), or the ids as bytes."""
        return self._raw if self._stem is not None else self.spelled

    def texts(self) -> list[str]:
        """The ids as texts."""
        if self._stem is None:
            try:
                # numpy decodes ASCII for all rows at once; other bytes need Python's decoder.
                return self.spelled.astype("U").tolist()
            except UnicodeDecodeError:
                return [item.decode() for item in self.spelled.tolist()]
        return [f"{self._stem}{number}" for number in self._raw.tolist()]

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
        if self._pool is not None:
            return self._pool.texts(self._raw)
        if self._stem is None:
            return self._raw
        digits = self._raw.astype(f"S{len(str(int(self._raw.max())))}" if len(self) else "S1")
        return np.strings.add(self._stem.encode(), digits)

    def take(self, rows: NDArray[Any] | slice) -> Ids:
        """The ids of some rows."""
        taken = Ids(self._stem, self._raw[rows], self._pool)
        # Hashes that are known are taken along, because computing them spells every id.
        if "hashes" in self.__dict__ and self._pool is None:
            taken.__dict__["hashes"] = self.hashes[rows]
        return taken.sound_like((self,))

    def put(self, rows: Rows, others: Ids) -> Ids:
        """These ids with others in some rows."""
        entries = None if self._pool is None else self._pool_entries(self._pool, others)
        if self._pool is not None and entries is not None:
            data = self._raw.copy()
            data[rows] = entries
            return Ids(None, data, self._pool).sound_like((self, others))
        # With another stem, or none, the result can only be spelled.
        alike = self._stem is not None and self._stem == others._stem
        old, new = (self._raw, others._raw) if alike else (self.spelled, others.spelled)
        data = old.astype(np.promote_types(old.dtype, new.dtype))
        data[rows] = new
        made = Ids(self._stem if alike else None, data)
        if "hashes" in self.__dict__:
            hashes = self.hashes.copy()
            hashes[rows] = others.hashes
            made.__dict__["hashes"] = hashes
        return made.sound_like((self, others))

    @staticmethod
    def _pool_entries(pool: IdPool, ids: Ids) -> Rows | None:
        """The entries of ids in a pool, added if necessary; None if that is not possible."""
        return ids._raw if ids._pool is pool else pool.add(ids.spelled, ids.hashes)

    def sound_like(self, sources: Sequence[Ids]) -> Ids:
        """Mark these ids as valid if all ids that they are made of are known to be valid."""
        if all("strange" in source.__dict__ and source.strange is None for source in sources):
            self.__dict__["strange"] = None
        return self

    def updated(self, row_delta: RowDelta, born: Ids | None) -> Ids:
        """The ids after a row delta, with those of newborns in their rows."""
        made = self._updated(row_delta, born)
        # Kept for the delta of this frame, which would otherwise have to compare all ids.
        made._before = ref(self), row_delta
        return made.known()

    def _updated(self, row_delta: RowDelta, born: Ids | None) -> Ids:
        # Newborns with numbers after the same stem leave all ids numbered.
        if born is not None and (self._stem is None or self._stem != born._stem):
            pooled = self._updated_in_pool(row_delta, born)
            if pooled is not None:
                return pooled
        made = self.take(row_delta.source)
        # If no newborn has an old id, the result is distinct without another search.
        new = born is None or not (self.rows_of(born) >= 0).any()
        if born is not None:
            made = made.put(row_delta.born, born)
        if new and self.distinct and (born is None or born.distinct):
            made.__dict__["distinct"] = True
        return made

    def _updated_in_pool(self, row_delta: RowDelta, born: Ids) -> Ids | None:
        pool, old = self._pool, self._raw
        if pool is None or pool.crowded(len(self)):
            pool, old = IdPool.of(self.spelled, self.hashes), np.arange(len(self))
        if pool is None:
            return None
        known = pool.count
        newborn = self._pool_entries(pool, born)
        if newborn is None:
            return None
        entries = old[row_delta.source]
        entries[row_delta.born] = newborn
        made = Ids(None, entries, pool).sound_like((self, born))
        # Entries that are new to the pool cannot be those of other rows.
        if self.distinct and bool((newborn >= known).all()):
            made.__dict__["distinct"] = True
        return made

    def since(self, old: Ids) -> RowDelta | None:
        """The row delta from old ids to these; None if those that remain are in another order."""
        if self._before is not None and self._before[0]() is old:
            return self._before[1]
        # The old row of a repeated id is ambiguous.
        if old.duplicate is not None:
            return None
        row_delta = RowDelta.of(old.rows_of(self), len(old))
        self._before = None if row_delta is None else (ref(old), row_delta)
        return row_delta

    def differs(self, other: Ids) -> Rows | None:
        """The rows in which these differ from as many others; None if their stems differ."""
        if self._spells(other):
            return np.empty(0, np.intp)
        if self._stem != other._stem:
            return None
        if self._alike(other):
            return np.flatnonzero(self._raw != other._raw)
        return np.flatnonzero(self.data != other.data)

    def known(self) -> Ids:
        """Equal ids that exist already, with their cached properties; otherwise these."""
        # A cheap key; `_spells` compares everything.
        key = (self._stem, len(self), *((self._item(0), self._item(-1)) if len(self) else ()))
        other = _KNOWN.get(key)
        if other is not None and other._spells(self):
            return other
        _KNOWN[key] = self
        return self

    def _spells(self, other: Ids) -> bool:
        """Whether other ids are equal, and both numbered or both not."""
        if self is other:
            return True
        if self._stem != other._stem or len(self) != len(other):
            return False
        if self._alike(other):
            return np.array_equal(self._raw, other._raw)
        left, right = self.spelled, other.spelled
        if left.dtype == right.dtype:
            return left.tobytes() == right.tobytes()
        return bool((left == right).all())

    @classmethod
    def _in_one(cls, parts: Sequence[Ids]) -> Ids:
        first = parts[0]
        if all(map(first._alike, parts)):
            data = np.concatenate([part._raw for part in parts])
            whole = Ids(first._stem, data, first._pool)
        else:
            whole = Ids(None, np.concatenate([part.spelled for part in parts]))
        if whole._pool is None and any("hashes" in part.__dict__ for part in parts):
            whole.__dict__["hashes"] = np.concatenate([part.hashes for part in parts])
        return whole.sound_like(parts)

    @staticmethod
    def in_common(columns: Sequence[Ids]) -> str | None:
        """An id that occurs twice in these columns, or None."""
        twice = next((column.duplicate for column in columns if column.duplicate is not None), None)
        if twice is not None or len(columns) == 1:
            return twice
        if all(column._apart(other) for n, column in enumerate(columns) for other in columns[:n]):
            return None
        return Ids.concatenated(columns).duplicate

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
        if self._pool is not None:
            return self._pool.hashes(self._raw)
        return hashes_of(self.spelled)

    @cached_property
    def distinct(self) -> bool:
        """Whether a quick test proves that no id occurs twice."""
        if self._stem is not None:
            return bool((self._raw[1:] > self._raw[:-1]).all())
        if self._pool is not None:
            entries = np.sort(self._raw)
            return bool((entries[1:] != entries[:-1]).all())
        # Equal hashes leave the question open: `duplicate` then compares the ids.
        hashes = np.sort(self.hashes)
        return bool((hashes[1:] != hashes[:-1]).all())

    @cached_property
    def duplicate(self) -> str | None:
        """An id that occurs twice, or None."""
        if self.distinct:
            return None
        ordered = np.sort(self._raw)
        twice = np.flatnonzero(ordered[1:] == ordered[:-1])
        return Ids(self._stem, ordered[twice[:1]], self._pool)[0] if len(twice) else None

    @cached_property
    def strange(self) -> str | None:
        """An id that is not a valid agent id, or None."""
        if self._stem is not None:
            # One number represents all of them: only a negative one adds another character.
            smallest = int(self._raw.min()) if len(self) else 0
            whole = AGENT_ID.fullmatch(f"{self._stem}{smallest}") if smallest >= 0 else None
            return None if whole is not None else f"{self._stem}{smallest}"
        # In parts, because the text of a million ids would take as much memory again.
        for row in range(0, len(self), 65536):
            text = self.text_of(slice(row, row + 65536))
            if _LINES.fullmatch(text) is None:
                shown = text.decode(errors="backslashreplace").split("\n")
                return next(line for line in shown if not AGENT_ID.fullmatch(line))
        return None

    def rows_of(self, others: Ids) -> Rows:
        """The row of each of the other ids, -1 if it is not here; shape (len(others),)."""
        # The usual case in a frame without births and deaths.
        if self._spells(others) and self.duplicate is None:
            return np.arange(len(self))
        if self._pool is not None:
            return self._pooled_rows(self._pool, others)
        if self._alike(others):
            return self._rows(others._raw)
        if self._apart(others):
            return np.full(len(others), -1, np.intp)
        if self._stem is not None and others._stem is None:
            return self._numbered_among(others)
        return self._search(others)

    def _apart(self, others: Ids) -> bool:
        """Whether two different stems cannot give the same id with any numbers."""
        stem, other_stem = self._stem, others._stem
        if stem is None or other_stem is None or stem == other_stem:
            return False
        longer, shorter = (stem, other_stem) if len(stem) > len(other_stem) else (other_stem, stem)
        # `fox` and `fox1` can both give fox12; `fox` and `hen` cannot give the same id.
        return not longer.startswith(shorter) or not longer[len(shorter) :].isdigit()

    def row_of(self, agent_id: str) -> int:
        """The row of an id, or -1."""
        return int(self.rows_of(Ids.of([agent_id]))[0])

    @property
    def consecutive(self) -> bool:
        """Whether these are a stem with consecutive numbers."""
        return self._stem is not None and len(self) > 0 and self._numbers.consecutive

    @cached_property
    def _numbers(self) -> Numbers:
        return Numbers(self._raw)

    def _rows(self, numbers: NDArray[np.int64]) -> Rows:
        return self._numbers.rows_of(numbers) if len(self) else np.full(len(numbers), -1, np.intp)

    def _pooled_rows(self, pool: IdPool, others: Ids) -> Rows:
        if not len(self):
            return np.full(len(others), -1, np.intp)
        known = others._pool is pool
        entries = others._raw if known else pool.find(others.spelled, others.hashes)
        # The usual case of newborns: no table of all rows is needed.
        if (entries < 0).all():
            return entries
        rows = self._row_of_entry
        # The last one is -1, for entries that are newer than this table.
        return rows[np.minimum(entries, len(rows) - 1)]

    @cached_property
    def _row_of_entry(self) -> Rows:
        """The row of each entry of the pool, -1 for others; one more stands at the end."""
        rows = np.full(int(self._raw.max()) + 2, -1, np.intp)
        rows[self._raw[::-1]] = np.arange(len(self))[::-1]  # The first of several remains.
        return rows

    def _numbered_among(self, others: Ids) -> Rows:
        """The rows of spelled ids; only those with this stem and a number are searched."""
        rows = np.full(len(others), -1, np.intp)
        stem = cast("str", self._stem)
        alike = np.flatnonzero(np.strings.startswith(others.spelled, stem.encode()))
        texts = others.take(alike).texts()
        matching = [n for n, text in enumerate(texts) if _NUMBER.fullmatch(text, len(stem))]
        if matching:
            numbers = [int(texts[n][len(stem) :]) for n in matching]
            rows[alike[matching]] = self._rows(np.array(numbers, np.int64))
        return rows

    def _search(self, others: Ids) -> Rows:
        if not len(self):
            return np.full(len(others), -1, np.intp)
        rows = self._places.rows_of(others.hashes)
        own, theirs = self.spelled, others.spelled
        there = rows >= 0
        # Equal hashes do not prove equal ids.
        if (own[rows[there]] == theirs[there]).all():
            return rows
        return found_in(own, np.argsort(own, kind="stable"), theirs)  # Two ids share a hash.

    @cached_property
    def _places(self) -> Places:
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
