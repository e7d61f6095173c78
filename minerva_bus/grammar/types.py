"""Types of parameters, attributes and event data, with their units and limits.

| text              | in Python                                    | value                         |
|-------------------|----------------------------------------------|-------------------------------|
| `bool`            | `bool`                                       | True, False                   |
| `int`             | `int`                                        | 64 bits, signed               |
| `real`, `real m`  | `float`, `Metres`, ...                       | a finite float64 in that unit |
| `text`            | `str`                                        | UTF-8                         |
| `text a|b`        | `Literal["a", "b"]`                          | one of these words            |
| `real m/s 0..`    | `Annotated[MetresPerSecond, Range(least=0)]` | a number from 0 up            |
| `int 1..6`        | `Annotated[int, Range(1, 6)]`                | a number from 1 to 6          |
| `text of P.name`  | `Annotated[str, Of("P", "name")]`            | a `name` of a P in the string |
| `list of TYPE`    | `tuple[X, ...]`                              | a tuple                       |
| `cells`           | `Cells`                                      | a read-only int16 matrix      |
| `matrix`          | `Reals`                                      | a read-only float64 matrix    |
| `string`          | `Scene`                                      | a string of L(M)              |

A parameter is declared and stored in one unit; a text may use another unit of the same dimension
(`dist=150cm` for a parameter in metres). Ranges and sources (`of`) are for data of event types. A
range is checked wherever an event is created. Only the coordinator knows the string, so it checks
sources, for orders of people.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, replace
from itertools import chain, islice
from numbers import Real
from operator import is_
from typing import Annotated, Any, Final, Literal, TypeAlias, TypeVar, cast, get_args, get_origin
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MinervaError, MisuseError, nearest
from minerva_bus.grammar.appearance import Form
from minerva_bus.grammar.scene import DEPTH, MATRIX_CELLS, Array, Scene, Value, walk

# --- units and limits ---

# unit → (dimension, a, b): one unit is a/b of the dimension's first unit. Two integers, so that
# 57cm is the float64 nearest to 57/100 m, which 57·0.01 is not.
_UNITS: dict[str, tuple[str, float, float]] = {
    "m": ("length", 1, 1),
    "km": ("length", 1000, 1),
    "cm": ("length", 1, 100),
    "mm": ("length", 1, 1000),
    "deg": ("angle", 1, 1),
    "°": ("angle", 1, 1),
    "rad": ("angle", 180, math.pi),
    "s": ("time", 1, 1),
    "ms": ("time", 1, 1000),
    "min": ("time", 60, 1),
    "h": ("time", 3600, 1),
    "m/s": ("speed", 1, 1),
    "km/h": ("speed", 10, 36),
    "cm/s": ("speed", 1, 100),
    "deg/s": ("turning", 1, 1),
    "rad/s": ("turning", 180, math.pi),
    "Hz": ("frequency", 1, 1),
    "kg": ("mass", 1, 1),
    "g": ("mass", 1, 1000),
}


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of measure by its symbol, for `Annotated[float, Unit("m")]`."""

    symbol: str

    def __post_init__(self) -> None:
        if self.symbol not in _UNITS:
            raise MisuseError(f"unknown unit {self.symbol!r}; expected one of {', '.join(_UNITS)}")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with a unit as in the text, not converted yet."""

    number: float
    unit: str

    def into(self, unit: str) -> float | None:
        """The number in another unit, or None if the dimensions differ."""
        own, wanted = _UNITS.get(self.unit), _UNITS.get(unit)
        if own is None or wanted is None or own[0] != wanted[0]:
            return None
        if self.unit == unit:
            return self.number
        return self.number * (own[1] * wanted[2]) / (own[2] * wanted[1])


_BETWEEN: Final = ".."
_SYMBOL: Final = re.compile(r"[PTA][A-Za-z0-9_]*")
_PARAMETER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers from `least` to `most`, both included, in the unit of the type.

    Raises:
        MisuseError: there is no such number, or no limit at all.

    Example:
        `eSpeed = EventType("eSpeed", speed=Annotated[MetresPerSecond, Range(least=0)])`

    """

    least: float = -math.inf
    most: float = math.inf

    def __post_init__(self) -> None:
        for end in (self.least, self.most):
            if isinstance(end, bool) or not isinstance(end, Real):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise MisuseError(f"an end of a range must be a number, not {end!r:.60}")
        if not self.least <= self.most or (math.isinf(self.least) and math.isinf(self.most)):
            raise MisuseError(
                f"invalid range {self}; expected a minimum, a maximum, or both in this order"
            )

    def __str__(self) -> str:
        least, most = (_end_text(end) for end in (self.least, self.most))
        return f"{least}{_BETWEEN}{most}"

    @property
    def words(self) -> str:
        """The range in words, for messages."""
        if math.isinf(self.most):
            return f"from {_end_text(self.least)} up"
        if math.isinf(self.least):
            return f"up to {_end_text(self.most)}"
        return f"from {_end_text(self.least)} to {_end_text(self.most)}"

    def holds(self, number: float) -> bool:
        """Whether a number lies in it."""
        return self.least <= number <= self.most


