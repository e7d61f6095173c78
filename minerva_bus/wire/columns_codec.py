"""Columns, batches of events, and patches as plain data: section 3 of PROTOCOL.md.

array   = extension 3: a byte for the type, then the values, little endian
              d float64    b h i q integers of 1, 2, 4, 8 bytes    ? bools of 1 byte
ids     = [stem, array of integers] | [nil, width, bytes]
        | [stem, first, count]       consecutive numbers
column  = array | [text, ...]
        | ids                        text that is ids of agents
columns = [count, ids or nil, [[symbol, [column, ...]], ...]]     one pair for each level
events  = [type, count, [column, ...], condition, senders, receivers]    ids or nil
patch   = ["patch", count, [symbol, ...], [[level, place, rows, column], ...]]
                                          rows: a column of integers, or nil for all
        | ["patch", count, [symbol, ...], [...], gone, born, ids or nil]
                                          gone: old rows, born: new rows, ids: of those born
"""

from __future__ import annotations

from typing import Any, Final, cast

import msgpack
import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import ProtocolError, VocabularyError, nearest
from minerva_bus.grammar.columns import CHAIN, MANY, Change, Column, Columns, Delta, fits
from minerva_bus.grammar.events import Events
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import LONGEST, Ids, RowDelta, same_id
from minerva_bus.grammar.types import Unfit
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.wire.plain import (
    DEFAULT,
    Limits,
    as_int,
    as_items,
    as_list,
    as_text,
    as_texts,
    extension,
)

PATCH: Final = "patch"


# --- columns to plain data ---


def plain_column(column: Column) -> Any:
    """A column; text that is ids of agents as ids."""
    if column.ids is not None:
        return plain_ids(column.ids)
    return column.list() if column.dtype == object else plain_array(column.array)


def plain_columns(columns: Columns) -> list[Any]:
    """Nodes of one shape, in columns."""
    levels = [
        [level.symbol, [plain_column(c) for c in level.columns]] for level in columns.levels()
    ]
    return [columns.count, plain_ids(columns.ids), levels]


def plain_events(events: Events) -> list[Any]:
    """A batch of events."""
    return [
        events.type,
        events.count,
        [plain_column(column) for column in events.columns],
        events.condition,
        plain_ids(events.senders),
        plain_ids(events.receivers),
    ]


def plain_patch(patch: Delta) -> list[Any]:
    """A patch."""
    changes = [
        [
            change.level,
            change.place,
            None if change.rows is None else plain_array(change.rows),
            plain_column(change.column),
        ]
        for change in patch.changes
    ]
    plain = [PATCH, patch.count, list(patch.symbols), changes]
    if patch.row_delta is not None:
        gone, born = map(plain_array, (patch.row_delta.gone, patch.row_delta.born))
        plain += [gone, born, plain_ids(patch.born)]
    return plain


def is_patch(plain: Any) -> bool:
    """Whether plain data are a patch, not a string."""
    return isinstance(plain, list) and plain[:1] == [PATCH]


# --- columns from plain data ---


