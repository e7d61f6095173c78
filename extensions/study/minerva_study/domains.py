"""What bounds a search: the domains of values, and the extent of strings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from minerva_bus.errors import MisuseError, SceneError
from minerva_bus.grammar.parser import parse_value
from minerva_bus.grammar.scene import FigureNode, Scene, Value, walk
from minerva_bus.grammar.types import Type, Unfit
from minerva_bus.launch.assignment import typed_value


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
            return _range(typed_value(low, kind), typed_value(high, kind))
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
        listed: Any = parse_value(f"[{text}]")
        return tuple([kind.fit(value) for value in listed])
    except SceneError:
        return tuple([typed_value(part, kind) for part in text.split(",")])


@dataclass(frozen=True, slots=True)
class Extent:
    """The number of nodes of a string, and their maximum depth."""

    nodes: int
    depth: int

    def within(self, other: Extent) -> bool:
        """Whether neither number exceeds that of the other extent."""
        return self.nodes <= other.nodes and self.depth <= other.depth

    def joined(self, other: Extent) -> Extent:
        """The maximum of each number."""
        return Extent(max(self.nodes, other.nodes), max(self.depth, other.depth))


def extent(scene: Scene) -> Extent:
    """The extent of a string."""
    nodes = depth = deepest = 0
    for opens, node in walk(scene):
        nodes += opens
        deepest = max(deepest, depth + 1) if opens else deepest
        if not isinstance(node, FigureNode):
            depth += 1 if opens else -1
    return Extent(nodes, deepest)
