"""How the ids of a population change from frame to frame: births, deaths, and the row delta."""

from __future__ import annotations

from weakref import ref

import numpy as np

from minerva_bus.grammar.id_pool import IdPool
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.row_delta import RowDelta


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
