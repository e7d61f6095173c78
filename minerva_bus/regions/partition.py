"""Partitions: functions from agents to regions, equal in every region."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from typing import Any, Protocol, TypeAlias, TypeGuard
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from minerva_bus.blame import blamed
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import AgentNode, Piece, Scene, agents

Cell: TypeAlias = Mapping[str, tuple[float, float]]
"""Bounds of attributes: the least value, and the one above all values."""


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
    moved; 0: never. `by_condition`: events reach only the regions where their conditions can hold.
    `halo`: services with a halo run in each region.
    """

    across: tuple[float, ...]
    down: tuple[float, ...] = ()
    names: tuple[str, str] = ("x", "y")
    balance: int = 0
    by_condition: bool = False
    halo: bool = False

    @property
    def count(self) -> int:
        """Number of regions."""
        return (len(self.across) + 1) * (len(self.down) + 1)

    @property
    def attributes(self) -> tuple[str, ...]:
        """The attributes that decide."""
        return self.names if self.down else self.names[:1]

    @property
    def cells(self) -> list[Cell]:
        """The cell of each region."""
        columns, rows = ([*pairwise((-inf, *borders, inf))] for borders in (self.across, self.down))
        first, second = self.names
        if not self.down:
            return [{first: column} for column in columns]
        return [{first: column, second: row} for row in rows for column in columns]

    @property
    def borders(self) -> tuple[float, ...]:
        """All borders, those between columns first."""
        return self.across + self.down

    def moved(self, borders: Sequence[float]) -> ByPosition:
        """The partition with other borders. Raises ValueError for another number of them."""
        across = len(self.across)
        check_number(borders, across + len(self.down))
        return replace(self, across=tuple(borders[:across]), down=tuple(borders[across:]))

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent."""
        x, y = (agent.state.get(name) for name in self._both)
        if not (is_coordinate(x) and is_coordinate(y)):
            return ById(self.count).region_of(agent)
        # As floats, as in columns: an int may lie between two of them.
        x, y = float(x), float(y)
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
class ByFunction:
    """Regions by a function of the user, which takes an agent's id and its attributes."""

    count: int
    function: Callable[[str, Any], object]

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent. Raises MisuseError for a number that is not a region."""
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


def check_number(borders: Sequence[float], expected: int) -> None:
    """Raise ValueError for another number of borders."""
    if len(borders) != expected:
        raise ValueError(f"{len(borders)} borders; expected {expected}")


def is_coordinate(value: object) -> TypeGuard[float]:
    """Whether a value is a number; a bool is not, in columns neither."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def regions_of(partition: Partition, piece: Piece) -> NDArray[np.intp] | None:
    """The regions of the nodes of a piece, by their first agents; None without agents."""
    if piece.ids is not None:
        assert isinstance(piece, Columns)
        return partition.regions_of(piece)
    first = None if piece.still else next(agents(Scene((piece,))), None)
    return None if first is None else np.array([partition.region_of(first)], np.intp)
