"""Outcomes of fragments, as norms judge them: the changes of agents, and how to undo them.

The unit of rejection is a result of λ: an agent with everything in its scope, with everything that
it leaves beside itself, and with the events that it sent. The exception are primitives that an
agent in columns leaves beside itself, because their author is unknown. A rejected unit is replaced
by its previous state, or by its outcome with fewer events.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.fragments import Fragment, ids_of
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.column import Column, Rows
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import EMPTY, AgentNode, Node, Scene, agents
from minerva_bus.world.assembling import emissions
from minerva_bus.world.lineage import parents_of
from minerva_bus.world.norms import WAS, Norm

Sent: TypeAlias = tuple[AnyEvent, ...]
Elsewhere = Callable[[str], Any]
"""The value of `#id.attribute`, or None if there is no such agent."""


class FragmentOutcome:
    """One outermost agent and its outcome; base class of `PopulationOutcome`."""

    def __init__(self, old: Fragment, new: Scene) -> None:
        self._old = old
        self._new = new
        self._undone: dict[str, FragmentOutcome | None] = {}
        self._before = self._agents_before()

    def _agents_before(self) -> Mapping[str, AgentNode]:
        return {agent.id: agent for agent in agents(Scene((self._old,)))}

    @property
    def rejected(self) -> bool:
        """Whether a unit of it has been undone."""
        return bool(self._undone)

    def offenders(self, norm: Norm, elsewhere: Elsewhere) -> Iterator[str]:
        """Agents whose new state violates a norm, in the order of the string.

        Only changed states are judged; for a newborn the parent is the offender.
        """
        for agent in agents(self._new):
            old = self._before.get(agent.id)
            unit = self.unit(agent.id)
            # A state undone by an earlier norm no longer exists, so later norms do not count it.
            if unit in self._undone or not norm.concerns(agent.symbol):
                continue
            # An agent that stays unchanged in a state that was forbidden
            # before does not offend again.
            if old is not None and same_values(old.values, agent.values):
                continue
            if norm.holds(state_of(norm, agent, old, elsewhere)):
                yield agent.id if old is not None else unit

    @property
    def halted(self) -> tuple[str, ...]:
        """All agents that have been undone, sorted."""
        return tuple(sorted(self._before)) if self._undone else ()

    def unit(self, who: str) -> str:
        """The unit of an agent: the agent whose λ returned it."""
        return cast("AgentNode", self._old).id

    def undo(self, who: str) -> None:
        """Replace an agent's unit by its previous state."""
        self._undone[self.unit(who)] = None

    def replace(self, unit: str, other: FragmentOutcome) -> None:
        """Replace a unit that was undone by its state in another outcome, by fewer events."""
        self._undone[unit] = other

    def was(self, who: str) -> AgentNode | None:
        """An agent as it was before the frame."""
        return self._before.get(who)

    def of_unit(self, unit: str) -> tuple[Node, ...]:
        """The nodes of a unit in this outcome."""
        return self._new.nodes

    @property
    def scene(self) -> Scene:
        """The final fragment."""
        if not self._undone:
            return self._new
        (other,) = self._undone.values()
        return Scene((self._old,)) if other is None else other.scene

    def left(self, sent: Sent, later: Sequence[tuple[FragmentOutcome, Sent]] = ()) -> Sent:
        """The events of the fragment that count, from this outcome and others."""
        if not self._undone:
            return sent
        (other,) = self._undone.values()
        return next((events for outcome, events in later if outcome is other), ())


class PopulationOutcome(FragmentOutcome):
    """Outcome of agents in columns; each agent is a unit."""

    _old: Columns

    @property
    def halted(self) -> tuple[str, ...]:
        """All agents that have been undone, sorted."""
        return tuple(sorted(self._undone))

    def left(self, sent: Sent, later: Sequence[tuple[FragmentOutcome, Sent]] = ()) -> Sent:
        """The events of the fragment that count, from this outcome and others."""
        return _left(ids_of(self._old), sent, self._undone, later)