class ColumnsReader:
    """Reads columns by a vocabulary. Raises ProtocolError and VocabularyError."""

    def __init__(self, vocabulary: Vocabulary, limits: Limits = DEFAULT) -> None:
        self.vocabulary = vocabulary
        self.limits = limits
        self._rows: int | None = None

    def begin(self) -> None:
        """Allow as many rows as the limit in the message that begins.

        Without a call, any number of rows may be read.
        """
        self._rows = self.limits.rows

    def column(self, plain: Any, count: int) -> Column:
        """A column of `count` values."""
        # Checked first, because ids are a list, too.
        if are_ids(plain):
            return Column.of_ids(read_ids(plain, count))
        if isinstance(plain, list):
            texts = as_texts(plain, "a column")
            # numpy would make a fixed-width array of a list of texts.
            array: NDArray[Any] = np.empty(len(texts), object)
            array[:] = texts
        else:
            array = read_array(plain)
        if len(array) != count:
            raise ProtocolError(f"a column has {len(array)} values; expected {count}")
        return Column(array)

    def columns(self, plain: list[Any]) -> Columns:
        """Nodes of one shape, in columns."""
        if len(plain) != 3:
            raise ProtocolError(f"columns must have 3 items, not {len(plain)}")
        count = self._count(plain[0])
        levels = as_list(plain[2], "the levels of columns")
        if not 1 <= len(levels) <= CHAIN:
            raise ProtocolError(f"columns must have 1 to {CHAIN} levels, not {len(levels)}")
        made: Columns | None = None
        # From the inside to the outside, because each level needs its scope.
        for depth in range(len(levels) - 1, -1, -1):
            made = self._level(levels[depth], count, plain[1] if depth == 0 else None, made)
        assert made is not None
        return made

    def _count(self, plain: Any) -> int:
        # Bounded before any column is read: any number of consecutive
        # ids is only three values.
        count = as_int(plain, "the count of columns", 1)
        if count > self.limits.nodes:
            raise ProtocolError(f"columns of {count} rows, over {self.limits.nodes}")
        self._take(count)
        return count

    def _take(self, rows: int) -> None:
        if self._rows is None:
            return
        self._rows -= rows
        if self._rows < 0:
            raise ProtocolError(f"columns of more than {self.limits.rows} rows in a message")

    def _level(self, plain: Any, count: int, ids: Any, scope: Columns | None) -> Columns:
        items = as_list(plain, "a level of columns")
        if len(items) != 2:
            raise ProtocolError("a level of columns is [symbol, [column, ...]]")
        symbol = as_text(items[0], "a symbol")
        letter = symbol[:1]
        if (
            letter == "T"
            or (scope is None and letter == "P")
            or (scope is None and ids is not None)
        ):
            fields = self._fields(symbol)
            columns = self._typed(symbol, fields, items[1], count)
            # Agents have ids and other nodes have none.
            if (letter == "A") == (ids is not None):
                read = read_ids(ids, count) if ids is not None else None
                if read is not None and read.duplicate is not None:
                    raise ProtocolError(same_id(read.duplicate))
                return Columns(symbol, fields.names, columns, count, read, scope)
        raise ProtocolError(f"{symbol[:40]!r} cannot stand in columns like this")

    def _fields(self, symbol: str) -> Fields:
        try:
            return self.vocabulary.fields(symbol)
        except Unfit as unfit:
            raise VocabularyError(str(unfit)[:300], source="columns") from None

    def _typed(self, owner: str, fields: Fields, plain: Any, count: int) -> tuple[Column, ...]:
        items = as_list(plain, f"the columns of {owner}")
        if len(items) != len(fields.all):
            raise VocabularyError(
                f"{owner} has {len(items)} columns; expected {len(fields.all)}", source="columns"
            )
        columns = tuple([self.column(item, count) for item in items])
        for field, column in zip(fields.all, columns, strict=True):
            if not fits(field.type, column):
                raise VocabularyError(
                    f"{owner}: {field.name} must be {field.type}", source="columns"
                )
        return columns

    def event_type(self, plain: Any) -> EventType:
        """A declared event type by its name."""
        name = as_text(plain, "an event's type")
        declared = self.vocabulary.events.get(name)
        if declared is None:
            hint = nearest(name, list(self.vocabulary.events))
            problem = f"the world has no event type {name[:40]!r}{hint}"
            raise VocabularyError(problem, source="event")
        return declared

    def batch(self, items: list[Any]) -> Events:
        """A batch of events."""
        declared = self.event_type(items[0])
        name = declared.name
        count = as_int(items[1], "the count of events", 1)
        if count > self.limits.events:
            raise ProtocolError(f"{count} events at once, over {self.limits.events}")
        self._take(count)
        columns = self._typed(name, declared.fields, items[2], count)
        condition = as_text(items[3], "a condition")
        self.vocabulary.check_condition(name, condition, "event")
        senders, receivers = (None if ids is None else read_ids(ids, count) for ids in items[4:])
        return Events(name, declared.fields.names, columns, count, condition, senders, receivers)

    def patch(self, plain: Any) -> Delta:
        """A patch of columns."""
        items = as_list(plain, "a patch")
        if len(items) not in (4, 7):
            raise ProtocolError(f"a patch has 4 or 7 items, not {len(items)}")
        count = self._count(items[1])
        # Read before the changes, whose rows are those after the row delta.
        row_delta, born = self._row_delta(count, *items[4:]) if len(items) == 7 else (None, None)
        after = count if row_delta is None else self._count(row_delta.after)
        symbols = as_texts(items[2], "the symbols")
        fields = [self._fields(symbol) for symbol in symbols[:CHAIN]]
        changes = [self._change(item, after, fields) for item in as_list(items[3], "the changes")]
        return Delta(count, symbols, tuple(changes), row_delta, born)

    def _row_delta(self, count: int, gone: Any, born: Any, ids: Any) -> tuple[RowDelta, Ids | None]:
        gone = read_rows(gone, count)
        # The number of rows after the change follows from these rows,
        # so only the general limit applies.
        born = read_rows(born, self.limits.nodes)
        row_delta = RowDelta(count, gone, born)
        if len(born) and int(born[-1]) >= row_delta.after:
            raise ProtocolError(f"born row {born[-1]} is not below {row_delta.after}")
        newborn = None if ids is None else read_ids(ids, len(born))
        if newborn is not None and newborn.duplicate is not None:
            raise ProtocolError(same_id(newborn.duplicate))
        return row_delta, newborn

    def _change(self, plain: Any, count: int, fields: list[Fields]) -> Change:
        items = as_items(plain, "a change", 4)
        level, place = as_int(items[0], "a level"), as_int(items[1], "a place")
        if level >= len(fields) or place >= len(fields[level].all):
            raise ProtocolError(
                f"a change of column {place} in level {level}, which does not exist"
            )
        rows = None if items[2] is None else read_rows(items[2], count)
        column = self.column(items[3], count if rows is None else len(rows))
        field = fields[level].all[place]
        if not fits(field.type, column):
            raise VocabularyError(f"a patch: {field.name} must be {field.type}", source="columns")
        return Change(level, place, rows, column)