def parse_range(text: str) -> Range | None:
    """The range in a text such as `0..`; None for a text without `..`. Raises MisuseError."""
    least, between, most = text.partition(_BETWEEN)
    if not between:
        return None
    try:
        return Range(float(least or "-inf"), float(most or "inf"))
    except ValueError:
        raise MisuseError(f"invalid range {text!r}; expected 0.., ..6 or 0..6") from None


def _end_text(end: float) -> str:
    return "" if math.isinf(end) else repr(float(end)).removesuffix(".0")


@dataclass(frozen=True, slots=True)
class Of:
    """The values that a parameter of a symbol has in the world's string: a limit of texts.

    Attributes:
        symbol: name of a primitive, transformation or agent kind.
        parameter: name of its parameter or attribute.

    Raises:
        MisuseError: one of them is not a name.

    Example:
        `eObjective = EventType("eObjective", marker=Annotated[str, Of("PMarker", "name")])`

    """

    symbol: str
    parameter: str

    def __post_init__(self) -> None:
        if not (_SYMBOL.fullmatch(self.symbol) and _PARAMETER.fullmatch(self.parameter)):
            raise MisuseError(
                f"invalid source of texts {self}; expected SYMBOL.parameter, such as PMarker.name"
            )

    def __str__(self) -> str:
        return f"{self.symbol}.{self.parameter}"


def parse_of(text: str) -> Of:
    """The source of texts that `SYMBOL.parameter` names. Raises MisuseError."""
    symbol, _, parameter = text.partition(".")
    return Of(symbol, parameter)


# --- values from Python or from texts; each function returns the same object if it is final ---

INT_END: Final = 1 << 63
"""The first whole number above those of 64 bits."""


class Unfit(MinervaError):
    """A value does not fit a type: the message names what was expected, `attribute` the field."""

    attribute: str = ""


def to_float(value: Any) -> float | None:
    """A float64; infinity for an int beyond its range, None if the value is not a number."""
    # A bool is an int in Python, but not a number here.
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
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
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
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
    if not isinstance(value, (bool, np.bool_)):
        raise Unfit(f"true or false, not {shown(value)}")
    return bool(cast("bool", value))


def converted(kind: str, items: tuple[Any, ...]) -> tuple[Value, ...] | None:
    """Items of a scalar type; None if each has to be converted by itself.

    Fast for long lists, and the same tuple if all items already are of the type.
    """
    types = set(map(type, items))
    if not types:
        return items
    if kind == "text":
        return items if types == {str} and all(map(str.isascii, items)) else None
    if kind == "bool":
        return items if types == {bool} else None
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
        level = [item for item in within.values() if isinstance(item, (tuple, Scene))]
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


_UNQUOTED: Final = re.compile(r"[-+]?\.?[0-9][0-9.e+-]*\s*[A-Za-z°/]*|true|false|\[.*\]|\{.*\}")
"""Texts that are values of another type without their quotes."""


def shown(value: Any) -> str:
    """A value as shown in messages."""
    if isinstance(value, (str, int, float, bool)):
        hint = ": write it without quotes" if _UNQUOTED.fullmatch(str(value)) else ""
        return repr(value)[:40] + (hint if isinstance(value, str) else "")
    if isinstance(value, Quantity):
        return f"{value.number:g} {value.unit}"
    if isinstance(value, Scene):
        return "a string"
    if isinstance(value, np.ndarray):
        return "a matrix"
    return "a list" if isinstance(value, (tuple, list)) else f"a {type(value).__name__}"


# --- types ---

