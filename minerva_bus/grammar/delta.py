"""The difference between two states of columns, which is sent instead of the new state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np

from minerva_bus.grammar.column import Column, Rows
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.row_delta import RowDelta
from minerva_bus.grammar.scene import Piece
from minerva_bus.grammar.unique_ids import same_id

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

    With a `turnover` the row numbers of changes are those after it, and each column has a change
    for the added rows, whose values are given nowhere else. `born` are the ids of added agents.

    A delta from `difference` has both states as `ends`. Its changes are computed when they are
    read: in the process that made it, the new state replaces the old one without them.
    """

    __slots__ = ("_born", "_changes", "count", "ends", "symbols", "turnover")

    def __init__(
        self,
        count: int,
        symbols: tuple[str, ...],
        changes: tuple[Change, ...] | None,
        turnover: RowDelta | None = None,
        born: Ids | None = None,
        ends: tuple[Columns, Columns] | None = None,
    ) -> None:
        self.count = count
        self.symbols = symbols
        self.turnover = turnover
        self.ends = ends
        self._changes = changes
        self._born = born

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes, by level and place."""
        if self._changes is None:
            old, new = cast("tuple[Columns, Columns]", self.ends)
            self._changes = tuple(_changes(old, new, self.turnover))
        return self._changes

    @property
    def born(self) -> Ids | None:
        """The ids of added agents, by row; None without any."""
        if self._born is None and self.ends is not None and self.turnover is not None:
            ids = self.ends[1].ids
            if ids is not None and len(self.turnover.born):
                self._born = ids.take(self.turnover.born)
        return self._born

    @property
    def empty(self) -> bool:
        """Whether both states are equal."""
        return self.turnover is None and not self.changes

    def result(self, old: Piece) -> Columns | None:
        """The new state, if this delta was made in this process from these very columns."""
        return self.ends[1] if self.ends is not None and self.ends[0] is old else None


def difference(old: Piece, new: Piece, turnover: RowDelta | None = None) -> Delta | None:
    """The delta from the old columns to the new; None if the new ones must be sent as they are.

    Only columns of one shape have a delta. Ids show which agents were removed and added; for
    columns without ids, `turnover` has to be given.
    """
    if not isinstance(old, Columns) or not isinstance(new, Columns) or old.shape != new.shape:
        return None
    # The same object has no turnover; others are compared.
    if old.ids is not None and new.ids is not None and old.ids is not new.ids:
        turnover = new.ids.since(old.ids)
        if turnover is None:
            return None
    if new.count != (old.count if turnover is None else turnover.after):
        return None
    symbols = tuple([level.symbol for level in new.levels()])
    return Delta(old.count, symbols, None, turnover, ends=(old, new))


def _changes(old: Columns, new: Columns, turnover: RowDelta | None) -> Iterator[Change]:
    for level, (before, after) in enumerate(zip(old.levels(), new.levels(), strict=True)):
        for place, (was, now) in enumerate(zip(before.columns, after.columns, strict=True)):
            rows = _changed_rows(was, now) if turnover is None else _rows_after(turnover, was, now)
            if rows is None or len(rows) > MAX_PART * len(now):
                yield Change(level, place, None, now)
            elif len(rows):
                yield Change(level, place, rows, now.take(rows))


def _changed_rows(old: Column, new: Column) -> Rows | None:
    if old is new:
        return np.empty(0, np.intp)
    rows = new.rows_since(old)
    return old.differs(new) if rows is None else rows


def _rows_after(turnover: RowDelta, old: Column, new: Column) -> Rows | None:
    """The rows with new values after a turnover, including all added rows."""
    # Ids differ by the turnover only, so they need no comparison.
    if old.ids is not None and new.ids is not None and new.ids.since(old.ids) is turnover:
        return turnover.born
    rows = old.take(turnover.source).differs(new)
    if rows is None or not len(turnover.born):
        return rows
    changed = np.zeros(turnover.after, np.bool_)
    # Added rows count as changed even if their values equal those of row 0, which `source` uses
    # for rows without an old one.
    changed[rows] = changed[turnover.born] = True
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
    turnover = delta.turnover
    if turnover is None:
        return old
    # Columns have at least one row.
    if not turnover.after or turnover.count != old.count:
        raise Unfit(f"a patch that removes all {old.count} {old.symbol}")
    born = 0 if delta.born is None else len(delta.born)
    if born != (len(turnover.born) if old.ids is not None else 0):
        raise Unfit(f"a patch with {born} ids for {len(turnover.born)} added {old.symbol}")
    # A set, because several changes of one column cover it only once.
    complete = {
        (change.level, change.place) for change in delta.changes if _covers_born(change, turnover)
    }
    if len(turnover.born) and len(complete) < len(old.all_columns()):
        raise Unfit(f"a patch without values for {len(turnover.born)} added {old.symbol}")
    return old


def patched(old: Piece, delta: Delta) -> Columns:
    """The old columns with a delta applied. Raises Unfit if it does not apply to them."""
    if (result := delta.result(old)) is not None:
        return result
    # A delta may come from a remote member.
    columnar = check(old, delta)
    turned = columnar if delta.turnover is None else _turned(columnar, delta.turnover, delta.born)
    changes: dict[tuple[int, int], list[Change]] = {}
    for change in delta.changes:
        changes.setdefault((change.level, change.place), []).append(change)
    return turned.with_columns([
        _patched_column(column, changes.get((number, place), []), delta.turnover)
        for number, level in enumerate(columnar.levels())
        for place, column in enumerate(level.columns)
    ])  # fmt: skip


def _patched_column(old: Column, changes: Sequence[Change], turnover: RowDelta | None) -> Column:
    """A column after its changes, whose row numbers are those after the turnover."""
    if turnover is not None and (not changes or changes[0].rows is not None):
        first, changes = changes[:1], changes[1:]
        rows, values = (first[0].rows, first[0].column) if first else (None, None)
        old = old.moved(turnover.source, np.empty(0, np.intp) if rows is None else rows, values)
    for change in changes:
        old = change.column if change.rows is None else old.with_rows(change.rows, change.column)
    return old


def _turned(old: Columns, turnover: RowDelta, born: Ids | None) -> Columns:
    """The ids and number of rows after a turnover; the columns are still the old ones."""
    turned = old.changed(lambda column: column, turnover.after)
    if old.ids is None:
        return turned
    ids = old.ids.turned(turnover, born)
    # A newborn must not have the id of another agent.
    if ids.duplicate is not None:
        raise Unfit(f"a patch after which {same_id(ids.duplicate)}")
    return replace(turned, ids=ids)


def _covers_born(change: Change, turnover: RowDelta) -> bool:
    """Whether a change has values for all added rows."""
    if change.rows is None or not len(turnover.born):
        return True
    changed = np.zeros(turnover.after, np.bool_)
    changed[change.rows] = True
    return bool(changed[turnover.born].all())