# --- arrays and ids ---

ARRAY: Final = 3
_DTYPES: Final = {"d": "<f8", "b": "<i1", "h": "<i2", "i": "<i4", "q": "<i8", "?": "?"}

# Without the Python code of the methods of arrays, which takes longer for short ones.
_LEAST: Final = np.minimum.reduce
_MOST: Final = np.maximum.reduce

Rows = NDArray[np.intp]


def plain_array(array: NDArray[Any]) -> Any:
    """An array; integers in the narrowest type that holds them all."""
    # Most columns of integers are small numbers, so the narrowest type saves up to seven of eight
    # bytes. Reals are never narrowed: their bits enter the digest.
    letter = {"f": "d", "b": "?"}.get(array.dtype.kind) or _narrowest(array)
    data = np.ascontiguousarray(array, _DTYPES[letter])
    # By `join`, because `tobytes` and `+` would each copy a large array.
    return extension(ARRAY, b"".join((letter.encode(), data.data)))


def _narrowest(array: NDArray[Any]) -> str:
    if not len(array):
        return "b"
    least, most = int(_LEAST(array)), int(_MOST(array))
    for letter, half in (("b", 1 << 7), ("h", 1 << 15), ("i", 1 << 31)):
        if -half <= least and most < half:
            return letter
    return "q"


def read_array(plain: Any) -> NDArray[Any]:
    """An array of float64, int64 or bool."""
    if not isinstance(plain, msgpack.ExtType) or plain.code != ARRAY or not plain.data:
        raise ProtocolError("a column must be extension 3 or a list of text")
    dtype = _DTYPES.get(chr(plain.data[0]))
    if dtype is None:
        raise ProtocolError(f"a column of type {plain.data[:1]!r}; expected one of dbhiq?")
    size = np.dtype(dtype).itemsize
    # numpy would raise an error of its own for remaining bytes.
    if (len(plain.data) - 1) % size:
        raise ProtocolError(f"a column of {size} bytes a value has {len(plain.data) - 1} bytes")
    array = np.frombuffer(plain.data, dtype, offset=1)
    if dtype == "?":
        # numpy takes any other byte for true as well, but the digest of a column hashes its bytes.
        if (array.view(np.uint8) > 1).any():
            raise ProtocolError("bools in a column must be bytes 0 or 1")
        return array
    # Copied even if the type is right: the bytes after the letter are unaligned and read-only.
    return array.astype(np.float64 if dtype == "<f8" else np.int64)