class ColumnsOutcome(PopulationOutcome):
    """Outcome of agents in columns that have become columns with the same rows."""

    def __init__(self, old: Columns, new: Columns) -> None:
        super().__init__(old, Scene((new,)))
        self._now = new
        self._kept = np.ones(old.count, np.bool_)
        self._other = _changed_rows(old, new)

    # Columns are judged without nodes for all rows; `was` makes the few that are needed.
    def _agents_before(self) -> Mapping[str, AgentNode]:
        return {}

    def unit(self, who: str) -> str:
        """The agent itself."""
        return who

    def offenders(self, norm: Norm, elsewhere: Elsewhere) -> Iterator[str]:
        """Agents whose new state violates a norm, judged as whole columns."""
        if not norm.concerns(self._old.symbol):
            return
        offends = self._other & self._kept
        for condition in norm.conditions:
            state = {name: self._value(name, elsewhere) for name in condition.names}
            offends &= condition.holds_of_many(state, self._old.count)
        yield from ids_of(self._old).take(np.flatnonzero(offends)).texts()

    def _value(self, name: str, elsewhere: Elsewhere) -> Any:
        if name.startswith("#"):
            return elsewhere(name)
        part = self._old if name.startswith(WAS) else self._now
        name = name.removeprefix(WAS)
        return part.column(name) if name in part.names else None

    def undo(self, who: str) -> None:
        """Replace an agent's unit by its previous state."""
        super().undo(who)
        self._kept[ids_of(self._old).row_of(who)] = False

    def was(self, who: str) -> AgentNode | None:
        """An agent as it was before the frame."""
        return cast("AgentNode", self._old.node(ids_of(self._old).row_of(who)))

    def of_unit(self, unit: str) -> tuple[Node, ...]:
        """The node of an agent in this outcome."""
        return (self._now.node(ids_of(self._now).row_of(unit)),)

    @property
    def scene(self) -> Scene:
        """The final fragment."""
        if not self._undone:
            return self._new
        others = {other for other in self._undone.values() if other is not None}
        # Only outcomes with the same rows can be merged by columns.
        if not all(isinstance(other, ColumnsOutcome) for other in others):
            return _put_together(self, self._new, self._undone)
        columns = self._now.columns
        for other in [None, *others]:
            part = self._old if other is None else cast("ColumnsOutcome", other)._now
            undone = [who for who, by in self._undone.items() if by is other]
            rows = np.sort(ids_of(self._old).rows_of(Ids.of(undone))) if undone else ()
            if len(rows):
                pairs = zip(columns, part.columns, strict=True)
                columns = tuple([_with(new, old, np.asarray(rows, np.intp)) for new, old in pairs])
        return Scene((self._now.with_columns(columns),))


class MixedOutcome(PopulationOutcome):
    """Outcome of agents in columns, some of which died, have newborns or changed their kind."""

    def __init__(self, old: Columns, new: Scene) -> None:
        super().__init__(old, new)
        # All previous agents are possible parents, because a parent may die in the frame of its
        # births; then only the newborns are left of its unit.
        newborns = [agent.id for agent in agents(new) if agent.id not in self._before]
        counts = {who: node.state.get("births") for who, node in self._before.items()}
        # Only kinds that count their births can be parents.
        births = {who: count for who, count in counts.items() if isinstance(count, int)}
        self._parents = parents_of(newborns, births)

    def _agents_before(self) -> Mapping[str, AgentNode]:
        return {node.id: node for node in cast("tuple[AgentNode, ...]", self._old.nodes())}

    def unit(self, who: str) -> str:
        """The agent itself, or the parent of a newborn."""
        return self._parents.get(who, who)

    def of_unit(self, unit: str) -> tuple[Node, ...]:
        """The nodes of an agent and of its newborns in this outcome."""
        return self._by_unit.get(unit, ())

    @cached_property
    def _by_unit(self) -> Mapping[str, tuple[Node, ...]]:
        by_unit: dict[str, tuple[Node, ...]] = {}
        for node in self._new.nodes:
            units = {self.unit(agent.id) for agent in agents(Scene((node,)))}
            for unit in units:
                by_unit[unit] = (*by_unit.get(unit, ()), node)
        return by_unit

    @property
    def scene(self) -> Scene:
        """The final fragment."""
        return _put_together(self, self._new, self._undone) if self._undone else self._new


