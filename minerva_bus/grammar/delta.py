"""The difference between two states of columns, which is sent instead of the new state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np

from minerva_bus.grammar.columns import Column, Columns, Rows
from minerva_bus.grammar.ids import Ids, RowDelta, row_delta_of_ids, same_id, updated_ids
from minerva_bus.grammar.scene import Piece
from minerva_bus.grammar.types import Unfit

MAX_PART: Final = 0.25
"""Maximum part of a column that is sent as rows; beyond it the complete column is shorter than
rows with their numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """New values of one name at one level of the shape, in these rows or (None) in all."""

    level: int
    place: int
    rows: Rows | None
    column: Column


class Delta:
    """Changes of columns with `count` rows and these symbols, from outside to inside.

    With a `row_delta` the row numbers of changes are those after it, and each column has a change
    for the added rows, whose values are given nowhere else. `born` are the ids of added agents.

    A delta from `difference` has both states as `ends`. Its changes are computed when they are
    read: in the process that made it, the new state replaces the old one without them.
    """

    __slots__ = ("_born", "_changes", "count", "ends", "row_delta", "symbols")

    def __init__(
        self,
        count: int,
        symbols: tuple[str, ...],
        changes: tuple[Change, ...] | None,
        row_delta: RowDelta | None = None,
        born: Ids | None = None,
        ends: tuple[Columns, Columns] | None = None,
    ) -> None:
        self.count = count
        self.symbols = symbols
        self.row_delta = row_delta
        self.ends = ends
        self._changes = changes
        self._born = born

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes, by level and place."""
        if self._changes is None:
            old, new = cast("tuple[Columns, Columns]", self.ends)
            self._changes = tuple(_changes(old, new, self.row_delta))
        return self._changes

    @property
    def born(self) -> Ids | None:
        """The ids of added agents, by row; None without any."""
        if self._born is None and self.ends is not None and self.row_delta is not None:
            ids = self.ends[1].ids
            if ids is not None and len(self.row_delta.born):
                self._born = ids.take(self.row_delta.born)
        return self._born

    @property
    def empty(self) -> bool:
        """Whether both states are equal."""
        return self.row_delta is None and not self.changes

    def result(self, old: Piece) -> Columns | None:
        """The new state, if this delta was made in this process from these very columns."""
        return self.ends[1] if self.ends is not None and self.ends[0] is old else None


def difference(old: Piece, new: Piece, row_delta: RowDelta | None = None) -> Delta | None:
    """The delta from the old columns to the new; None if the new ones must be sent as they are.

    Only columns of one shape have a delta. Ids show which agents were removed and added; for
    columns without ids, `row_delta` has to be given.
    """
    if not isinstance(old, Columns) or not isinstance(new, Columns) or old.shape != new.shape:
        return None
    # The same object has no row delta; others are compared.
    if old.ids is not None and new.ids is not None and old.ids is not new.ids:
        row_delta = row_delta_of_ids(old.ids, new.ids)
        if row_delta is None:
            return None
    if new.count != (old.count if row_delta is None else row_delta.after):
        return None
    symbols = tuple([level.symbol for level in new.levels()])
    return Delta(old.count, symbols, None, row_delta, ends=(old, new))


def _changes(old: Columns, new: Columns, row_delta: RowDelta | None) -> Iterator[Change]:
    for level, (before, after) in enumerate(zip(old.levels(), new.levels(), strict=True)):
        for place, (was, now) in enumerate(zip(before.columns, after.columns, strict=True)):
            rows = (
                _changed_rows(was, now) if row_delta is None else _rows_after(row_delta, was, now)
            )
            if rows is None or len(rows) > MAX_PART * len(now):
                yield Change(level, place, None, now)
            elif len(rows):
                yield Change(level, place, rows, now.take(rows))


def _changed_rows(old: Column, new: Column) -> Rows | None:
    if old is new:
        return np.empty(0, np.intp)
    rows = new.rows_since(old)
    return old.differs(new) if rows is None else rows


def _rows_after(row_delta: RowDelta, old: Column, new: Column) -> Rows | None:
    """The rows after a row delta that have new values, including all added rows."""
    # Ids differ by the row delta only, so they need no comparison.
    old_ids, new_ids = old.ids, new.ids
    if old_ids and new_ids and row_delta_of_ids(old_ids, new_ids) is row_delta:
        return row_delta.born
    rows = old.take(row_delta.source).differs(new)
    if rows is None or not len(row_delta.born):
        return rows
    changed = np.zeros(row_delta.after, np.bool_)
    # Added rows count as changed even if their values equal those of row 0, which `source` uses
    # for rows without an old one.
    changed[rows] = changed[row_delta.born] = True
    return np.flatnonzero(changed)


def check(old: Piece, delta: Delta) -> Columns:
    """The piece as columns, if the delta applies to them. Raises Unfit."""
    if isinstance(old, Columns) and delta.result(old) is not None:
        return old
    if not isinstance(old, Columns):
        raise Unfit(f"a patch of {old.symbol}, which is not in columns")
    symbols = tuple([level.symbol for level in old.levels()])
    if delta.count != old.count or delta.symbols != symbols:
        raise Unfit(f"a patch of {old.count} {old.symbol}")
    row_delta = delta.row_delta
    if row_delta is None:
        return old
    # Columns have at least one row.
    if not row_delta.after or row_delta.count != old.count:
        raise Unfit(f"a patch that removes all {old.count} {old.symbol}")
    born = 0 if delta.born is None else len(delta.born)
    if born != (len(row_delta.born) if old.ids is not None else 0):
        raise Unfit(f"a patch with {born} ids for {len(row_delta.born)} added {old.symbol}")
    # A set, because several changes of one column cover it only once.
    complete = {
        (change.level, change.place) for change in delta.changes if _covers_born(change, row_delta)
    }
    if len(row_delta.born) and len(complete) < len(old.all_columns()):
        raise Unfit(f"a patch without values for {len(row_delta.born)} added {old.symbol}")
    return old


def patched(old: Piece, delta: Delta) -> Columns:
    """The old columns with a delta applied. Raises Unfit if it does not apply to them."""
    if (result := delta.result(old)) is not None:
        return result
    # A delta may come from a remote member.
    columnar = check(old, delta)
    updated = (
        columnar if delta.row_delta is None else _updated(columnar, delta.row_delta, delta.born)
    )
    changes: dict[tuple[int, int], list[Change]] = {}
    for change in delta.changes:
        changes.setdefault((change.level, change.place), []).append(change)
    return updated.with_columns([
        _patched_column(column, changes.get((number, place), []), delta.row_delta)
        for number, level in enumerate(columnar.levels())
        for place, column in enumerate(level.columns)
    ])  # fmt: skip


def _patched_column(old: Column, changes: Sequence[Change], row_delta: RowDelta | None) -> Column:
    """A column after its changes, whose row numbers are those after the row delta."""
    if row_delta is not None and (not changes or changes[0].rows is not None):
        first, changes = changes[:1], changes[1:]
        rows, values = (first[0].rows, first[0].column) if first else (None, None)
        old = old.moved(row_delta.source, np.empty(0, np.intp) if rows is None else rows, values)
    for change in changes:
        old = change.column if change.rows is None else old.with_rows(change.rows, change.column)
    return old


def _updated(old: Columns, row_delta: RowDelta, born: Ids | None) -> Columns:
    """The ids and number of rows after a row delta; the columns are still the old ones."""
    updated = old.changed(lambda column: column, row_delta.after)
    if old.ids is None:
        return updated
    ids = updated_ids(old.ids, row_delta, born)
    # A newborn must not have the id of another agent.
    if ids.duplicate is not None:
        raise Unfit(f"a patch after which {same_id(ids.duplicate)}")
    return replace(updated, ids=ids)


def _covers_born(change: Change, row_delta: RowDelta) -> bool:
    """Whether a change has values for all added rows."""
    if change.rows is None or not len(row_delta.born):
        return True
    changed = np.zeros(row_delta.after, np.bool_)
    changed[change.rows] = True
    return bool(changed[row_delta.born].all())
