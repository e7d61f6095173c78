"""What differs between two strings in columns: what travels instead of all of the new one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from minerva_bus.grammar.column import Column, Rows
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.turnover import RowDelta

FEW: Final = 0.25
"""Of a column in which more has changed all travels, which is shorter."""


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Other values of one name at one level of the shape: in some rows, or (None) in all."""

    level: int
    place: int
    rows: Rows | None
    column: Column


@dataclass(frozen=True, slots=True, eq=False)
class Delta:
    """Changes of columns that have this many rows and these symbols, from outside to inside.

    With a `turnover` the changes are of the rows as they are after it, and every column has one
    for those born, as they have values nowhere else. `born` are their ids, where they are agents.
    """

    count: int
    symbols: tuple[str, ...]
    changes: tuple[Change, ...]
    turnover: RowDelta | None = None
    born: Ids | None = None


def difference(old: Columns, new: Columns, turnover: RowDelta | None = None) -> Delta | None:
    """What makes the new columns of the old; None where it has to be all of them.

    Agents have come and gone as their ids say. For others `turnover` says so.
    """
    if old.shape != new.shape:
        return None
    if old.ids is not None and new.ids is not None and old.ids is not new.ids:
        turnover = new.ids.since(old.ids)
        if turnover is None:
            return None
    if new.count != (old.count if turnover is None else turnover.after):
        return None
    symbols = tuple([level.symbol for level in new.levels()])
    changes = tuple(_changes(old, new, turnover))
    born = None
    if turnover is not None and new.ids is not None and len(turnover.born):
        born = new.ids.take(turnover.born)
    return Delta(old.count, symbols, changes, turnover, born)


def _changes(old: Columns, new: Columns, turnover: RowDelta | None) -> Iterator[Change]:
    for level, (before, after) in enumerate(zip(old.levels(), new.levels(), strict=True)):
        for place, (column, other) in enumerate(zip(before.columns, after.columns, strict=True)):
            rows = _other_rows(column, other) if turnover is None else _in(turnover, column, other)
            if rows is None or len(rows) > FEW * len(other):
                yield Change(level, place, None, other)
            elif len(rows):
                yield Change(level, place, rows, other.take(rows))


def _other_rows(old: Column, new: Column) -> Rows | None:
    if old is new:
        return np.empty(0, np.intp)
    rows = new.rows_since(old)
    return old.differs(new) if rows is None else rows


def _in(turnover: RowDelta, old: Column, new: Column) -> Rows | None:
    """The rows that have other values after a turnover, among them all that are born."""
    if old.ids is not None and new.ids is not None and new.ids.since(old.ids) is turnover:
        return turnover.born
    rows = old.take(turnover.source).differs(new)
    if rows is None or not len(turnover.born):
        return rows
    found = np.zeros(turnover.after, np.bool_)
    found[rows] = found[turnover.born] = True
    return np.flatnonzero(found)


def check(old: Columns, patch: Delta) -> None:
    """Raise Unfit where a patch is none of these columns."""
    symbols = tuple([level.symbol for level in old.levels()])
    if patch.count != old.count or patch.symbols != symbols:
        raise Unfit(f"a patch of {old.count} {old.symbol}")
    turnover = patch.turnover
    if turnover is None:
        return
    if not turnover.after or turnover.count != old.count:
        raise Unfit(f"a patch that leaves nothing of {old.count} {old.symbol}")
    born = 0 if patch.born is None else len(patch.born)
    if born != (len(turnover.born) if old.ids is not None else 0):
        raise Unfit(f"a patch with {born} ids for {len(turnover.born)} more {old.symbol}")
    told = {(change.level, change.place) for change in patch.changes if _tells(change, turnover)}
    if len(turnover.born) and len(told) < len(old.all_columns()):
        raise Unfit(f"a patch without values for {len(turnover.born)} more {old.symbol}")


def patched(old: Columns, patch: Delta) -> Columns:
    """The old columns with a patch. Raises Unfit where it is none of theirs."""
    check(old, patch)
    turned = old if patch.turnover is None else _turned(old, patch.turnover, patch.born)
    columns = [list(level.columns) for level in turned.levels()]
    for change in patch.changes:
        before = columns[change.level][change.place]
        columns[change.level][change.place] = (
            change.column if change.rows is None else before.with_rows(change.rows, change.column)
        )
    return turned.with_columns([column for level in columns for column in level])


def _turned(old: Columns, turnover: RowDelta, born: Ids | None) -> Columns:
    """The rows after a turnover; those born have no values of their own yet."""
    turned = old.changed(lambda column: column.take(turnover.source), turnover.after)
    if old.ids is None:
        return turned
    ids = old.ids.turned(turnover, born)
    if ids.duplicate is not None:
        raise Unfit(f"a patch by which two agents have the id #{ids.duplicate}")
    return replace(turned, ids=ids)


def _tells(change: Change, turnover: RowDelta) -> bool:
    """Whether a change has values for all who are born."""
    if change.rows is None or not len(turnover.born):
        return True
    told = np.zeros(turnover.after, np.bool_)
    told[change.rows] = True
    return bool(told[turnover.born].all())
