"""Partitions: functions from agents to regions, equal in every region."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
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
    agent without the attributes has a region by its id.
    """

    across: tuple[float, ...]
    down: tuple[float, ...] = ()
    names: tuple[str, str] = ("x", "y")

    @property
    def count(self) -> int:
        """Number of regions."""
        return (len(self.across) + 1) * (len(self.down) + 1)

    def region_of(self, agent: AgentNode) -> int:
        """The region of an agent."""
        values = [agent.state.get(name) for name in self._names]
        # Not isinstance, because a bool is no coordinate, in columns neither.
        if any(type(value) not in _NUMBERS for value in values):
            return ById(self.count).region_of(agent)
        x, y = map(float, cast("list[float]", values))
        column, row = bisect_right(self.across, x), bisect_right(self.down, y)
        return row * (len(self.across) + 1) + column

    def regions_of(self, part: Columns) -> NDArray[np.intp]:
        """The regions of agents in columns."""
        has_both = all(name in part.names for name in self._names)
        if not has_both or any(part.column(name).dtype.kind not in "if" for name in self._names):
            return ById(self.count).regions_of(part)
        x, y = (part.column(name) for name in self._names)
        columns = np.searchsorted(np.array(self.across), x, side="right")
        rows = np.searchsorted(np.array(self.down), y, side="right")
        return rows * (len(self.across) + 1) + columns

    @property
    def _names(self) -> tuple[str, str]:
        # A grid of one row needs the first attribute only.
        return self.names if self.down else (self.names[0], self.names[0])


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
