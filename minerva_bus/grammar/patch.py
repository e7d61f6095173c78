"""What differs between two strings in columns: what travels instead of all of the new one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from minerva_bus.grammar.columns import Column, Columns, Rows
from minerva_bus.grammar.fitting import Unfit

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
class Patch:
    """Changes of columns that have this many rows and these symbols, from outside to inside."""

    count: int
    symbols: tuple[str, ...]
    changes: tuple[Change, ...]


def difference(old: Columns, new: Columns) -> Patch | None:
    """What makes the new columns of the old; None where they differ in rows, ids or shape."""
    if old.count != new.count or old.ids is not new.ids or old.shape != new.shape:
        return None
    return Patch(
        new.count, tuple([level.symbol for level in new.levels()]), tuple(_changes(old, new))
    )


def _changes(old: Columns, new: Columns) -> Iterator[Change]:
    for level, (before, after) in enumerate(zip(old.levels(), new.levels(), strict=True)):
        for place, (one, other) in enumerate(zip(before.columns, after.columns, strict=True)):
            if one is other:
                continue
            rows = other.rows_since(one)
            if rows is None:
                rows = one.differs(other)
            if rows is None or len(rows) > FEW * len(other):
                yield Change(level, place, None, other)
            elif len(rows):
                yield Change(level, place, rows, other.take(rows))


def patched(old: Columns, patch: Patch) -> Columns:
    """The old columns with a patch. Raises Unfit where it is none of theirs."""
    levels = list(old.levels())
    if patch.count != old.count or patch.symbols != tuple([one.symbol for one in levels]):
        raise Unfit(f"a patch of {old.count} {levels[0].symbol}")
    columns = [list(level.columns) for level in levels]
    for change in patch.changes:
        before = columns[change.level][change.place]
        after = (
            change.column if change.rows is None else before.put(change.rows, change.column.array)
        )
        columns[change.level][change.place] = after
    return old.with_columns([column for level in columns for column in level])