Metres = Annotated[float, Unit("m")]
Degrees = Annotated[float, Unit("deg")]
Seconds = Annotated[float, Unit("s")]
MetresPerSecond = Annotated[float, Unit("m/s")]
Cells: TypeAlias = NDArray[np.int16]
Reals: TypeAlias = NDArray[np.float64]

_Number = TypeVar("_Number", int, float)
_WORD = re.compile(r"[A-Za-z0-9_-]+")
_BAR = "|"
_KINDS = ("bool", "int", "real", "text", "cells", "matrix", "string")


@dataclass(frozen=True, slots=True)
class Type:
    """A type of values: its kind, the unit of a real, the items' type of a list.

    `words` are the allowed texts; empty allows any. `range` limits a number, and `of` names the
    source of texts in the string.
    """

    kind: str
    unit: str = ""
    item: Type | None = None
    words: tuple[str, ...] = ()
    range: Range | None = None
    of: Of | None = None

    def __str__(self) -> str:
        if self.item is not None:
            return f"list of {self.item}"
        parts = [self.kind, self.unit, _BAR.join(self.words), f"of {self.of}" if self.of else ""]
        return " ".join(part for part in [*parts, str(self.range or "")] if part)

    def fit(self, value: Any) -> Value:
        """The value converted to this type; the same object if it already is of this type.

        Raises Unfit.
        """
        kind = self.kind
        if kind == "real":
            is_real = type(value) is float and math.isfinite(value)
            number = value if is_real else self._real(value)
            return number if self.range is None else self.check_range(number)
        if kind == "list":
            return self._list(value)
        fitted = self._word(value) if self.words else _FITS[kind](value)
        return fitted if self.range is None else self.check_range(cast("int", fitted))

    def check_range(self, number: _Number) -> _Number:
        """The number, if it lies in the range. Raises Unfit."""
        if self.range is None or self.range.holds(number):
            return number
        unit = f" in {self.unit}" if self.unit else ""
        raise Unfit(f"a number{unit} {self.range.words}, not {shown(number)}")

    def _real(self, value: Any) -> float:
        wanted = f"a number in {self.unit}" if self.unit else "a number"
        number = to_float(value.into(self.unit) if isinstance(value, Quantity) else value)
        if number is None:
            raise Unfit(f"{wanted}, not {shown(value)}")
        if not math.isfinite(number):
            raise Unfit(f"a finite {wanted.removeprefix('a ')}, not {shown(value)}")
        return number

    def _word(self, value: Any) -> str:
        word = to_text(value)
        if word not in self.words:
            near = nearest(word, list(self.words))
            raise Unfit(f"one of {', '.join(self.words)}, not {word!r:.40}{near}")
        return word

    def _list(self, value: Any) -> tuple[Value, ...]:
        item = cast("Type", self.item)
        if not isinstance(value, (tuple, list)):
            raise Unfit(f"a {self}, not {shown(value)}")
        items = cast(
            "tuple[Any, ...]",
            value if isinstance(value, tuple) else tuple(cast("list[Any]", value)),
        )
        if not item.words and item.range is None:
            fitted = converted(item.kind, items)
            if fitted is not None:
                return fitted
        if item.kind == "list" and not item.holds_strings:
            return item._lists(items)
        fitted = tuple([item.fit(element) for element in items])
        # The same tuple, so that an unchanged value is recognized by identity.
        fitted = items if all(map(is_, fitted, items)) else fitted
        return shallow(fitted) if self.holds_strings else fitted

    def _lists(self, lists: tuple[Any, ...]) -> tuple[Value, ...]:
        """Lists of this type, fitted as if they were a single one. Raises Unfit.

        A call for each of tens of thousands of short lists would delay a frame.
        """
        if not {tuple, list}.issuperset(map(type, lists)):
            return tuple([self.fit(each) for each in lists])
        flat = tuple(chain.from_iterable(lists))
        fitted = self._list(flat)
        # The same objects, so that an unchanged value is recognized by identity.
        if fitted is flat and {tuple}.issuperset(map(type, lists)):
            return lists
        rest = iter(fitted)
        return tuple([tuple(islice(rest, len(each))) for each in lists])

    @property
    def source(self) -> Of | None:
        """The source of its texts, or of those of its items, in the string."""
        return self.of if self.item is None else self.item.source

    @property
    def holds_strings(self) -> bool:
        """Whether values of this type may contain strings of L(M)."""
        return self.kind == "string" or (self.item is not None and self.item.holds_strings)


