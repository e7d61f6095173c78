"""Conversion of values from Python or from texts to a type; see `types`.

Each function returns the same object if it is already in its final form.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final, TypeVar, cast
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.measures import Quantity
from minerva_bus.grammar.scene import DEPTH, MATRIX_CELLS, Array, Scene, Value
from minerva_bus.grammar.traversal import walk

INT_END: Final = 1 << 63
"""The first whole number above those of 64 bits."""


class Unfit(MinervaError):
    """A value does not fit a type: the message names what was expected, `attribute` the field."""

    attribute: str = ""


def to_float(value: Any) -> float | None:
    """A float64; infinity for an int beyond its range, None if the value is not a number."""
    # A bool is an int in Python, but not a number here.
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    try:
        return float(cast("float", value))
    except OverflowError:
        return math.inf


def to_int(value: Any) -> int:
    """A whole number of 64 bits. Raises Unfit."""
    # Below 2^53 every whole float64 is one exact integer.
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise Unfit(f"a whole number, not {shown(value)}")
    number = int(cast("int", value))
    if not -INT_END <= number < INT_END:
        raise Unfit("a whole number of at most 64 bits")
    return number


def to_text(value: Any) -> str:
    """A text that can be encoded in UTF-8. Raises Unfit."""
    if not isinstance(value, str):
        raise Unfit(f"a text, not {shown(value)}")
    if not value.isascii():
        try:
            value.encode()
        except UnicodeEncodeError:
            raise Unfit("a text without lone surrogates") from None
    # A subclass of str may have its own comparison and text.
    return value if type(value) is str else str.__str__(value)


def to_bool(value: Any) -> bool:
    """A bool, also from numpy. Raises Unfit."""
    if not isinstance(value, bool | np.bool_):
        raise Unfit(f"true or false, not {shown(value)}")
    return bool(cast("bool", value))


def converted(kind: str, items: tuple[Any, ...]) -> tuple[Value, ...] | None:
    """Items of a type of numbers or texts; None if each has to be converted by itself.

    Fast for long lists, and the same tuple if all items already are of the type.
    """
    types = set(map(type, items))
    if not types:
        return items
    if kind == "text":
        return items if types == {str} and all(map(str.isascii, items)) else None
    if kind == "int":
        fits = types == {int} and min(items) >= -INT_END and max(items) < INT_END
        return items if fits else None
    if kind != "real" or not types <= {float, int}:
        return None
    try:
        reals = items if types == {float} else tuple(map(float, items))
    except OverflowError:
        return None
    return reals if all(map(math.isfinite, reals)) else None


def to_string(value: Any) -> Scene:
    """A string of L(M) that is valid as a value in braces. Raises Unfit."""
    if not isinstance(value, Scene):
        raise Unfit(f"a string in braces, not {shown(value)}")
    return shallow(value)


_V = TypeVar("_V", bound=Value)


def shallow(value: _V) -> _V:
    """The value, if lists and strings are nested in it no deeper than a text may nest them.

    Raises Unfit. Values are printed and compared recursively, so their depth is limited.
    """
    level: list[Value] = [value]
    for _ in range(DEPTH):
        # By identity: an item that occurs many times would otherwise be visited once for each path
        # to it, and nesting makes these paths exponentially many.
        within = {id(item): item for outer in level for item in _inside(outer)}
        level = [item for item in within.values() if isinstance(item, tuple | Scene)]
        if not level:
            return value
    raise Unfit(f"a value nested at most {DEPTH} deep")


def _inside(value: Value) -> Iterable[Value]:
    if isinstance(value, Scene):
        return (item for opens, node in walk(value) if opens for item in node.values)
    return value if isinstance(value, tuple) else ()


def to_cells(value: Any) -> Array:
    """A read-only int16 matrix. Raises Unfit."""
    matrix = _matrix(value, "iub", "a matrix of whole numbers")
    if matrix.dtype == np.int16:
        return _frozen(matrix)
    cells = matrix.astype(np.int16)
    # Values beyond 16 bits have changed.
    if not (cells == matrix).all():
        raise Unfit("a matrix of whole numbers of 16 bits")
    return _frozen(cells)


def to_reals(value: Any) -> Array:
    """A read-only float64 matrix. Raises Unfit."""
    if _finite and _finite.get(id(value)) is value and not value.flags.writeable:
        return cast("Array", value)
    matrix = _matrix(value, "iubf", "a matrix of numbers")
    reals = matrix if matrix.dtype == np.float64 else matrix.astype(np.float64)
    if not np.isfinite(reals).all():
        raise Unfit("a matrix of finite numbers")
    frozen = _frozen(reals)
    if frozen.size > _SMALL:
        _finite[id(frozen)] = frozen
    return frozen


_finite: WeakValueDictionary[int, Array] = WeakValueDictionary()
"""Large read-only matrices by their address: a frame may check each several times."""

_SMALL: Final = 4096
"""Numbers that take less time to check again than to remember."""


def _matrix(value: Any, kinds: str, wanted: str) -> NDArray[Any]:
    matrix: NDArray[Any] = value
    if not isinstance(value, np.ndarray) or matrix.ndim != 2:
        raise Unfit(f"a matrix RxC[...], not {shown(value)}")
    if matrix.dtype.kind not in kinds:
        raise Unfit(wanted)
    # The text of a matrix has at most nine digits for its rows and its columns.
    if matrix.size > MATRIX_CELLS or max(matrix.shape) >= 10**9:
        raise Unfit(f"a matrix of at most {MATRIX_CELLS} cells")
    return matrix


def _frozen(matrix: NDArray[Any]) -> NDArray[Any]:
    """The same matrix if its memory is read-only, otherwise a copy."""
    # A read-only view can still be changed through the writable array that it views.
    owner: object = matrix
    while isinstance(owner, np.ndarray) and not owner.flags.writeable:
        owner = owner.base
    immutable = owner is None or isinstance(owner, bytes)
    if immutable and type(matrix) is np.ndarray and matrix.flags.c_contiguous:
        return matrix
    copy = np.array(matrix, order="C")
    copy.flags.writeable = False
    return copy


def shown(value: Any) -> str:
    """A value as shown in messages."""
    if isinstance(value, str | int | float | bool):
        return repr(value)[:40]
    if isinstance(value, Quantity):
        return f"{value.number:g} {value.unit}"
    if isinstance(value, Scene):
        return "a string"
    if isinstance(value, np.ndarray):
        return "a matrix"
    return "a list" if isinstance(value, tuple | list) else f"a {type(value).__name__}"
