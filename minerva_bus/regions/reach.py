"""Reach of events: the regions in which the condition of an event can hold.

Regions by position know nothing of agents in other cells, but all of these have their attributes
within the cell. A condition such as `x > 3 and x < 7` or `distance(x, y, 3, 4) < 2` therefore
excludes cells. It has to compare each attribute of the partition with a number, or have it in a
distance: it then does not hold for agents without these attributes, which may be in any region.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, sqrt
from typing import Final, TypeAlias

from minerva_bus.errors import WorldStopped
from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.condition import parse_condition
from minerva_bus.grammar.scene import Piece, Scene, agents
from minerva_bus.grammar.terms import Comparison, Distance, Joined, Name, Not, Term, Value
from minerva_bus.regions.partition import ByPosition, Cell, Partition
from minerva_bus.regions.tree import ByTree

_Possible: TypeAlias = tuple[bool, bool]
"""Whether a term can be true somewhere in a cell, and whether it can be false."""

_UNKNOWN: Final = True, True
_MIRRORED: Final = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}


@dataclass(slots=True)
class Reach:
    """The regions that events of one region have to reach."""

    partition: ByPosition | ByTree
    _cells: Sequence[Cell] = field(init=False)

    def __post_init__(self) -> None:
        self._cells = self.partition.cells

    def regions_for(self, text: str) -> Sequence[int]:
        """The regions in which a condition can hold for an agent; all without a condition."""
        condition = parse_condition(text)
        everywhere = range(len(self._cells))
        compared = {name for each in condition.comparisons for name in _compared(each)}
        if condition.term is None or not compared.issuperset(self.partition.attributes):
            return everywhere
        term = condition.term
        return [number for number in everywhere if _possible(term, self._cells[number])[0]]


def reach_of(partition: Partition) -> Callable[[str], Sequence[int]]:
    """The regions that an event without receivers reaches, by its condition."""
    if isinstance(partition, ByPosition | ByTree) and partition.by_condition:
        return Reach(partition).regions_for
    everywhere = range(partition.count)
    return lambda _: everywhere


def check_reach(partition: Partition, composition: Composition) -> None:
    """Raise WorldStopped if an agent may be outside of the cell of its region.

    A transformation or an agent moves with the agents in it, whose own place may be anywhere.
    """
    if not (isinstance(partition, ByPosition | ByTree) and partition.by_condition):
        return
    pieces = composition.scene.pieces
    if composition.count > sum(_first_agents(piece) for piece in pieces):
        raise WorldStopped(
            'regions: reach = "condition" cannot find agents within other agents, or several in one'
            " transformation, because they are not divided by their own position; expected a"
            ' string without them, or reach = "everywhere"'
        )


def _first_agents(piece: Piece) -> int:
    if piece.ids is not None:
        return piece.count
    return int(not piece.still and next(agents(Scene((piece,))), None) is not None)


def _compared(comparison: Comparison) -> list[str]:
    return [name.name for name, value in comparison.names() if _is_number(value)]


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _possible(term: Term, cell: Cell) -> _Possible:
    if isinstance(term, Not):
        can_hold, can_fail = _possible(term.term, cell)
        return can_fail, can_hold
    if isinstance(term, Joined):
        parts = [_possible(part, cell) for part in term.terms]
        holds, fails = [part[0] for part in parts], [part[1] for part in parts]
        return (all(holds), any(fails)) if term.word == "and" else (any(holds), all(fails))
    return _of_comparison(term, cell)


def _of_comparison(term: Comparison, cell: Mapping[str, tuple[float, float]]) -> _Possible:
    name, sign, value = term.left, term.sign, term.right
    if isinstance(value, Name | Distance):
        name, sign, value = value, _MIRRORED[sign], name
    if isinstance(name, Distance) and _is_number(value):
        return _of_distance(name, sign, float(value), cell)  # pyright: ignore[reportArgumentType]
    if not isinstance(name, Name) or name.name not in cell or not _is_number(value):
        return _UNKNOWN
    low, high = cell[name.name]
    number = float(value)  # pyright: ignore[reportArgumentType]
    # The last cell also has infinity itself, which is not above it.
    is_last = high == inf
    above, at = number < high or is_last, low <= number and (number < high or is_last)
    possible = {
        "<": (low < number, above),
        "<=": (low <= number, above),
        ">": (above, low <= number),
        ">=": (above, low < number),
        "==": (at, True),
        "!=": (True, at),
    }[sign]
    # It also has agents whose attribute is not a number (NaN), for which no comparison holds.
    return (possible[0], True) if is_last else possible


def _of_distance(distance: Distance, sign: str, number: float, cell: Cell) -> _Possible:
    """Rounding preserves order, so the distances of agents lie between those of the bounds."""
    bounds = [_bounds(value, cell) for value in distance.coordinates]
    gaps = [_gap(*pair) for pair in zip(bounds[:2], bounds[2:], strict=True)]
    low, high = (sqrt(dx * dx + dy * dy) for dx, dy in zip(*gaps, strict=True))
    can_hold = {
        "<": low < number,
        "<=": low <= number,
        ">": high > number,
        ">=": high >= number,
        "==": low <= number <= high,
        "!=": True,
    }[sign]
    # An unbounded coordinate may also not be a number (NaN), for which no comparison holds.
    if not isfinite(high):
        return can_hold, True
    can_fail = {
        "<": high >= number,
        "<=": high > number,
        ">": low <= number,
        ">=": low < number,
        "==": True,
        "!=": low <= number <= high,
    }[sign]
    return can_hold, can_fail


def _bounds(value: Name | float, cell: Cell) -> tuple[float, float]:
    if isinstance(value, Name):
        return cell.get(value.name, (-inf, inf))
    return (float(value), float(value)) if isfinite(value) else (-inf, inf)


def _gap(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    """The least and the greatest distance between numbers of two intervals."""
    apart = max(first[0] - second[1], second[0] - first[1], 0.0)
    return apart, max(first[1] - second[0], second[1] - first[0])