_FITS: dict[str, Callable[[Any], Value]] = {
    "int": to_int,
    "text": to_text,
    "bool": to_bool,
    "string": to_string,
    "cells": to_cells,
    "matrix": to_reals,
}


def parse_type(text: str) -> Type:
    """The type that a text such as `real m` or `list of text` names. Raises MisuseError."""
    words = text.split()
    # Bounds the recursion below.
    if len(words) > 2 * DEPTH:
        raise MisuseError(f"lists can be nested at most {DEPTH} deep")
    if words[:2] == ["list", "of"]:
        return Type("list", item=parse_type(" ".join(words[2:])))
    # A range is the last word; without it, the rest is a type as well.
    if len(words) > 1 and words[0] in ("real", "int") and (limits := parse_range(words[-1])):
        return replace(parse_type(" ".join(words[:-1])), range=limits)
    if words[:2] == ["text", "of"] and len(words) == 3:
        return Type("text", of=parse_of(words[2]))
    if len(words) == 2 and words[0] == "real":
        return Type("real", Unit(words[1]).symbol)
    if len(words) == 2 and words[0] == "text":
        return _one_of(tuple(words[1].split(_BAR)))
    if len(words) == 1 and words[0] in _KINDS:
        return Type(words[0])
    raise MisuseError(
        f"unknown type {text!r}; expected {', '.join(_KINDS)}, list of TYPE, real UNIT,"
        " text WORD|WORD, text of SYMBOL.parameter, or a number type with a range, such as"
        " real UNIT 0.."
    )


def _one_of(words: tuple[Any, ...]) -> Type:
    """The type of texts that are one of these. Raises MisuseError."""
    for word in words:
        if not isinstance(word, str) or not _WORD.fullmatch(word):
            raise MisuseError(
                f"invalid word {word!r} of a text type; expected letters, digits, _ and -"
            )
    if len(set(words)) != len(words):
        raise MisuseError(f"the words of a text type must be distinct: {', '.join(words)}")
    return Type("text", words=words)


_BY_ANNOTATION: dict[Any, Type] = {
    bool: Type("bool"),
    int: Type("int"),
    float: Type("real"),
    str: Type("text"),
    Scene: Type("string"),
    Cells: Type("cells"),
    Reals: Type("matrix"),
}


def type_of(annotation: Any) -> Type:
    """The type of a Python annotation (see the table above). Raises MisuseError."""
    if isinstance(annotation, Type):
        return annotation
    if isinstance(annotation, str):
        return parse_type(annotation)
    # An unhashable annotation would raise TypeError in the lookup.
    if isinstance(annotation, Hashable) and annotation in _BY_ANNOTATION:
        return _BY_ANNOTATION[annotation]
    arguments = get_args(annotation)
    if get_origin(annotation) is Literal:
        return _one_of(arguments)
    if get_origin(annotation) is Annotated:
        return _annotated(type_of(arguments[0]), arguments[1:])
    if get_origin(annotation) is tuple and len(arguments) == 2 and arguments[1] is Ellipsis:
        return Type("list", item=type_of(arguments[0]))
    if isinstance(annotation, Form):
        kind = type(annotation).__name__
        raise MisuseError(
            f"{kind}(...) is not a parameter; give it without a keyword, after the name"
        )
    raise MisuseError(
        f"{annotation!r} is not a parameter type; use bool, int, float, Metres, Degrees, Seconds,"
        " MetresPerSecond, str, Literal of words, Scene, Cells, Reals or tuple[..., ...] of one of"
        " them"
    )


def _annotated(plain: Type, extras: tuple[Any, ...]) -> Type:
    for extra in extras:
        if isinstance(extra, Unit):
            plain = _limited(plain, ("real",), "unit", extra.symbol)
        elif isinstance(extra, Range):
            plain = _limited(plain, ("real", "int"), "range", extra)
        elif isinstance(extra, Of):
            plain = _limited(plain, ("text",), "of", extra)
    return plain


def _limited(plain: Type, kinds: tuple[str, ...], name: str, extra: Any) -> Type:
    if plain.kind not in kinds or plain.words:
        raise MisuseError(f"{extra} is for {' or '.join(kinds)}, not for {plain}")
    return replace(plain, **{name: extra})
