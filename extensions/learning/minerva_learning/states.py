"""The agents of one kind in a string: their ids, attributes as columns, and nodes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.collector import agent_rows
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AgentNode, Scene, agents
from minerva_bus.grammar.vocabulary import AgentKind


class KindStates:
    """The agents of a kind in the string with which a frame begins, in the order of the string.

    Args:
        scene: the string.
        kind: of the agents.
        only: the id of the only agent that counts; "": all.
        before: the states of an earlier frame; without births and deaths since then, `ids` is the
            same list.

    """

    def __init__(
        self, scene: Scene, kind: AgentKind, only: str = "", before: KindStates | None = None
    ) -> None:
        self.scene, self.kind = scene, kind
        self._rows = agent_rows(scene, kind.name, kind.fields)
        # Ids of columns are spelled only if they have changed.
        given = self._rows.ids()
        self._given = given if isinstance(given, Ids) else given.tolist()
        if before is not None and self._given == before._given:
            self._chosen, self.ids = before._chosen, before.ids
            return
        ids = list(self._given)
        self._chosen = [ids.index(only)] if only in ids else [] if only else None
        self.ids = ids if self._chosen is None else [ids[at] for at in self._chosen]

    def rows_of(self, ids: Sequence[str]) -> NDArray[np.intp]:
        """The row of each of these agents in `column`, -1 for those that are not here."""
        if ids == self.ids:
            return np.arange(len(self.ids))
        return np.array([self.row.get(agent, -1) for agent in ids], np.intp)

    def ids_of(self, agents: list[str]) -> Ids:
        """The ids of these agents: the same object as in the string if they are all of it."""
        if agents == self.ids and self._chosen is None and isinstance(self._given, Ids):
            return self._given
        return Ids.of(agents)

    @cached_property
    def row(self) -> dict[str, int]:
        """The row of each agent in `column`, by id."""
        return {agent: at for at, agent in enumerate(self.ids)}

    def column(self, name: str) -> NDArray[Any]:
        """A number, bool or text attribute of all agents, shape (n,)."""
        values = self._rows.column(name)
        return values if self._chosen is None else values[self._chosen]

    @cached_property
    def nodes(self) -> dict[str, AgentNode]:
        """The agents by id."""
        return {
            node.id: node
            for node in agents(self.scene)
            if node.symbol == self.kind.name and node.id in self.row
        }

    def values(self, name: str) -> list[Any]:
        """An attribute of all agents, such as a list or a matrix."""
        return [self.nodes[agent].state[name] for agent in self.ids]

    def check_some(self) -> None:
        """Raise MisuseError if there is no agent."""
        if not self.ids:
            raise MisuseError(
                f"the string has no agent of the kind {self.kind.name}, or none with this id:"
                " its observations have no known size"
            )
