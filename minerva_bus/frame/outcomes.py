"""What has become of a fragment in a frame, as norms judge it: who has become what, and undoing it.

The unit that is refused is what λ returned: an agent with all that is in its scope, with all that
it was to leave beside itself, and with the events that it sent. Figures that one of a population
leaves beside itself are the exception: nobody can say whose they are.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Fragment
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.columns import Columns, packed
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AgentNode, Node, Scene, agents
from minerva_bus.world.lineage import child_id
from minerva_bus.world.norms import WAS, Norm

Elsewhere = Callable[[str], Any]
"""The value of `#id.attribute`, or None where there is no such agent."""


class Outcome:
    """One outermost agent, and what it has become; the base of what populations become."""

    def __init__(self, old: Fragment, new: Scene) -> None:
        self._old = old
        self._new = new
        self._undone: dict[str, None] = {}
        self._before = self._agents_before()

    def _agents_before(self) -> Mapping[str, AgentNode]:
        return {agent.id: agent for agent in agents(Scene((self._old,)))}

    @property
    def overruled(self) -> bool:
        """Whether something in it has been undone."""
        return bool(self._undone)

    def offenders(self, norm: Norm, elsewhere: Elsewhere) -> Iterator[str]:
        """Who has become what a norm forbids, in the order of the string.

        Only those are judged whose state is another now; of a newborn it is the parent.
        """
        for agent in agents(self._new):
            old = self._before.get(agent.id)
            unit = self._unit(agent.id)
            if unit in self._undone or not norm.concerns(agent.symbol):
                continue
            if old is not None and same_values(old.values, agent.values):
                continue
            if norm.holds(_state(norm, agent, old, elsewhere)):
                yield agent.id if old is not None else unit

    def _unit(self, agent: str) -> str:
        """Whose λ an agent comes from."""
        return cast("AgentNode", self._old).id

    def undo(self, who: str) -> None:
        """Let somebody be as it was."""
        self._undone[self._unit(who)] = None

    @property
    def scene(self) -> Scene:
        """What has become of it in the end."""
        return Scene((self._old,)) if self._undone else self._new

    def left(self, sent: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
        """What is left of the events that it sent."""
        return () if self._undone else sent


class ManyOutcome(Outcome):
    """Agents in columns that have become other columns, with the same rows."""

    _old: Columns

    def __init__(self, old: Columns, new: Columns) -> None:
        super().__init__(old, Scene((new,)))
        self._now = new
        self._kept = np.ones(old.count, np.bool_)
        self._other = _changed_rows(old, new)

    def _agents_before(self) -> Mapping[str, AgentNode]:
        return {}

    def _unit(self, agent: str) -> str:
        return agent

    def offenders(self, norm: Norm, elsewhere: Elsewhere) -> Iterator[str]:
        """As for one agent."""
        if not norm.concerns(self._old.symbol):
            return
        found = self._other & self._kept
        for condition in norm.conditions:
            state = {name: self._value(name, elsewhere) for name in condition.names}
            found &= condition.holds_of_many(state, self._old.count)
        yield from _ids(self._old).take(np.flatnonzero(found)).texts()

    def _value(self, name: str, elsewhere: Elsewhere) -> Any:
        if name.startswith("#"):
            return elsewhere(name)
        part = self._old if name.startswith(WAS) else self._now
        name = name.removeprefix(WAS)
        return part.column(name) if name in part.names else None

    def undo(self, who: str) -> None:
        """Let somebody be as it was."""
        super().undo(who)
        self._kept[_ids(self._old).row_of(who)] = False

    @property
    def scene(self) -> Scene:
        """What has become of them in the end."""
        if not self._undone:
            return self._new
        rows = np.flatnonzero(~self._kept)
        columns = [
            new if new is old else new.put(rows, old.array[rows])
            for new, old in zip(self._now.columns, self._old.columns, strict=True)
        ]
        return Scene((self._now.with_columns(columns),))

    def left(self, sent: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
        """What is left of the events that they sent."""
        return _left(sent, self._undone)


class MixedOutcome(Outcome):
    """Agents in columns of whom some are no mere rows any more: dead, parents, of other kinds."""

    _old: Columns

    def __init__(self, old: Columns, new: Scene) -> None:
        self._parents: dict[str, str] = {}
        super().__init__(old, new)
        for agent in agents(new):
            before = self._before.get(agent.id)
            if before is not None:
                self._note_births(before, agent)

    def _agents_before(self) -> Mapping[str, AgentNode]:
        return {node.id: node for node in cast("tuple[AgentNode, ...]", self._old.nodes())}

    def _note_births(self, before: AgentNode, now: AgentNode) -> None:
        first, last = before.state.get("births"), now.state.get("births")
        if isinstance(first, int) and isinstance(last, int):
            for birth in range(first + 1, last + 1):
                self._parents[child_id(now.id, birth)] = now.id

    def _unit(self, agent: str) -> str:
        return self._parents.get(agent, agent)

    @property
    def scene(self) -> Scene:
        """What has become of them in the end."""
        if not self._undone:
            return self._new
        made: list[Node] = []
        back = {who: self._before[who] for who in self._undone if who in self._before}
        for node in self._new.nodes:
            units = {self._unit(agent.id) for agent in agents(Scene((node,)))} & self._undone.keys()
            if units:
                made += [back.pop(who) for who in sorted(units) if who in back]
            else:
                made.append(node)
        return packed(Scene(tuple(made)))

    def left(self, sent: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
        """What is left of the events that they sent."""
        return _left(sent, self._undone)


def outcome_of(old: Fragment, new: Scene) -> Outcome:
    """What has become of a fragment."""
    if not isinstance(old, Columns):
        return Outcome(old, new)
    now = new.pieces[0] if len(new.pieces) == 1 else None
    alike = isinstance(now, Columns) and now.symbol == old.symbol and now.ids == old.ids
    return ManyOutcome(old, cast("Columns", now)) if alike else MixedOutcome(old, new)


def _state(norm: Norm, now: AgentNode, old: AgentNode | None, elsewhere: Elsewhere) -> Any:
    state: dict[str, Any] = dict(now.state)
    for name in {name for condition in norm.conditions for name in condition.names}:
        if name.startswith("#"):
            state[name] = elsewhere(name)
        elif name.startswith(WAS) and old is not None:
            state[name] = old.state.get(name.removeprefix(WAS))
    return state


def _changed_rows(old: Columns, new: Columns) -> NDArray[np.bool_]:
    changed = np.zeros(old.count, np.bool_)
    for one, other in zip(old.columns, new.columns, strict=True):
        rows = other.differs(one)
        changed[slice(None) if rows is None else rows] = True
    return changed


def _left(sent: tuple[AnyEvent, ...], undone: Collection[str]) -> tuple[AnyEvent, ...]:
    if not undone:
        return sent
    found: list[AnyEvent] = []
    for event in sent:
        if not isinstance(event, Events):
            if event.sender not in undone:
                found.append(event)
        elif event.senders is not None:
            kept = np.flatnonzero(Ids.of(list(undone)).rows_of(event.senders) < 0)
            if len(kept):
                found.append(event.take(kept))
    return tuple(found)


def _ids(part: Columns) -> Ids:
    return cast("Ids", part.ids)
