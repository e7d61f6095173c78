"""Agents in columns as the objects that their methods are written for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from operator import is_, itemgetter, methodcaller
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import StateError
from minerva_bus.grammar.columns import Columns, Rows
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import EMPTY
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
    """The agents of some rows, made when they are first spoken to.

    They stay from frame to frame, beside the columns that they have become, until these are
    evolved otherwise or are no more.
    """

    def __init__(self, cls: type[Agent], herd: PopulationState) -> None:
        self._cls = cls
        self._herd = herd
        self._ids = cast("Ids", herd.part.ids)
        self._made: dict[int, Agent] = {}
        self._all: list[Agent] | None = None
        self._kept, self._everyones = _taken(herd.part, cls)
        self.at_fault = 0
        """The row of the agent whose state was not valid."""

    def of(self, rows: Rows | None) -> Sequence[Agent]:
        """The agents of these rows, or of all."""
        if rows is None:
            if self._all is None:
                self._all = self._everyone()
                self._made = {}
            return self._all
        if self._all is not None:
            listed = cast("list[int]", rows.tolist())
            return [self._all[row] for row in listed]
        wanted = cast("list[int]", rows.tolist())
        missing = [row for row in wanted if row not in self._made]
        self._made.update(zip(missing, self._some(missing), strict=True))
        return [self._made[row] for row in wanted]

    def _everyone(self) -> list[Agent]:
        everyone = self._kept or self._thawed(None)
        for row, agent in self._made.items():
            everyone[row] = agent
        return everyone

    def _some(self, rows: list[int]) -> list[Agent]:
        if self._kept is not None:
            return [self._kept[row] for row in rows]
        return self._thawed(np.array(rows, np.intp)) if rows else []

    def _thawed(self, rows: Rows | None) -> list[Agent]:
        herd, cls = self._herd, self._cls
        names = (*herd.fields.names, "id", "scope", "_node")
        columns = [_listed(herd.value(name), rows) for name in herd.fields.names]
        columns.append(self._names(rows))
        made: list[Agent] = []
        new = cls.__new__
        for values in zip(*columns, strict=True):
            agent = new(cls)
            agent.__dict__.update(zip(names, (*values, EMPTY, None), strict=True))
            made.append(agent)
        return made

    def _names(self, rows: Rows | None) -> list[str]:
        if rows is not None:
            return self._ids.take(rows).texts()
        if self._everyones is None:
            self._everyones = self._ids.texts()
        return self._everyones

    def drop(self, row: int) -> None:
        """One is no mere row any more."""
        if self._all is not None:
            self._made = dict(enumerate(self._all))
            self._all = None
        self._kept = None
        del self._made[row]

    def forget(self) -> None:
        """All of them are to be made anew: their rows change otherwise."""
        self._made, self._all, self._kept = {}, None, None

    def keep(self, part: Columns) -> None:
        """Let all of them stay beside the columns that they are in the end."""
        everyone = self._all or self._kept
        if everyone is not None and part.columns and part.ids is self._ids:
            names = self._names(None)
            part.columns[0].kept = self._cls, self._ids, part.columns[1:], everyone, names

    def settle(self) -> list[tuple[int, Agent]]:
        """Put their states into the arrays; those that have got a scope are given back.

        Raises MisuseError where an attribute has a value of a wrong type; `at_fault` says whose.
        """
        agents = self._all if self._all is not None else list(self._made.values())
        if not agents:
            return []
        rows = None if self._all is not None else list(self._made)
        at = None if rows is None else np.array(rows, np.intp)
        states = [agent.__dict__ for agent in agents]
        self._check_ids(at, states)
        usual = set(map(len, states)) == {len(self._herd.fields.names) + _OWN}
        arrays = self._usual(states) if usual else None
        grown = self._grown(rows, agents, states)
        if arrays is None:
            arrays = self._checked(rows, agents)
        for name, values in zip(self._herd.fields.names, arrays, strict=True):
            self._herd.write(name, at, values)
        return grown

    def _check_ids(self, rows: Rows | None, states: list[dict[str, Any]]) -> None:
        """Nobody has become another."""
        names = self._names(rows)
        if list(map(_id, states)) == names:
            return
        for place, (name, state) in enumerate(zip(names, states, strict=True)):
            if _id(state) != name:
                self.at_fault = place if rows is None else int(rows[place])
                raise StateError(
                    f"an agent keeps its id; #{name} cannot become #{_id(state)}", "id"
                )

    def _grown(
        self, rows: list[int] | None, agents: list[Agent], states: list[dict[str, Any]]
    ) -> list[tuple[int, Agent]]:
        if all(map(is_, map(_scope, states), repeat(EMPTY))):
            return []
        every = enumerate(agents) if rows is None else zip(rows, agents, strict=True)
        return [(row, agent) for row, agent in every if agent.freeze().scope.pieces]

    def _usual(self, states: list[dict[str, Any]]) -> list[NDArray[Any]] | None:
        """The values of each attribute where all are of its very type."""
        found: list[NDArray[Any]] = []
        for one in self._herd.fields.all:
            kind, dtype = _TYPES[one.type.kind]
            try:
                values = list(map(itemgetter(one.name), states))
                if set(map(type, values)) != {kind}:
                    return None
                array = np.array(values, dtype)
            except (KeyError, OverflowError):
                return None
            if kind is float and not np.isfinite(array).all():
                return None
            found.append(array)
        return found

    def _checked(self, rows: list[int] | None, agents: list[Agent]) -> list[Sequence[Any]]:
        nodes: list[tuple[Any, ...]] = []
        for place, agent in enumerate(agents):
            self.at_fault = place if rows is None else rows[place]
            nodes.append(agent.freeze().values)
        self.forget()  # names that begin with _ do not last
        return list(zip(*nodes, strict=True))


_id = methodcaller("get", "id")
_scope = methodcaller("get", "scope")


def _taken(part: Columns, cls: type[Agent]) -> tuple[list[Agent] | None, list[str] | None]:
    """The agents that stayed beside these very columns, and their ids; they do so no more."""
    kept = part.columns[0].kept if part.columns else None
    if kept is None:
        return None, None
    part.columns[0].kept = None
    kind, ids, others, agents, names = kept
    if kind is cls and ids is part.ids and all(map(is_, others, part.columns[1:])):
        return agents, names
    return None, None


def _listed(array: Any, rows: Any) -> list[Any]:
    return (array if rows is None else array[rows]).tolist()
