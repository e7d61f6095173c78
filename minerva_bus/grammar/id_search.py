"""Search for ids in a column of ids, by whatever form the two have in common."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.places import Rows, found_in

if TYPE_CHECKING:
    from minerva_bus.grammar.ids import Ids

_NUMBER: Final = re.compile(r"0|[1-9][0-9]{0,17}")


def rows_in(ids: Ids, others: Ids) -> Rows:
    """The row of each of the other ids, -1 if it is not in `ids`; shape (len(others),)."""
    # The usual case in a frame without births and deaths.
    if ids.spells(others) and ids.duplicate is None:
        return np.arange(len(ids))
    if ids.pool is not None:
        return _rows_of_entries(ids, others)
    if ids.alike(others):
        return _rows_of_numbers(ids, others.raw)
    if apart(ids, others):
        return np.full(len(others), -1, np.intp)
    if ids.stem is not None and others.stem is None:
        return _numbered_among(ids, ids.stem, others)
    return _rows_of_texts(ids, others)


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