def read_rows(plain: Any, count: int) -> Rows:
    """Ascending row numbers below a count."""
    rows = read_array(plain)
    if rows.dtype != np.int64:
        raise ProtocolError("rows must be integers")
    if len(rows) and (int(rows[0]) < 0 or int(rows[-1]) >= count or (rows[1:] <= rows[:-1]).any()):
        raise ProtocolError(f"rows must ascend, from 0, and be below {count}")
    return rows.astype(np.intp)


def plain_ids(ids: Ids | None) -> Any:
    """Ids of agents."""
    if ids is None:
        return None
    # Three values for any number of agents; common for generated populations.
    if len(ids) >= MANY and ids.consecutive:
        return [ids.stem, int(ids.data[0]), len(ids)]
    if ids.stem is not None:
        return [ids.stem, plain_array(ids.data)]
    # Equal ids have equal bytes, even if their array was wide enough for longer ids before.
    width = ids.data.dtype.itemsize
    cells = np.ascontiguousarray(ids.data).view(np.uint8).reshape(len(ids), width)
    while width > 1 and not cells[:, width - 1].any():
        width -= 1
    return [None, width, cells[:, :width].tobytes()]


def are_ids(plain: Any) -> bool:
    """Whether plain data are ids; a list of text has text as its second item."""
    if not isinstance(plain, list):
        return False
    items = cast("list[Any]", plain)
    return len(items) in (2, 3) and not isinstance(items[1], str)


def read_ids(plain: Any, count: int) -> Ids:
    """`count` ids."""
    items = as_list(plain, "ids")
    if len(items) == 3 and items[0] is None:
        ids = _spelled(items, count)
    elif len(items) in (2, 3) and isinstance(items[0], str):
        ids = Ids(items[0], _numbers(items[1:], count))
    else:
        raise ProtocolError("ids are [stem, numbers], [stem, first, count] or [nil, width, bytes]")
    if ids.too_long:
        raise ProtocolError(f"ids of more than {LONGEST} characters in columns")
    ids = ids.known()
    # Checked before the ids are decoded, because their bytes may not be UTF-8.
    if ids.strange is not None:
        raise ProtocolError(f"{ids.strange[:40]!r} is not a valid agent id")
    return ids


def _spelled(items: list[Any], count: int) -> Ids:
    width, data = as_int(items[1], "the width of ids", 1), items[2]
    # The product is compared before numpy gets the bytes, so the
    # count cannot be larger than the data.
    if width > LONGEST or not isinstance(data, bytes) or len(data) != width * count:
        raise ProtocolError(f"{count} ids of {width} bytes are {count * width} bytes in all")
    return Ids(None, np.frombuffer(data, f"S{width}"))


def _numbers(items: list[Any], count: int) -> NDArray[np.int64]:
    if len(items) == 1:
        numbers = read_array(items[0])
        if numbers.dtype != np.int64 or (len(numbers) and int(numbers.min()) < 0):
            raise ProtocolError("the numbers of ids must be whole numbers from 0")
        size = len(numbers)
    else:
        first, size = as_int(items[0], "the first of ids"), as_int(items[1], "the count of ids")
        if first + size > np.iinfo(np.int64).max:
            raise ProtocolError(f"ids from {first} on exceed 64 bits")
        # Made only if the count is right: a few bytes could request gigabytes of numbers.
        numbers = np.arange(first, first + size) if size == count else np.empty(0, np.int64)
    if size != count:
        raise ProtocolError(f"{size} ids; expected {count}")
    return numbers
