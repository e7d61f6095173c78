"""Columns, ids and patches as msgpack.

column  = extension 3: a byte for the type, then the values, little endian
              d float64    b h i q whole numbers of 1, 2, 4, 8 bytes    ? truths of 1 byte
        | [text, ...]
ids     = [stem, column of whole numbers] | [nil, width, bytes]
columns = [count, ids or nil, [[symbol, [column, ...]], ...]]     one pair for each level
events  = [type, count, [column, ...], condition, senders, receivers]    ids or nil
patch   = ["patch", count, [symbol, ...], [[level, place, rows, column], ...]]
                                          rows: a column of whole numbers, or nil for all
"""

from __future__ import annotations

from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import ProtocolError, VocabularyError
from minerva_bus.grammar.arrays import fits
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.columns import CHAIN, Column, Columns
from minerva_bus.grammar.condition import parse_condition
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.ids import LONGEST, Ids
from minerva_bus.grammar.patch import Change, Patch
from minerva_bus.grammar.symbols import Fields
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.protocol.limits import Limits
from minerva_bus.protocol.plain import listed, text, whole

COLUMN: Final = 3
PATCH: Final = "patch"
_DTYPES: Final = {"d": "<f8", "b": "<i1", "h": "<i2", "i": "<i4", "q": "<i8", "?": "?"}


def plain_column(column: Column) -> Any:
    """A column; whole numbers in as few bytes as hold them all."""
    array = column.array
    if array.dtype == object:
        return array.tolist()
    letter = {"f": "d", "b": "?"}.get(array.dtype.kind) or _narrowest(array)
    data = array.astype(_DTYPES[letter], copy=False)
    return msgpack.ExtType(COLUMN, letter.encode() + data.tobytes())


def _narrowest(array: NDArray[Any]) -> str:
    if not len(array):
        return "b"
    least, most = int(array.min()), int(array.max())
    for letter, half in (("b", 1 << 7), ("h", 1 << 15), ("i", 1 << 31)):
        if -half <= least and most < half:
            return letter
    return "q"


def plain_ids(ids: Ids | None) -> Any:
    """Ids of agents."""
    if ids is None:
        return None
    if ids.stem is not None:
        return [ids.stem, plain_column(Column(ids.data))]
    return [None, ids.data.dtype.itemsize, ids.data.tobytes()]


def plain_columns(many: Columns) -> list[Any]:
    """Many nodes of one shape."""
    levels = [[one.symbol, [plain_column(c) for c in one.columns]] for one in many.levels()]
    return [many.count, plain_ids(many.ids), levels]


def plain_events(events: Events) -> list[Any]:
    """Many events."""
    return [
        events.type,
        events.count,
        [plain_column(column) for column in events.columns],
        events.condition,
        plain_ids(events.senders),
        plain_ids(events.receivers),
    ]


def plain_patch(patch: Patch) -> list[Any]:
    """A patch."""
    changes = [
        [
            one.level,
            one.place,
            None if one.rows is None else plain_column(Column(one.rows.astype(np.int64))),
            plain_column(one.column),
        ]
        for one in patch.changes
    ]
    return [PATCH, patch.count, list(patch.symbols), changes]


def is_patch(plain: Any) -> bool:
    """Whether this stands for a patch, not for a string."""
    return isinstance(plain, list) and plain[:1] == [PATCH]


