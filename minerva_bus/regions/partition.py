"""Partitions: functions from agents to regions, equal in every region."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Final, Protocol, cast
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from minerva_bus.blame import blamed
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import AgentNode, Piece, Scene, agents

_NUMBERS: Final = (int, float)


class Partition(Protocol):
    """Assigns agents to the regions 0 to `count` - 1; it depends on the agent only."""

    @property
    def count(self) -> int:
        """Number of regions."""
        ...

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent."""
        ...

    def regions_of(self, part: Columns) -> NDArray[np.intp]:
        """The regions of agents in columns, shape (n,), equal to those of its rows as nodes."""
        ...


@dataclass(frozen=True, slots=True)
class ById:
    """Regions by a hash of the id: equal loads, and no migration."""

    count: int

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent."""
        return self._of(agent.id)

    def regions_of(self, part: Columns) -> NDArray[np.intp]:
        """The regions of agents in columns."""
        assert part.ids is not None
        return np.array([self._of(name) for name in part.ids.texts()], np.intp)

    def _of(self, name: str) -> int:
        return crc32(name.encode()) % self.count


@dataclass(frozen=True, slots=True)
class ByPosition:
    """Regions as the cells of a grid over two attributes.

    `across` and `down` are the ascending borders between columns and between rows of cells, so
    there are (len(across) + 1) * (len(down) + 1) regions. Outer cells have no outer border. An
    agent without the attributes has a region by its id. `balance`: frames after which borders are
    moved; 0: never.
    """

    across: tuple[float, ...]
    down: tuple[float, ...] = ()
    names: tuple[str, str] = ("x", "y")
    balance: int = 0

    @property
    def count(self) -> int:
        """Number of regions."""
        return (len(self.across) + 1) * (len(self.down) + 1)

    @property
    def attributes(self) -> tuple[str, ...]:
        """The attributes that decide."""
        return self.names if self.down else self.names[:1]

    @property
    def borders(self) -> tuple[float, ...]:
        """All borders, those between columns first."""
        return self.across + self.down

    def moved(self, borders: Sequence[float]) -> ByPosition:
        """The partition with other borders. Raises ValueError for another number of them."""
        across = len(self.across)
        _check_number(borders, across + len(self.down))
        return replace(self, across=tuple(borders[:across]), down=tuple(borders[across:]))

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent."""
        values = [agent.state.get(name) for name in self._both]
        # Not isinstance, because a bool is no coordinate, in columns neither.
        if any(type(value) not in _NUMBERS for value in values):
            return ById(self.count).region_of(agent)
        x, y = map(float, cast("list[float]", values))
        column, row = bisect_right(self.across, x), bisect_right(self.down, y)
        return row * (len(self.across) + 1) + column

    def regions_of(self, part: Columns) -> NDArray[np.intp]:
        """The regions of agents in columns."""
        has_both = all(name in part.names for name in self._both)
        if not has_both or any(part.column(name).dtype.kind not in "if" for name in self._both):
            return ById(self.count).regions_of(part)
        x, y = (part.column(name) for name in self._both)
        columns = np.searchsorted(np.array(self.across), x, side="right")
        rows = np.searchsorted(np.array(self.down), y, side="right")
        return rows * (len(self.across) + 1) + columns

    @property
    def _both(self) -> tuple[str, str]:
        # A grid of one row needs the first attribute only.
        return self.names if self.down else (self.names[0], self.names[0])


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
        """Its border, then those of its parts."""
        parts = [part.borders for part in (self.below, self.above) if part is not None]
        return (self.at, *chain.from_iterable(parts))

    def moved(self, borders: Iterator[float]) -> Split:
        """It with other borders, in the order of `borders`."""
        at = next(borders)
        below = None if self.below is None else self.below.moved(borders)
        above = None if self.above is None else self.above.moved(borders)
        return Split(self.name, at, below, above)


@dataclass(frozen=True, slots=True)
class ByTree:
    """Regions as the rectangles of a tree of splits, in its order: `below` before `above`.

    Outer rectangles have no outer border. An agent without the attributes has a region by its id.
    `balance`: frames after which borders are moved; 0: never.
    """

    root: Split
    balance: int = 0

    @property
    def count(self) -> int:
        """Number of regions."""
        return self.root.leaves

    @property
    def attributes(self) -> tuple[str, ...]:
        """The attributes that decide."""
        return tuple(sorted(self.root.names))

    @property
    def borders(self) -> tuple[float, ...]:
        """All borders: of a split, then of its parts."""
        return self.root.borders

    def moved(self, borders: Sequence[float]) -> ByTree:
        """The partition with other borders. Raises ValueError for another number of them."""
        _check_number(borders, len(self.borders))
        return replace(self, root=self.root.moved(iter(borders)))

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent."""
        if any(type(agent.state.get(name)) not in _NUMBERS for name in self.root.names):
            return ById(self.count).region_of(agent)
        split, first = self.root, 0
        while True:
            # As floats, like in columns: an int may lie between two of them.
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


def _check_number(borders: Sequence[float], expected: int) -> None:
    if len(borders) != expected:
        raise ValueError(f"{len(borders)} borders; expected {expected}")


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


@dataclass(frozen=True, slots=True)
class ByFunction:
    """Regions by a function of the user, which takes an agent's id and its attributes."""

    count: int
    function: Callable[[str, Any], object]

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent. Raises MisuseError for a number that is no region."""
        with blamed(self.function):
            region = self.function(agent.id, agent.state)
        if type(region) is not int or not 0 <= region < self.count:
            name = getattr(self.function, "__name__", "the function")
            raise MisuseError(
                f"regions: {name} returned {region!r:.40} for #{agent.id};"
                f" expected an integer from 0 to {self.count - 1}"
            )
        return region

    def regions_of(self, part: Columns) -> NDArray[np.intp]:
        """The regions of agents in columns."""
        nodes = [node for node in part.nodes() if isinstance(node, AgentNode)]
        return np.array([self.region_of(node) for node in nodes], np.intp)


def regions_of(partition: Partition, piece: Piece) -> NDArray[np.intp] | None:
    """The regions of the nodes of a piece, by their first agents; None without agents."""
    if piece.ids is not None:
        assert isinstance(piece, Columns)
        return partition.regions_of(piece)
    first = None if piece.still else next(agents(Scene((piece,))), None)
    return None if first is None else np.array([partition.region_of(first)], np.intp)
