"""Types of parameters, attributes and event data, and conversion of values to them.

| text              | in Python                        | value                                   |
|-------------------|----------------------------------|-----------------------------------------|
| `bool`            | `bool`                           | True, False                             |
| `int`             | `int`                            | 64 bits, signed                         |
| `real`, `real m`  | `float`, `Metres`, ...           | a finite float64 in that unit           |
| `text`            | `str`                            | UTF-8                                   |
| `text a|b`        | `Literal["a", "b"]`              | one of these words                      |
| `real m 0..`      | see `limits`                     | a number in a range                     |
| `text of P.name`  | see `limits`                     | a text that occurs in the string        |
| `list of TYPE`    | `tuple[X, ...]`                  | a tuple                                 |
| `cells`           | `Cells`                          | a read-only int16 matrix (rows, columns)|
| `matrix`          | `Reals`                          | a read-only float64 matrix              |
| `string`          | `Scene`                          | a string of L(M)                        |
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from itertools import chain, islice
from operator import is_
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, cast, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.appearance import Form
from minerva_bus.grammar.conversion import (
    Unfit,
    converted,
    shallow,
    shown,
    to_bool,
    to_cells,
    to_float,
    to_int,
    to_reals,
    to_string,
    to_text,
)
from minerva_bus.grammar.measures import Of, Quantity, Range, Unit, parse_of, parse_range
from minerva_bus.grammar.scene import DEPTH, Scene, Value

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
            raise Unfit(f"one of {', '.join(self.words)}, not {shown(word)}{near}")
        return word

    def _list(self, value: Any) -> tuple[Value, ...]:
        item = cast("Type", self.item)
        if not isinstance(value, tuple | list):
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