def outcome_of(old: Fragment, new: Scene) -> FragmentOutcome:
    """The outcome of a fragment."""
    if old.ids is None:
        return FragmentOutcome(old, new)
    now = new.pieces[0] if len(new.pieces) == 1 else None
    # With the same rows, attributes can be compared and replaced column by column.
    if now is None or now.ids is None or now.symbol != old.symbol or now.ids != old.ids:
        return MixedOutcome(old, new)
    return ColumnsOutcome(old, now)


def state_of(norm: Norm, now: AgentNode, old: AgentNode | None, elsewhere: Elsewhere) -> Any:
    """The values that the conditions of a norm on states can name."""
    state: dict[str, Any] = dict(now.state)
    for name in {name for condition in norm.conditions for name in condition.names}:
        if name.startswith("#"):
            state[name] = elsewhere(name)
        elif name.startswith(WAS) and old is not None:
            state[name] = old.state.get(name.removeprefix(WAS))
    return state


def _changed_rows(old: Columns, new: Columns) -> NDArray[np.bool_]:
    changed = np.zeros(old.count, np.bool_)
    for before, after in zip(old.columns, new.columns, strict=True):
        rows = after.differs(before)
        changed[slice(None) if rows is None else rows] = True
    return changed


def _with(new: Column, old: Column, rows: Rows) -> Column:
    return new if new is old else new.put(rows, old.array[rows])


def _put_together(
    outcome: FragmentOutcome, new: Scene, undone: Mapping[str, FragmentOutcome | None]
) -> Scene:
    """A population, node by node, with the replacements of units that were undone."""
    made: list[Node] = []
    # A unit may have several nodes, an agent and its newborns. Its replacement takes the place of
    # the first one, and the others are left out.
    back = dict(undone)
    for node in new.nodes:
        units = {outcome.unit(agent.id) for agent in agents(Scene((node,)))} & undone.keys()
        if not units:
            made.append(node)
        for unit in sorted(units & back.keys()):
            made += _instead(outcome, unit, back.pop(unit))
    return packed(Scene(tuple(made))) if made else EMPTY


def _instead(
    outcome: FragmentOutcome, unit: str, other: FragmentOutcome | None
) -> tuple[Node, ...]:
    if other is not None:
        return other.of_unit(unit)
    was = outcome.was(unit)
    return () if was is None else (was,)


def _left(
    ids: Ids,
    sent: Sent,
    undone: Mapping[str, FragmentOutcome | None],
    later: Sequence[tuple[FragmentOutcome, Sent]],
) -> Sent:
    """The events of a population, in the order of its agents."""
    if not undone:
        return sent
    kept = _kept(sent, lambda who: who not in undone)
    for outcome, events in later:
        kept += _kept(events, lambda who, by=outcome: undone.get(who) is by)
    batches, singles = list[tuple[Rows, Events]](), list[tuple[int, list[Event]]]()
    for event in kept:
        if isinstance(event, Event):
            singles.append((ids.row_of(event.sender), [event]))
        elif event.senders is not None:
            batches.append((ids.rows_of(event.senders), event))
    return emissions(batches, singles)


def _kept(sent: Sent, keeps: Callable[[str], bool]) -> list[AnyEvent]:
    """The events of those senders that `keeps` accepts."""
    kept: list[AnyEvent] = []
    for event in sent:
        if isinstance(event, Event):
            kept += [event] if keeps(event.sender) else []
        elif event.senders is not None:
            rows = np.flatnonzero([keeps(who) for who in event.senders.texts()])
            kept += [event.take(rows)] if len(rows) else []
    return kept
