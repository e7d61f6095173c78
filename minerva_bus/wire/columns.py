"""Columns, batches of events, and patches as plain data: section 3 of PROTOCOL.md.

column  = array | [text, ...]        (arrays.py)
        | ids                        text that is ids of agents
columns = [count, ids or nil, [[symbol, [column, ...]], ...]]     one pair for each level
events  = [type, count, [column, ...], condition, senders, receivers]    ids or nil
patch   = ["patch", count, [symbol, ...], [[level, place, rows, column], ...]]
                                          rows: a column of integers, or nil for all
        | ["patch", count, [symbol, ...], [...], gone, born, ids or nil]
                                          gone: old rows, born: new rows, ids: of those born
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import ProtocolError, VocabularyError
from minerva_bus.grammar.column import Column, fits
from minerva_bus.grammar.columns import CHAIN, Columns
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.delta import Change, Delta
from minerva_bus.grammar.events import Events
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import Ids, RowDelta, same_id
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wire.arrays import (
    are_ids,
    plain_array,
    plain_ids,
    plain_rows,
    read_array,
    read_ids,
    read_rows,
)
from minerva_bus.wire.limits import Limits
from minerva_bus.wire.plain import as_int, as_list, as_text, as_texts

PATCH: Final = "patch"


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
            None if change.rows is None else plain_rows(change.rows),
            plain_column(change.column),
        ]
        for change in patch.changes
    ]
    plain = [PATCH, patch.count, list(patch.symbols), changes]
    if patch.row_delta is not None:
        gone, born = map(plain_rows, (patch.row_delta.gone, patch.row_delta.born))
        plain += [gone, born, plain_ids(patch.born)]
    return plain


def is_patch(plain: Any) -> bool:
    """Whether plain data are a patch, not a string."""
    return isinstance(plain, list) and plain[:1] == [PATCH]


class ColumnsReader:
    """Reads columns by a vocabulary. Raises ProtocolError and VocabularyError."""

    def __init__(self, vocabulary: Vocabulary, limits: Limits) -> None:
        self._vocabulary = vocabulary
        self._limits = limits
        self._rows: int | None = None

    def begin(self) -> None:
        """Allow as many rows as the limit in the message that begins.

        Without a call, any number of rows may be read.
        """
        self._rows = self._limits.rows

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
        if count > self._limits.nodes:
            raise ProtocolError(f"columns of {count} rows, over {self._limits.nodes}")
        self._take(count)
        return count

    def _take(self, rows: int) -> None:
        if self._rows is None:
            return
        self._rows -= rows
        if self._rows < 0:
            raise ProtocolError(f"columns of more than {self._limits.rows} rows in a message")

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
            return self._vocabulary.fields(symbol)
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

    def events(self, items: list[Any]) -> Events:
        """A batch of events."""
        name = as_text(items[0], "an event's type")
        declared = self._vocabulary.events.get(name)
        if declared is None:
            raise VocabularyError(f"no event type {name[:40]!r}", source="event")
        count = as_int(items[1], "the count of events", 1)
        if count > self._limits.events:
            raise ProtocolError(f"{count} events at once, over {self._limits.events}")
        self._take(count)
        columns = self._typed(name, declared.fields, items[2], count)
        condition = as_text(items[3], "a condition")
        self._vocabulary.check_condition(name, condition, "event")
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
        born = read_rows(born, self._limits.nodes)
        row_delta = RowDelta(count, gone, born)
        if len(born) and int(born[-1]) >= row_delta.after:
            raise ProtocolError(f"born row {born[-1]} is not below {row_delta.after}")
        newborn = None if ids is None else read_ids(ids, len(born))
        if newborn is not None and newborn.duplicate is not None:
            raise ProtocolError(same_id(newborn.duplicate))
        return row_delta, newborn

    def _change(self, plain: Any, count: int, fields: list[Fields]) -> Change:
        items = as_list(plain, "a change")
        if len(items) != 4:
            raise ProtocolError(f"a change has 4 items, not {len(items)}")
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
