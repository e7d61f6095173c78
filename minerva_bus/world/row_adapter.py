"""Agent objects for the rows of a population, so that methods for one agent can run on rows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from operator import is_, itemgetter, methodcaller
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import StateError
from minerva_bus.grammar.columns import Columns, Rows
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.grammar.types import Type
from minerva_bus.world.agent import Agent
from minerva_bus.world.population import PopulationState

_TYPES: Final[dict[str, tuple[type, Any]]] = {
    "real": (float, np.float64),
    "int": (int, np.int64),
    "bool": (bool, np.bool_),
    "text": (str, object),
}
_OWN = 3  # id, scope and _node beside the state


class RowAdapter:
    """Agent objects for the rows of a population, created on first use.

    They are cached from frame to frame with the columns that they have become, because creating
    them takes longer than most methods. The cache is dropped when the columns change otherwise.
    """

    def __init__(self, cls: type[Agent], state: PopulationState) -> None:
        self._cls = cls
        self._state = state
        self._made: dict[int, Agent] = {}
        self._all: list[Agent] | None = None
        self._kept, self._texts = _taken(state.part, cls)
        self.at_fault = 0
        """The row of the agent with an invalid state."""

    def agents(self, rows: Rows | None) -> Sequence[Agent]:
        """The agents in these rows, or in all."""
        if rows is None:
            if self._all is None:
                self._all = self._every()
                self._made = {}
            return self._all
        wanted = cast("list[int]", rows.tolist())
        if self._all is not None:
            return [self._all[row] for row in wanted]
        missing = [row for row in wanted if row not in self._made]
        self._made.update(zip(missing, self._missing(missing), strict=True))
        return [self._made[row] for row in wanted]

    def _every(self) -> list[Agent]:
        every = self._kept or self._thawed(None)
        for row, agent in self._made.items():
            every[row] = agent
        return every

    def _missing(self, rows: list[int]) -> list[Agent]:
        if self._kept is not None:
            return [self._kept[row] for row in rows]
        return self._thawed(np.array(rows, np.intp)) if rows else []

    def _thawed(self, rows: Rows | None) -> list[Agent]:
        state, cls = self._state, self._cls
        names = (*state.fields.names, "id", "scope", "_node")
        columns = [_listed(state.value(name), rows) for name in state.fields.names]
        columns.append(self._ids(rows))
        # Without `__init__`, whose checks the columns have passed, and with all attributes in one
        # update.
        made: list[Agent] = []
        new = cls.__new__
        for values in zip(*columns, strict=True):
            agent = new(cls)
            agent.__dict__.update(zip(names, (*values, EMPTY, None), strict=True))
            made.append(agent)
        return made

    def _ids(self, rows: Rows | None) -> list[str]:
        if rows is not None:
            return self._state.ids.take(rows).texts()
        if self._texts is None:
            self._texts = self._state.ids.texts()
        return self._texts

    def drop(self, row: int) -> None:
        """Drop an agent that has left the arrays."""
        if self._all is not None:
            # The list stands for all rows; without one of them the agents are looked up by row.
            self._made = dict(enumerate(self._all))
            self._all = None
        self._kept = None
        del self._made[row]

    def forget(self) -> None:
        """Drop all agents, because their rows are about to change."""
        self._made, self._all, self._kept = {}, None, None

    def keep(self, part: Columns) -> None:
        """Cache all agents with the columns that they are at the end of the frame."""
        every = self._all or self._kept
        # With births or deaths the rows are other agents than those of the list.
        if every is not None and part.columns and part.ids is self._state.ids:
            ids = self._ids(None)
            part.columns[0].kept = self._cls, self._state.ids, part.columns[1:], every, ids

    def settle(self) -> list[tuple[int, Agent]]:
        """Write the agents' states to the arrays; returns the agents that now have a scope.

        Raises MisuseError if an attribute has a value of a wrong type; `at_fault` is its row.
        """
        agents = self._all if self._all is not None else list(self._made.values())
        if not agents:
            return []
        rows = None if self._all is not None else list(self._made)
        at = None if rows is None else np.array(rows, np.intp)
        # The checks below are loops in C over all agents. Any irregularity leads to `freeze`, which
        # checks one agent after another and names the fault.
        states = [agent.__dict__ for agent in agents]
        self._check_ids(at, states)
        # With the declared number of entries, and each name found by `_usual`, no attribute was
        # added or deleted.
        usual = set(map(len, states)) == {len(self._state.fields.names) + _OWN}
        arrays = self._usual(states) if usual else None
        grown = self._grown(rows, agents, states)
        if arrays is None:
            arrays = self._checked(rows, agents)
        for name, values in zip(self._state.fields.names, arrays, strict=True):
            self._state.write(name, at, values)
        return grown

    def _check_ids(self, rows: Rows | None, states: list[dict[str, Any]]) -> None:
        """Raise StateError if an agent has changed its id."""
        ids = self._ids(rows)
        if list(map(_id, states)) == ids:
            return
        for place, (agent_id, state) in enumerate(zip(ids, states, strict=True)):
            if _id(state) != agent_id:
                self.at_fault = place if rows is None else int(rows[place])
                raise StateError(
                    f"an agent keeps its id; #{agent_id} cannot become #{_id(state)}", "id"
                )

    def _grown(
        self, rows: list[int] | None, agents: list[Agent], states: list[dict[str, Any]]
    ) -> list[tuple[int, Agent]]:
        # Columns hold agents without scopes.
        if all(map(is_, map(_scope, states), repeat(EMPTY))):
            return []
        every = enumerate(agents) if rows is None else zip(rows, agents, strict=True)
        return [(row, agent) for row, agent in every if agent.freeze().scope.pieces]

    def _usual(self, states: list[dict[str, Any]]) -> list[NDArray[Any]] | None:
        """The values of each attribute; None unless all have exactly the declared type."""
        arrays: list[NDArray[Any]] = []
        for field in self._state.fields.all:
            kind, dtype = _TYPES[field.type.kind]
            try:
                values = list(map(itemgetter(field.name), states))
                # Exact types: a bool is an int, and an int in a real attribute must become a float
                # first.
                if set(map(type, values)) != {kind}:
                    return None
                array = np.array(values, dtype)
            # A deleted attribute, or an int of more than 64 bits.
            except (KeyError, OverflowError):
                return None
            if kind is float and not np.isfinite(array).all():
                return None
            if not _within(field.type, array, values):
                return None
            arrays.append(array)
        return arrays

    def _checked(self, rows: list[int] | None, agents: list[Agent]) -> list[Sequence[Any]]:
        values: list[tuple[Any, ...]] = []
        for place, agent in enumerate(agents):
            self.at_fault = place if rows is None else rows[place]
            values.append(agent.freeze().values)
        self.forget()  # temporary attributes, with names that begin with _, end here
        return list(zip(*values, strict=True))


def _within(declared: Type, array: NDArray[Any], values: Sequence[Any]) -> bool:
    """Whether values of the right Python type are words of their type, or in its range."""
    if declared.words:
        return {*values} <= {*declared.words}
    # If the extremes are in the range, all values are.
    return declared.range is None or all(
        map(declared.range.holds, (array.min().item(), array.max().item()))
    )


_id = methodcaller("get", "id")
_scope = methodcaller("get", "scope")


def _taken(part: Columns, cls: type[Agent]) -> tuple[list[Agent] | None, list[str] | None]:
    """The agents cached with these columns, and their ids; clears the cache."""
    kept = part.columns[0].kept if part.columns else None
    if kept is None:
        return None, None
    part.columns[0].kept = None  # agents are mutable, so two evolutions must not share them
    kind, ids, others, agents, names = kept
    if kind is cls and ids is part.ids and all(map(is_, others, part.columns[1:])):
        return agents, names
    return None, None


def _listed(array: Any, rows: Any) -> list[Any]:
    return (array if rows is None else array[rows]).tolist()
