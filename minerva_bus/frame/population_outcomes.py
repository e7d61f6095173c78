"""Outcomes of agents in columns, as norms judge them: whole columns, or single agents.

Columns that keep their rows are judged and undone by columns. With births, deaths or changes of
kind, each agent is a node. See outcomes.py for the unit of rejection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.fragments import Fragment, ids_of
from minerva_bus.frame.outcomes import Elsewhere, FragmentOutcome, Sent
from minerva_bus.grammar.column import Column, Rows
from minerva_bus.grammar.columns import Columns, packed
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import EMPTY, AgentNode, Node, Scene, agents
from minerva_bus.world.assembling import emissions
from minerva_bus.world.lineage import parents_of
from minerva_bus.world.norms import WAS, Norm


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

    def undo_all(self) -> None:
        """Replace all agents by their previous states."""
        self._undone = dict.fromkeys(ids_of(self._old).texts())
        self._kept[:] = False

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


def nothing_of(old: Columns) -> FragmentOutcome:
    """The outcome of agents in columns that are all undone."""
    outcome = ColumnsOutcome(old, old)
    outcome.undo_all()
    return outcome


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
