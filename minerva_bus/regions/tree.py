"""A partition by a tree of rectangles, which are smaller where agents are crowded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import inf

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.regions.partition import ById, Cell, check_number, is_coordinate


@dataclass(frozen=True, slots=True)
class Split:
    """A rectangle that is split at a value of an attribute; a part that is None is a region.

    Agents with the value itself are `above`.
    """

    name: str
    at: float
    below: Split | None = None
    above: Split | None = None

    @property
    def leaves(self) -> int:
        """Number of regions in it."""
        return sum(1 if part is None else part.leaves for part in (self.below, self.above))

    @property
    def names(self) -> frozenset[str]:
        """The attributes by which it and its parts are split."""
        parts = [part.names for part in (self.below, self.above) if part is not None]
        return frozenset([self.name]).union(*parts)

    @property
    def borders(self) -> tuple[float, ...]:
        """The border of the split, then those of its parts."""
        parts = [part.borders for part in (self.below, self.above) if part is not None]
        return (self.at, *chain.from_iterable(parts))

    def cells(self, around: Cell) -> Iterator[Cell]:
        """The rectangles of its regions within another one."""
        low, high = around[self.name]
        # A border outside of the rectangle leaves one of both parts empty.
        at = min(max(self.at, low), high)
        for part, bounds in ((self.below, (low, at)), (self.above, (at, high))):
            inside = {**around, self.name: bounds}
            yield from [inside] if part is None else part.cells(inside)

    def moved(self, borders: Iterator[float]) -> Split:
        """The same tree with other borders, in the order of `borders`."""
        at = next(borders)
        below = None if self.below is None else self.below.moved(borders)
        above = None if self.above is None else self.above.moved(borders)
        return Split(self.name, at, below, above)


@dataclass(frozen=True, slots=True)
class ByTree:
    """Regions as the rectangles of a tree of splits, in its order: `below` before `above`.

    Outer rectangles have no outer border. An agent without the attributes has a region by its id.
    `balance`: frames after which borders are moved; 0: never. `by_condition`: events reach only the
    regions where their conditions can hold. `halo`: services with a halo run in each region.
    """

    root: Split
    balance: int = 0
    by_condition: bool = False
    halo: bool = False

    @property
    def count(self) -> int:
        """Number of regions."""
        return self.root.leaves

    @property
    def attributes(self) -> tuple[str, ...]:
        """The attributes that decide."""
        return tuple(sorted(self.root.names))

    @property
    def cells(self) -> list[Cell]:
        """The rectangle of each region."""
        return [*self.root.cells(dict.fromkeys(self.attributes, (-inf, inf)))]

    @property
    def borders(self) -> tuple[float, ...]:
        """All borders: of a split, then of its parts."""
        return self.root.borders

    def moved(self, borders: Sequence[float]) -> ByTree:
        """The partition with other borders. Raises ValueError for another number of them."""
        check_number(borders, len(self.borders))
        return replace(self, root=self.root.moved(iter(borders)))

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent."""
        if not all(is_coordinate(agent.state.get(name)) for name in self.root.names):
            return ById(self.count).region_of(agent)
        split, first = self.root, 0
        while True:
            is_below = float(agent.state[split.name]) < split.at
            part = split.below if is_below else split.above
            first += 0 if is_below else _leaves(split.below)
            if part is None:
                return first
            split = part

    def regions_of(self, part: Columns) -> NDArray[np.intp]:
        """The regions of agents in columns."""
        names = self.root.names
        if not names <= {*part.names} or any(part.column(n).dtype.kind not in "if" for n in names):
            return ById(self.count).regions_of(part)
        regions = np.zeros(part.count, np.intp)
        _descend(self.root, part, np.arange(part.count), 0, regions)
        return regions


def _leaves(part: Split | None) -> int:
    return 1 if part is None else part.leaves


def _descend(
    split: Split | None,
    part: Columns,
    rows: NDArray[np.intp],
    first: int,
    regions: NDArray[np.intp],
) -> None:
    """Set the regions of these rows, which are in a rectangle with the regions from `first` on."""
    if split is None:
        regions[rows] = first
        return
    is_below = part.column(split.name)[rows].astype(np.float64) < split.at
    _descend(split.below, part, rows[is_below], first, regions)
    _descend(split.above, part, rows[~is_below], first + _leaves(split.below), regions)
