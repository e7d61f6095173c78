"""Domains of parameters: a range, a choice, or all values of the type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from minerva_bus.errors import GrammarError, MisuseError, SceneError
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Value
from minerva_bus.grammar.types import Type


@dataclass(frozen=True, slots=True)
class Interval:
    """All numbers from `low` to `high`, inclusive, in the parameter's unit."""

    low: float
    high: float

    @property
    def width(self) -> float:
        """The distance between the ends."""
        return self.high - self.low

    def nearest(self, number: Any) -> Any:
        """The number of the range that is nearest to a number."""
        return min(max(number, self.low), self.high)


@dataclass(frozen=True, slots=True)
class OneOf:
    """These values and no others."""

    values: tuple[Value, ...]


Domain: TypeAlias = Interval | OneOf | None


def parse_domain(text: str, kind: Type, owner: str) -> Interval | OneOf:
    """The domain in a text such as `-2:2`, `-90deg:1rad` or `slow,fast`, for a type.

    Raises MisuseError, which begins with `owner`.
    """
    try:
        low, colon, high = text.partition(":")
        if colon and kind.kind in ("real", "int"):
            return _range(parse_value(low, kind), parse_value(high, kind))
        return OneOf(_values(text, kind))
    except Unfit as unfit:
        raise MisuseError(f"{owner}={text}: expected {unfit}") from None


def _range(low: Any, high: Any) -> Interval:
    if not low <= high:
        raise Unfit("a lower end that is at most the upper end")
    # Steps are proportional to the width, which must be finite.
    if high - low == float("inf"):
        raise Unfit("a range of finite width")
    return Interval(low, high)


def _values(text: str, kind: Type) -> tuple[Value, ...]:
    """Values separated by commas, as in a list of a string; texts need no quotes."""
    try:
        return tuple([kind.fit(value) for value in _read(f"[{text}]")])
    except SceneError:
        return tuple([parse_value(part, kind) for part in text.split(",")])


def parse_value(text: str, kind: Type) -> Value:
    """The value of a type that a text represents; texts need no quotes. Raises Unfit."""
    text = text.strip()
    if kind.kind == "text" and not text.startswith('"'):
        return kind.fit(text)
    try:
        return kind.fit(_read(text))
    except SceneError:
        raise Unfit(f"a value of the type {kind}, not {text!r}") from None


def _read(text: str) -> Any:
    """The single value that a text represents in a string. Raises SceneError."""
    # Any symbol will do, because the parser knows no vocabulary.
    nodes = parse(f"PAny<any={text}>").nodes
    if len(nodes) != 1 or len(nodes[0].values) != 1:
        raise GrammarError(f"{text!r} is not one value")
    return nodes[0].values[0]