class ColumnsReader:
    """Reads columns by a vocabulary. Raises ProtocolError and VocabularyError."""

    def __init__(self, vocabulary: Vocabulary, limits: Limits) -> None:
        self._vocabulary = vocabulary
        self._limits = limits

    def column(self, plain: Any, count: int) -> Column:
        """A column of so many values."""
        if isinstance(plain, list):
            texts = [text(one, "a text in a column") for one in listed(plain, "a column")]
            array: NDArray[Any] = np.empty(len(texts), object)
            array[:] = texts
        else:
            array = _array(plain)
        if len(array) != count:
            raise ProtocolError(f"a column has {len(array)} values; expected {count}")
        return Column(array)

    def ids(self, plain: Any, count: int) -> Ids:
        """So many ids."""
        items = listed(plain, "ids")
        if len(items) == 2:
            numbers = self.column(items[1], count).array
            if numbers.dtype != np.int64 or (count and int(numbers.min()) < 0):
                raise ProtocolError("the numbers of ids are whole numbers from 0")
            ids = Ids(text(items[0], "the stem of ids"), numbers)
        elif len(items) == 3 and items[0] is None and isinstance(items[2], bytes):
            width = whole(items[1], "the width of ids", 1)
            if width > LONGEST or len(items[2]) != width * count:
                raise ProtocolError(f"{count} ids of {width} bytes have {len(items[2])} bytes")
            ids = Ids(None, np.frombuffer(items[2], f"S{width}"))
        else:
            raise ProtocolError("ids are [stem, numbers] or [nil, width, bytes]")
        if ids.strange is not None:
            raise ProtocolError(f"{ids.strange[:40]!r} is no id of an agent")
        return ids

    def columns(self, plain: list[Any]) -> Columns:
        """Many nodes of one shape."""
        if len(plain) != 3:
            raise ProtocolError(f"columns have 3 items, not {len(plain)}")
        count = self._count(plain[0])
        levels = listed(plain[2], "the levels of columns")
        if not 1 <= len(levels) <= CHAIN:
            raise ProtocolError(f"columns have 1 to {CHAIN} levels, not {len(levels)}")
        made: Columns | None = None
        for depth in range(len(levels) - 1, -1, -1):
            made = self._level(levels[depth], count, plain[1] if depth == 0 else None, made)
        assert made is not None
        return made

    def _count(self, plain: Any) -> int:
        count = whole(plain, "the count of columns", 1)
        if count > self._limits.nodes:
            raise ProtocolError(f"columns of {count} rows, over {self._limits.nodes}")
        return count

    def _level(self, plain: Any, count: int, ids: Any, scope: Columns | None) -> Columns:
        items = listed(plain, "a level of columns")
        if len(items) != 2:
            raise ProtocolError("a level of columns is [symbol, [column, ...]]")
        symbol = text(items[0], "a symbol")
        letter = symbol[:1]
        if (
            letter == "T"
            or (scope is None and letter == "P")
            or (scope is None and ids is not None)
        ):
            fields = self._fields(symbol)
            columns = self._typed(symbol, fields, items[1], count)
            if (letter == "A") == (ids is not None):
                read = self.ids(ids, count) if ids is not None else None
                if read is not None and read.duplicate is not None:
                    raise ProtocolError(f"two agents have the id #{read.duplicate}")
                return Columns(symbol, fields.names, columns, count, read, scope)
        raise ProtocolError(f"{symbol[:40]!r} cannot stand in columns like this")

    def _fields(self, symbol: str) -> Fields:
        try:
            return self._vocabulary.fields(symbol)
        except Unfit as unfit:
            raise VocabularyError(str(unfit)[:300], source="columns") from None

    def _typed(self, owner: str, fields: Fields, plain: Any, count: int) -> tuple[Column, ...]:
        items = listed(plain, f"the columns of {owner}")
        if len(items) != len(fields.all):
            raise VocabularyError(
                f"{owner} has {len(items)} columns; expected {len(fields.all)}", source="columns"
            )
        columns = tuple([self.column(item, count) for item in items])
        for one, column in zip(fields.all, columns, strict=True):
            if not fits(one.type, column):
                raise VocabularyError(f"{owner}: {one.name} must be {one.type}", source="columns")
        return columns

    def events(self, items: list[Any]) -> Events:
        """Many events."""
        name = text(items[0], "an event's type")
        declared = self._vocabulary.events.get(name)
        if declared is None:
            raise VocabularyError(f"no event type {name[:40]!r}", source="event")
        count = whole(items[1], "the count of events", 1)
        if count > self._limits.events:
            raise ProtocolError(f"{count} events at once, over {self._limits.events}")
        columns = self._typed(name, declared.fields, items[2], count)
        condition = text(items[3], "a condition")
        parse_condition(condition)
        senders, receivers = (None if one is None else self.ids(one, count) for one in items[4:])
        return Events(name, declared.fields.names, columns, count, condition, senders, receivers)

    def patch(self, plain: Any) -> Patch:
        """What is different in columns."""
        items = listed(plain, "a patch")
        if len(items) != 4:
            raise ProtocolError(f"a patch has 4 items, not {len(items)}")
        count = self._count(items[1])
        symbols = tuple([text(one, "a symbol") for one in listed(items[2], "the symbols")])
        fields = [self._fields(symbol) for symbol in symbols[:CHAIN]]
        changes = [self._change(one, count, fields) for one in listed(items[3], "the changes")]
        return Patch(count, symbols, tuple(changes))

    def _change(self, plain: Any, count: int, fields: list[Fields]) -> Change:
        items = listed(plain, "a change")
        if len(items) != 4:
            raise ProtocolError(f"a change has 4 items, not {len(items)}")
        level, place = whole(items[0], "a level"), whole(items[1], "a place")
        if level >= len(fields) or place >= len(fields[level].all):
            raise ProtocolError(f"a change of column {place} in level {level}, which there is not")
        rows = None if items[2] is None else _rows(items[2], count)
        column = self.column(items[3], count if rows is None else len(rows))
        one = fields[level].all[place]
        if not fits(one.type, column):
            raise VocabularyError(f"a patch: {one.name} must be {one.type}", source="columns")
        return Change(level, place, rows, column)


def _array(plain: Any) -> NDArray[Any]:
    if not isinstance(plain, msgpack.ExtType) or plain.code != COLUMN or not plain.data:
        raise ProtocolError("a column is extension 3 or a list of texts")
    dtype = _DTYPES.get(chr(plain.data[0]))
    if dtype is None:
        raise ProtocolError(f"a column of type {plain.data[:1]!r}; expected one of dbhiq?")
    size = np.dtype(dtype).itemsize
    if (len(plain.data) - 1) % size:
        raise ProtocolError(f"a column of {size} bytes a value has {len(plain.data) - 1} bytes")
    found = np.frombuffer(plain.data, dtype, offset=1)
    if dtype == "?":
        if (found.view(np.uint8) > 1).any():
            raise ProtocolError("truths in a column are bytes 0 and 1")
        return found
    return found.astype(np.float64 if dtype == "<f8" else np.int64)


def _rows(plain: Any, count: int) -> NDArray[np.intp]:
    rows = _array(plain)
    if rows.dtype != np.int64:
        raise ProtocolError("rows are whole numbers")
    if len(rows) and (int(rows[0]) < 0 or int(rows[-1]) >= count or (rows[1:] <= rows[:-1]).any()):
        raise ProtocolError(f"rows rise, from 0, and are under {count}")
    return rows.astype(np.intp)
