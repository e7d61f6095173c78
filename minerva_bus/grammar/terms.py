"""Terms of conditions: names, values, comparisons and their combinations."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

NUMBER: Final = "a number"
TRUTH: Final = "true or false"
TEXT: Final = "a text"
ANYTHING: Final = "anything"
"""The sort of a name whose values are not known in advance."""

_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_DTYPES: dict[str, str] = {"f": NUMBER, "i": NUMBER, "b": TRUTH, "O": TEXT}
_KINDS: dict[str, str] = {"real": NUMBER, "int": NUMBER, "bool": TRUTH, "text": TEXT}


@dataclass(frozen=True, slots=True)
class Name:
    """The name of an attribute, and its offset in the text."""

    name: str
    offset: int


@dataclass(frozen=True, slots=True)
class Distance:
    """The Euclidean distance between two points of a plane, x and y of each; attributes or numbers.

    It has one rounding for each operation, so it is the same number on every machine and in arrays.
    """

    coordinates: tuple[Name | float, Name | float, Name | float, Name | float]

    def of(self, state: Mapping[str, Any]) -> Any:
        """The distance for an agent; an array of them if the state has arrays."""
        x, y, to_x, to_y = (_real(_in(state, value)) for value in self.coordinates)
        # Attributes of agents may be infinite, or so large that their squares are.
        with np.errstate(over="ignore", invalid="ignore"):
            dx, dy = x - to_x, y - to_y
            squared: Any = dx * dx + dy * dy
            return math.sqrt(squared) if isinstance(squared, float) else np.sqrt(squared)


Value: TypeAlias = Name | Distance | bool | float | str


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison of two values."""

    left: Value
    sign: str
    right: Value

    def truth(self, state: Mapping[str, Any]) -> Any:
        """Whether it holds; an array of bools if the state has arrays."""
        left, right = _in(state, self.left), _in(state, self.right)
        # Beyond 2^53 Python compares an int and a float exactly, but arrays compare them as floats.
        if type(left) is not type(right):
            left, right = (float(v) if type(v) is int else v for v in (left, right))
        return _COMPARE[self.sign](left, right)

    def names(self) -> Iterator[tuple[Name, Value]]:
        """Each name in it, with a value of the sort that it must have."""
        for value, other in ((self.left, self.right), (self.right, self.left)):
            if isinstance(value, Name):
                yield value, other
            elif isinstance(value, Distance):
                yield from ((each, 0.0) for each in value.coordinates if isinstance(each, Name))


def _in(state: Mapping[str, Any], value: Value) -> Any:
    """What a value is for an agent."""
    if isinstance(value, Name):
        return state[value.name]
    return value.of(state) if isinstance(value, Distance) else value


def _real(value: Any) -> Any:
    return float(value) if isinstance(value, int | float) else value.astype(np.float64)


@dataclass(frozen=True, slots=True)
class Not:
    """The negation of a term."""

    term: Term

    def truth(self, state: Mapping[str, Any]) -> Any:
        """Like `Comparison.truth`."""
        # `not` for a bool as well as for an array.
        return self.term.truth(state) ^ True


@dataclass(frozen=True, slots=True)
class Joined:
    """Terms of which all must hold (`and`), or at least one (`or`)."""

    word: str
    terms: tuple[Term, ...]

    def truth(self, state: Mapping[str, Any]) -> Any:
        """Like `Comparison.truth`."""
        result: Any = self.terms[0].truth(state)
        for term in self.terms[1:]:
            truth = term.truth(state)
            # Operators that exist for bools and arrays alike; terms have no side effects to skip.
            result = result & truth if self.word == "and" else result | truth
        return result


Term: TypeAlias = Comparison | Not | Joined


def sort_in(value: Value, sort_of: Callable[[str], str]) -> str:
    """The sort of a value; `sort_of` gives that of an attribute."""
    return sort_of(value.name) if isinstance(value, Name) else value_sort(value)


def sort_of_kind(kind: str) -> str:
    """The sort of values of a type's kind; empty if they cannot be compared."""
    return _KINDS.get(kind, "")


def value_sort(value: object) -> str:
    """The sort of a value, or of an array's values; empty if they cannot be compared."""
    if isinstance(value, Distance):
        return NUMBER
    if isinstance(value, np.ndarray):
        array = cast("NDArray[Any]", value)
        return _DTYPES.get(array.dtype.kind, "") if array.ndim == 1 else ""
    if isinstance(value, bool):
        return TRUTH
    if isinstance(value, str):
        return TEXT
    return NUMBER if isinstance(value, int | float) else ""
