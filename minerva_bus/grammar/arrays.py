"""Conversion of arrays to columns of a declared type."""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.column import Column, are_texts
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.types import Type

SCALARS: Final = frozenset(("real", "int", "bool", "text"))
_KINDS = {"real": "fiub", "int": "iu", "bool": "b", "text": "OUT"}
_DTYPES = {"real": np.float64, "int": np.int64, "bool": np.bool_, "text": object}


def is_array(value: object) -> bool:
    """Whether a value has one element for each of many nodes."""
    return (isinstance(value, np.ndarray) and value.ndim == 1) or isinstance(value, Ids)


def fit_array(kind: Type, value: Any, *, finite: bool = True) -> Column:
    """A column of this type with the values of an array of shape (n,), or the texts of ids.

    With `finite=False`, the caller checks later that they are finite. Raises Unfit.
    """
    if kind.kind not in SCALARS:
        raise Unfit(f"a {kind}, which cannot be a column")
    if isinstance(value, Ids):
        if kind.kind != "text":
            raise Unfit(f"an array of {kind}, not of ids")
        return _among(kind, Column.of_ids(value))
    array = cast("NDArray[Any]", value)
    letter = array.dtype.kind
    if letter not in _KINDS[kind.kind] or (kind.kind == "real" and letter == "b"):
        raise Unfit(f"an array of {kind}, not of {array.dtype}")
    if kind.kind == "text":
        return _among(kind, _texts(array))
    # A writable array is copied, because its owner could change the string later.
    fitted = array.astype(_DTYPES[kind.kind], copy=array.flags.writeable)
    # Unsigned integers of 2^63 and more have become negative.
    if letter == "u" and kind.kind == "int" and (fitted < 0).any():
        raise Unfit("an array of whole numbers of at most 64 bits")
    if finite and kind.kind == "real" and not np.isfinite(fitted).all():
        raise Unfit(f"an array of {kind} with finite numbers")
    if kind.range is not None and fitted.size:
        # If the extremes are in the range, all values are.
        kind.check_range(fitted.min().item())
        kind.check_range(fitted.max().item())
    return Column(fitted)


def _among(kind: Type, column: Column) -> Column:
    """The column, if its texts are words of this type. Raises Unfit."""
    for word in sorted({*column.list()}) if kind.words else ():
        kind.fit(word)
    return column


def _texts(array: NDArray[Any]) -> Column:
    texts = array.tolist()
    if not are_texts(texts):
        raise Unfit("an array of texts")
    plain = np.empty(len(texts), object)
    plain[:] = texts
    return Column(plain)


def repeated(kind: Type, value: Any, count: int) -> Column:
    """A column of one value. Raises Unfit."""
    if kind.kind not in SCALARS:
        raise Unfit(f"a {kind}, which cannot be a column")
    array = np.empty(count, _DTYPES[kind.kind])
    array[:] = kind.fit(value)
    return Column(array)


def fits(kind: Type, column: Column) -> bool:
    """Whether the values of a column are of this type, without conversion."""
    if kind.kind == "text" and column.ids is not None and not kind.words:
        return True
    if kind.kind == "text":
        values = column.array if column.words is None else column.words
        texts = values.tolist() if values.dtype == object else [None]
        return are_texts(texts) and (not kind.words or {*texts} <= {*kind.words})
    array = column.array
    if kind.kind not in SCALARS or array.dtype != _DTYPES[kind.kind]:
        return False
    if kind.range is not None and array.size:
        # If the extremes are in the range, all values are; nan is an extreme that is in none.
        extremes = array.min().item(), array.max().item()
        if not all(map(kind.range.holds, extremes)):
            return False
    # Without the Python code of `all`, which takes longer for short arrays.
    return kind.kind != "real" or bool(np.logical_and.reduce(np.isfinite(array)))
