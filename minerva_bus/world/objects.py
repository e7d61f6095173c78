"""Agents in columns as the objects that their methods are written for."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from operator import itemgetter
from typing import Any

import numpy as np

from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.world.agent import Agent
from minerva_bus.world.population import Herd

_TYPES = {"real": float, "int": int, "bool": bool, "text": str}
_OWN = 3  # id, scope and _node beside the state


class Objects:
    """The agents of some rows, made when they are first spoken to."""

    def __init__(self, cls: type[Agent], herd: Herd) -> None:
        self._cls = cls
        self._herd = herd
        self._made: dict[int, Agent] = {}
        self.at_fault = 0
        """The row of the agent whose state was not valid."""

    def of(self, rows: Sequence[int]) -> list[Agent]:
        """The agents of these rows."""
        made = self._made
        missing = [row for row in rows if row not in made] if made else rows
        if missing:
            made.update(zip(missing, self._thawed(missing), strict=True))
        return [made[row] for row in rows]

    def _thawed(self, rows: Sequence[int]) -> list[Agent]:
        herd, cls = self._herd, self._cls
        ids: Ids = herd.part.ids  # pyright: ignore[reportAssignmentType]
        chosen = None if len(rows) == len(ids) else np.array(rows, np.intp)
        names = (*herd.fields.names, "id", "scope", "_node")
        columns = [_listed(herd.value(name), chosen) for name in herd.fields.names]
        columns.append((ids if chosen is None else ids.take(chosen)).texts())
        made: list[Agent] = []
        new = cls.__new__
        for values in zip(*columns, strict=True):
            agent = new(cls)
            agent.__dict__.update(zip(names, (*values, EMPTY, None), strict=True))
            made.append(agent)
        return made

    def drop(self, row: int) -> None:
        """One is no mere row any more."""
        del self._made[row]

    def forget(self) -> None:
        """All of them are to be made anew: their rows change otherwise."""
        self._made = {}

    def settle(self) -> list[tuple[int, Agent]]:
        """Put their states into the arrays; those that have got a scope are given back.

        Raises MisuseError where an attribute has a value of a wrong type; `at_fault` says whose.
        """
        if not self._made:
            return []
        rows, agents = list(self._made), list(self._made.values())
        states = [agent.__dict__ for agent in agents]
        grown = [(r, a) for r, a in self._made.items() if a.__dict__.get("scope") is not EMPTY]
        grown = [(row, agent) for row, agent in grown if agent.freeze().scope.pieces]
        fields = self._herd.fields
        usual = all(len(state) == len(fields.names) + _OWN for state in states)
        columns = self._usual(states) if usual else None
        if columns is None:
            columns = self._checked(rows, agents)
        at = None if len(rows) == self._herd.part.count else np.array(rows, np.intp)
        if at is None and rows != sorted(rows):
            at = np.array(rows, np.intp)
        for name, values in zip(fields.names, columns, strict=True):
            self._herd.write(name, at, values)
        return grown

    def _usual(self, states: list[dict[str, Any]]) -> list[list[Any]] | None:
        """The values of each attribute where all are of its very type."""
        found: list[list[Any]] = []
        for one in self._herd.fields.all:
            try:
                values = list(map(itemgetter(one.name), states))
            except KeyError:
                return None
            kind = _TYPES[one.type.kind]
            if set(map(type, values)) != {kind} or not _sound(kind, values):
                return None
            found.append(values)
        return found

    def _checked(self, rows: list[int], agents: list[Agent]) -> list[list[Any]]:
        nodes: list[tuple[Any, ...]] = []
        for row, agent in zip(rows, agents, strict=True):
            self.at_fault = row
            nodes.append(agent.freeze().values)
        self.forget()  # names that begin with _ do not last
        return [list(values) for values in zip(*nodes, strict=True)]


def _sound(kind: type, values: list[Any]) -> bool:
    if kind is float:
        return all(map(isfinite, values))
    return kind is not int or (max(values) < 1 << 63 and min(values) >= -(1 << 63))


def _listed(array: Any, rows: Any) -> list[Any]:
    return (array if rows is None else array[rows]).tolist()
