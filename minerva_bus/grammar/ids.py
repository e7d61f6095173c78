"""The ids of many agents as one column: forms, search, changes, and the check that they differ.

    Numbered   a stem and a number: fox0, fox1, ...      one int64 per id
    Spelled    any others of at most 64 characters       a numpy array of bytes
    Pooled     those of a population with births         an entry of an `IdPool` per id

The representation does not matter: equal ids compare, digest and hash alike.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from operator import is_
from typing import Any, Final, Self, TypeAlias
from weakref import WeakValueDictionary, ref

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.scene import AGENT_ID, Scene, agents
from minerva_bus.grammar.types import Unfit

Rows: TypeAlias = NDArray[np.intp]
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


class Joinable:
    """Base of columns. The first of several parts caches the result of joining them."""

    __slots__ = ("_joined",)

    def __init__(self) -> None:
        self._joined: tuple[tuple[Any, ...], Any] | None = None

    @classmethod
    def concatenated(cls, parts: Sequence[Self]) -> Self:
        """Several columns as one."""
        first, others = parts[0], tuple(parts[1:])
        if not others:
            return first
        # The slices of a population are joined in every frame. If none has changed, the result is
        # the same object, with its digests.
        known = first._joined
        if known is None or len(known[0]) != len(others) or not all(map(is_, known[0], others)):
            known = first._joined = others, cls._in_one(parts)
        return known[1]

    @classmethod
    def _in_one(cls, parts: Sequence[Any]) -> Self:
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class RowDelta:
    """Rows removed from columns of `count` rows, and rows added; the others keep their order.

    `gone` are ascending row numbers before the change, `born` ascending row numbers after it.
    """

    count: int
    gone: Rows
    born: Rows

    @property
    def after(self) -> int:
        """Number of rows after the change."""
        return self.count - len(self.gone) + len(self.born)

    @cached_property
    def source(self) -> Rows:
        """The old row of each new one, shape (after,); 0 for added rows, which have none."""
        stays = np.ones(self.count, np.bool_)
        stays[self.gone] = False
        old = np.ones(self.after, np.bool_)
        old[self.born] = False
        rows = np.zeros(self.after, np.intp)
        # The remaining rows keep their order, so both sides have them in the same one.
        rows[old] = np.flatnonzero(stays)
        return rows

    @staticmethod
    def of(was: Rows, count: int) -> RowDelta | None:
        """From the old row of each new one, -1 for added rows.

        None if the remaining rows are in another order, or if no old row remains.
        """
        stays = was[was >= 0]
        if not len(stays) or (stays[1:] <= stays[:-1]).any():
            return None
        gone = np.ones(count, np.bool_)
        gone[stays] = False
        return RowDelta(count, np.flatnonzero(gone), np.flatnonzero(was < 0))


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
        width = max(map(len, texts), default=1)
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
        # The usual case in a frame without births and deaths.
        if self.spells(others) and self.duplicate is None:
            return np.arange(len(self))
        if self.pool is not None:
            return _rows_of_entries(self, others)
        if self.alike(others):
            return _rows_of_numbers(self, others.raw)
        if apart(self, others):
            return np.full(len(others), -1, np.intp)
        if self.stem is not None and others.stem is None:
            return _numbered_among(self, self.stem, others)
        return _rows_of_texts(self, others)

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


Texts = NDArray[np.bytes_]
Entries = NDArray[np.intp]

SPARE: Final = 256
"""A table may have this many entries of dead agents beyond the number of living ones."""


class IdPool:
    """Ids with different hashes, each once; ids are added and never removed.

    Different hashes show that ids differ. So equal entries mean equal ids, and vice versa.
    """

    def __init__(self, texts: Texts, hashes: Hashes) -> None:
        self._texts = texts
        self._hashes = hashes
        self._places = Places(hashes)
        self.count = len(texts)

    @staticmethod
    def of(texts: Texts, hashes: Hashes) -> IdPool | None:
        """A table of these ids, n > 0; None if two of them have the same hash."""
        ordered = np.sort(hashes)
        return None if (ordered[1:] == ordered[:-1]).any() else IdPool(texts, hashes)

    def texts(self, entries: Any) -> Any:
        """The ids of some entries, or of one."""
        return self._texts[entries]

    def hashes(self, entries: Entries) -> Hashes:
        """The hashes of some entries."""
        return self._hashes[entries]

    def crowded(self, agents: int) -> bool:
        """Whether too many entries belong to no agent; a new table then takes less memory."""
        return self.count > 2 * agents + SPARE

    def find(self, texts: Texts, hashes: Hashes) -> Rows:
        """The entry of each id, -1 if it is not here; shape (n,)."""
        entries = self._places.rows_of(hashes)
        here = np.flatnonzero(entries >= 0)
        # Equal hashes do not prove equal ids. No other entry has this hash.
        other = self._texts[entries[here]] != texts[here]
        entries[here[other]] = -1
        return entries

    def add(self, texts: Texts, hashes: Hashes) -> Rows | None:
        """The entry of each id, added if necessary; None if that would repeat an id or a hash."""
        if not len(texts):
            return np.empty(0, np.intp)
        entries = self._places.rows_of(hashes)
        here = entries >= 0
        if here.any() and (self._texts[entries[here]] != texts[here]).any():
            return None
        ordered = np.sort(hashes)
        if (ordered[1:] == ordered[:-1]).any():
            return None
        new = np.flatnonzero(~here)
        if len(new):
            entries[new] = np.arange(self.count, self.count + len(new))
            self._append(texts[new], hashes[new])
        return entries

    def _append(self, texts: Texts, hashes: Hashes) -> None:
        begin, self.count = self.count, self.count + len(texts)
        # Earlier views of both arrays stay valid, because what they show never changes.
        self._texts = _with(self._texts, begin, texts)
        self._hashes = _with(self._hashes, begin, hashes)
        self._places.extend(self._hashes[: self.count], begin)


def _with(array: NDArray[Any], count: int, more: NDArray[Any]) -> NDArray[Any]:
    """An array with other values after its first `count`; spare room for later ones is left."""
    dtype = np.promote_types(array.dtype, more.dtype)
    end = count + len(more)
    if end > len(array) or dtype != array.dtype:
        larger = np.empty(max(end + end // 4, len(array)), dtype)
        larger[:count] = array[:count]
        array = larger
    array[count:end] = more
    return array


_NUMBER: Final = re.compile(r"0|[1-9][0-9]{0,17}")


def apart(ids: Ids, others: Ids) -> bool:
    """Whether two different stems cannot give the same id with any numbers."""
    if ids.stem is None or others.stem is None or ids.stem == others.stem:
        return False
    shorter, longer = sorted((ids.stem, others.stem), key=len)
    # `fox` and `fox1` can both give fox12; `fox` and `hen` cannot give the same id.
    return not longer.startswith(shorter) or not longer[len(shorter) :].isdigit()


def _rows_of_numbers(ids: Ids, numbers: NDArray[np.int64]) -> Rows:
    return ids.numbers.rows_of(numbers) if len(ids) else np.full(len(numbers), -1, np.intp)


def _rows_of_entries(ids: Ids, others: Ids) -> Rows:
    pool = ids.pool
    if pool is None or not len(ids):
        return np.full(len(others), -1, np.intp)
    entries = others.raw if others.pool is pool else pool.find(others.spelled, others.hashes)
    # The usual case of newborns: no table of all rows is needed.
    if (entries < 0).all():
        return entries
    rows = ids.row_of_entry
    # The last one is -1, for entries that are newer than this table.
    return rows[np.minimum(entries, len(rows) - 1)]


def _numbered_among(ids: Ids, stem: str, others: Ids) -> Rows:
    """The rows of spelled ids; only those with this stem and a number are searched."""
    rows = np.full(len(others), -1, np.intp)
    same_stem: NDArray[Any] = np.flatnonzero(np.strings.startswith(others.spelled, stem.encode()))
    texts = others.take(same_stem).texts()
    matching = [n for n, text in enumerate(texts) if _NUMBER.fullmatch(text, len(stem))]
    if matching:
        numbers = [int(texts[n][len(stem) :]) for n in matching]
        rows[same_stem[matching]] = _rows_of_numbers(ids, np.array(numbers, np.int64))
    return rows


def _rows_of_texts(ids: Ids, others: Ids) -> Rows:
    if not len(ids):
        return np.full(len(others), -1, np.intp)
    rows = ids.places.rows_of(others.hashes)
    own, theirs = ids.spelled, others.spelled
    there = rows >= 0
    # Equal hashes do not prove equal ids.
    if (own[rows[there]] == theirs[there]).all():
        return rows
    return found_in(own, np.argsort(own, kind="stable"), theirs)  # Two ids share a hash.


def updated_ids(old: Ids, row_delta: RowDelta, born: Ids | None) -> Ids:
    """The ids after a row delta, with those of newborns in their rows."""
    made = None
    # Newborns with numbers after the same stem leave all ids numbered.
    if born is not None and (old.stem is None or old.stem != born.stem):
        made = _updated_in_pool(old, row_delta, born)
    if made is None:
        made = _updated(old, row_delta, born)
    # Kept for the delta of this frame, which would otherwise have to compare all ids.
    made.before = ref(old), row_delta
    return made.known()


def row_delta_of_ids(old: Ids, new: Ids) -> RowDelta | None:
    """The row delta from old ids to new ones; None if those that remain are in another order."""
    if new.before is not None and new.before[0]() is old:
        return new.before[1]
    # The old row of a repeated id is ambiguous.
    if old.duplicate is not None:
        return None
    row_delta = RowDelta.of(old.rows_of(new), len(old))
    new.before = None if row_delta is None else (ref(old), row_delta)
    return row_delta


def _updated(old: Ids, row_delta: RowDelta, born: Ids | None) -> Ids:
    made = old.take(row_delta.source)
    # If no newborn has an old id, the result is distinct without another search.
    new = born is None or not (old.rows_of(born) >= 0).any()
    if born is not None:
        made = made.put(row_delta.born, born)
    if new and old.distinct and (born is None or born.distinct):
        made.__dict__["distinct"] = True
    return made


def _updated_in_pool(old: Ids, row_delta: RowDelta, born: Ids) -> Ids | None:
    """The ids as entries of the pool, or of a new one; None if their hashes do not differ."""
    pool, entries = old.pool, old.raw
    if pool is None or pool.crowded(len(old)):
        pool, entries = IdPool.of(old.spelled, old.hashes), np.arange(len(old))
    if pool is None:
        return None
    known = pool.count
    newborn = born.entries_in(pool)
    if newborn is None:
        return None
    entries = entries[row_delta.source]
    entries[row_delta.born] = newborn
    made = Ids(None, entries, pool).sound_like((old, born))
    # Entries that are new to the pool cannot be those of other rows.
    if old.distinct and bool((newborn >= known).all()):
        made.__dict__["distinct"] = True
    return made


def same_id(agent_id: str) -> str:
    """The message for two agents with the same id."""
    return f"two agents have the id #{agent_id}"


MAX_SHOWN: Final = 64
"""Characters of an invalid id in its message."""


def no_id(text: str) -> str:
    """The message for a text that is not a valid id."""
    shown = text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}…"
    return f"{shown!r} is not a valid agent id; expected letters, digits, _, : and -, at most 1024"


def invalid_id(texts: Iterable[str]) -> str | None:
    """The first text that is not a valid id; None if all are."""
    return next((text for text in texts if AGENT_ID.fullmatch(text) is None), None)


def repeated_id(columns: Sequence[Ids], single: Collection[str] = ()) -> str | None:
    """An id that occurs twice in columns, or in columns and among single ids; otherwise None."""
    # Single agents have no columns to compare with, so their ids are collected here.
    every = [*columns, *([Ids.of(sorted(single))] if columns and single else [])]
    repeated = next((ids.duplicate for ids in every if ids.duplicate is not None), None)
    if repeated is not None or len(every) < 2:
        return repeated
    if all(apart(ids, other) for n, ids in enumerate(every) for other in every[:n]):
        return None
    return Ids.concatenated(every).duplicate


def repeated_in(scene: Scene) -> str | None:
    """An id that occurs twice in a string; None if all are different."""
    single = set[str]()
    for piece in scene.pieces:
        for agent in agents(Scene((piece,))) if piece.ids is None else ():
            if agent.id in single:
                return agent.id
            single.add(agent.id)
    return repeated_id([piece.ids for piece in scene.pieces if piece.ids is not None], single)


class UniqueIds:
    """The ids of a string, added one by one or as columns. Raises Unfit for a repeated one."""

    def __init__(self) -> None:
        self._single: set[str] = set()
        self._columns: list[Ids] = []

    def add(self, agent_id: str) -> None:
        """Add the id of one agent. Raises Unfit."""
        if AGENT_ID.fullmatch(agent_id) is None:
            raise Unfit(no_id(agent_id))
        # Columns stay columns: an id is searched in them without creating a text for each agent.
        for ids in self._columns:
            if ids.row_of(agent_id) >= 0:
                raise Unfit(same_id(agent_id))
        if agent_id in self._single:
            raise Unfit(same_id(agent_id))
        self._single.add(agent_id)

    def add_all(self, ids: Ids) -> None:
        """Add the ids of agents in columns. Raises Unfit."""
        if (strange := ids.strange) is not None:
            raise Unfit(no_id(strange))
        if (repeated := repeated_id([ids, *self._columns], self._single)) is not None:
            raise Unfit(same_id(repeated))
        self._columns.append(ids)
