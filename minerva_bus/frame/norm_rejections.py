"""Enforces norms: which events of a frame, and which outcomes of agents, are permitted.

The unit of rejection is a result of λ: an agent with everything in its scope, with everything that
it leaves beside itself, and with the events that it sent. The exception are primitives that an
agent in columns leaves beside itself, because their author is unknown. A rejected unit is replaced
by its previous state, or by its outcome with fewer events.

Columns that keep their rows are judged and undone by columns. With births, deaths or changes of
kind, each agent is a node.

If a norm rejects an agent's outcome, the agent is evolved again without the events of the
last type, then without those of the last two types, and so on. The first outcome that no norm
rejects counts. Thus the agent loses only the step that leads to the forbidden state, and those
after it. Events from norms are never left out; in the end they are all that it receives.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Composition, Fragment, ids_of
from minerva_bus.frame.stimuli import PEOPLE, Instructions, is_people, person_of, source_of
from minerva_bus.grammar.assignment import rested
from minerva_bus.grammar.columns import Column, Columns, Rows, packed
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.ids import Ids, repeated_in
from minerva_bus.grammar.scene import EMPTY, AgentNode, Node, Scene, agents, kind_counts
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.norms import (
    EVENT,
    REFUSED,
    SOURCE,
    WAS,
    Norm,
    Then,
    ViolationCounts,
    sanction_of,
)
from minerva_bus.world.operator import NormStatus
from minerva_bus.world.population import parents_of
from minerva_bus.world.population_step import emissions

Sent: TypeAlias = tuple[AnyEvent, ...]
Elsewhere = Callable[[str], Any]
"""The value of `#id.attribute`, or None if there is no such agent."""


class FragmentOutcome:
    """One outermost agent and its outcome; base class of those of populations."""

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


def state_of(norm: Norm, now: AgentNode, old: AgentNode | None, elsewhere: Elsewhere) -> Any:
    """The values that the conditions of a norm on states can name."""
    state: dict[str, Any] = dict(now.state)
    for name in {name for condition in norm.conditions for name in condition.names}:
        if name.startswith("#"):
            state[name] = elsewhere(name)
        elif name.startswith(WAS) and old is not None:
            state[name] = old.state.get(name.removeprefix(WAS))
    return state


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


SentBy = Mapping[str, tuple[AnyEvent, ...]]
Scenes = Mapping[str, Scene]
Exceeds = Callable[[Norm, str], bool]


@dataclass(frozen=True, slots=True)
class NormVerdict:
    """The outcome of a frame after norms: changed fragments, and the events that agents sent.

    `rejected`: fragments that differ from their hosts' reports. `halted`: agents with a rejected
    step, sorted; devices execute none of their actions in this frame.
    """

    changed: dict[str, Scene]
    sent: dict[str, tuple[AnyEvent, ...]]
    rejected: tuple[str, ...] = ()
    halted: tuple[str, ...] = ()


class Trial:
    """The outcome of one frame while norms judge it."""

    def __init__(
        self, composition: Composition, changed: Scenes, sent: SentBy, elsewhere: Elsewhere
    ) -> None:
        self._composition = composition
        self._changed = dict(changed)
        self._sent = dict(sent)
        self._elsewhere = elsewhere
        # In the order of the string, because replies arrive in any order, and the order of judging
        # is that of the sanctions among the events of the next frame.
        places = composition.places(changed)
        self._outcomes = {
            name: outcome_of(composition.fragments[name], changed[name])
            for name in sorted(changed, key=places)
        }
        self._open: dict[str, dict[str, Norm]] = {}
        self._later: list[tuple[str, FragmentOutcome, SentBy]] = []
        self._leniently = False

    def judge(self, norm: Norm, breaks: Callable[[str], bool]) -> None:
        """Apply a norm to all outcomes, and undo those that it rejects."""
        for name, outcome in self._outcomes.items():
            for who in outcome.offenders(norm, self._elsewhere):
                if breaks(who) and norm.refuses:
                    self._open.setdefault(name, {})[outcome.unit(who)] = norm
                    outcome.undo(who)

    @property
    def open(self) -> tuple[str, ...]:
        """The fragments with a rejected agent that may still be evolved by fewer events."""
        return tuple(self._open)

    def stages(
        self, events: Sequence[AnyEvent], vocabulary: Vocabulary, always: frozenset[str]
    ) -> Iterator[tuple[AnyEvent, ...]]:
        """Reduced events of a frame, stage by stage, by which rejected agents are evolved again.

        After each stage `reconsider` takes the results of the `open` fragments. Events of the
        types `always` are part of all stages.
        """
        kinds = {
            kind for name in self._open for kind in kind_counts(self._composition.fragments[name])
        }
        met = frozenset[str]().union(*(vocabulary.kinds[kind].subscribes for kind in kinds))
        # In the order of the frame. Types that none of the agents subscribes to cannot have caused
        # the forbidden state, so they need no stage.
        types = list(dict.fromkeys(event.type for event in events if event.type in met))
        before = frozenset(types)
        # By type and not by event: each stage costs a round trip, and a frame has few types
        # but may have hundreds of events.
        for last in range(len(types) - 1, -1, -1):
            stage = frozenset(types[:last]) | always.intersection(types)
            if not self._open or not stage:
                return
            # A stage that leaves out only a type that is always
            # included would repeat the one before.
            if stage != before:
                self._leniently = stage <= always
                yield tuple([event for event in events if event.type in stage])
            before = stage

    def reconsider(
        self, changed: Scenes, sent: SentBy, norms: Sequence[Norm], exceeds: Exceeds
    ) -> None:
        """Accept outcomes of units by fewer events, unless a norm rejects them as well.

        By events from norms alone, a state that was forbidden before the frame is not rejected.
        """
        for name, refused in list(self._open.items()):
            old = self._composition.fragments[name]
            other = outcome_of(old, changed.get(name, Scene((old,))))
            wrong = {
                other.unit(who)
                for norm in norms
                for who in other.offenders(norm, self._elsewhere)
                # The norm that rejected the unit has counted this act already. For other norms it
                # is a new act, which counts only if their limit is reached.
                if refused.get(other.unit(who)) is norm or exceeds(norm, who)
                if not (self._leniently and self._was_forbidden(norm, other, who))
            }
            self._settle(name, old, other, refused.keys() - wrong)
            # Kept even if units of it were rejected: accepted ones have
            # sent their events in this stage.
            self._later.append((name, other, sent))

    def _settle(self, name: str, old: Fragment, other: FragmentOutcome, units: set[str]) -> None:
        for unit in sorted(units):
            self._outcomes[name].replace(unit, other)
            del self._open[name][unit]
        if not self._open[name]:
            del self._open[name]

    def _was_forbidden(self, norm: Norm, outcome: FragmentOutcome, who: str) -> bool:
        was = outcome.was(who)
        return was is not None and norm.holds(state_of(norm, was, was, self._elsewhere))

    def verdict(self, vocabulary: Vocabulary) -> NormVerdict:
        """The final outcome; agents with a rejected step are at rest."""
        rejected = {n: outcome for n, outcome in self._outcomes.items() if outcome.rejected}
        for name, outcome in rejected.items():
            # Units of different stages may share an agent if a host has moved it between them.
            if repeated_in(outcome.scene) is not None:
                rejected[name] = nothing_of(cast("Columns", self._composition.fragments[name]))
        halted = {who for outcome in rejected.values() for who in outcome.halted}
        for name, outcome in rejected.items():
            # At rest, because in the next frame λ would assume that the action was executed.
            self._changed[name] = rested(outcome.scene, outcome.halted, vocabulary.kinds)
        self._count_sent(rejected)
        return NormVerdict(self._changed, self._sent, tuple(rejected), tuple(sorted(halted)))

    def _count_sent(self, rejected: Mapping[str, FragmentOutcome]) -> None:
        names = {name: self._home(name) for name in self._sent}
        for _, _, sent in self._later:
            names |= {name: self._home(name) for name in sent}
        for name, home in names.items():
            if home in rejected:
                later = [
                    (other, sent.get(name, ())) for of, other, sent in self._later if of == home
                ]
                left = rejected[home].left(self._sent.pop(name, ()), later)
                self._sent |= {name: left} if left else {}

    def _home(self, name: str) -> str:
        """The fragment of a sender: an agent's, or one in columns."""
        return name if name in self._composition.parts else self._composition.home(name) or name


NORMS: Final = "norms"
"""The name under which violations are logged."""

Sources = Mapping[str, Sequence[AnyEvent]]
RejectedOrder = tuple[str, Event, str]
"""A person's order: its source, the event, and the norm that rejected it."""


class Norms:
    """Applies the norms of a world; `publish` releases log lines and sanctions."""

    def __init__(
        self,
        norms: tuple[Norm, ...],
        composition: Composition,
        vocabulary: Vocabulary,
        saved: Mapping[str, Any],
    ) -> None:
        self._vocabulary = vocabulary
        self._refusal = vocabulary.events.get(REFUSED)
        self._on_events = tuple(norm for norm in norms if norm.on)
        self._on_agents = tuple(norm for norm in norms if not norm.on)
        self._norms = norms
        self._composition = composition
        self._counts = ViolationCounts(saved)
        self._frame = 0
        self._people = frozenset[str]()
        self._seen: dict[str, Any] = {}
        self._lines: list[str] = []
        self._last: dict[str, tuple[int, str]] = {}
        self._sanctions: list[Event] = []
        self._rejected_orders: list[RejectedOrder] = []

    @property
    def broken(self) -> Mapping[str, int]:
        """Number of violations of each norm."""
        return self._counts.broken

    def status(self) -> tuple[NormStatus, ...]:
        """The norms that were broken, in the order of the world file."""
        return tuple(
            [
                NormStatus(norm.name, norm.then.value, count, *self._last.get(norm.name, (-1, "")))
                for norm in self._norms
                if (count := self._counts.broken.get(norm.name, 0))
            ]
        )

    def saved(self) -> dict[str, Any]:
        """The counts as plain data, from which a resumed world continues."""
        return self._counts.saved(self._norms, self._frame)

    def publish(self, out: Instructions, saved: dict[str, Mapping[str, Any]]) -> list[Event]:
        """Log violations and save the counts; returns the sanctions, events of the next frame."""
        for text in self._lines:
            out.log(NORMS, text)
        sanctions = self._sanctions
        self._lines, self._sanctions = [], []
        saved[SOURCE] = self.saved()
        return sanctions

    # --- events ---

    def events(self, frame: int, sources: Sources, people: Collection[str] = ()) -> Sources:
        """The permitted events of a frame, by source; w is the string that the frame begins with.

        The generators `people` represent people. An event whose sender no longer exists is judged
        by its data alone.
        """
        # Other internal sources are not acts of a member or person,
        # such as views that devices request.
        judged = [name for name in sorted(sources) if not name.startswith("~") or is_people(name)]
        if not self._on_events or not judged:
            return sources
        self._begin(frame)
        self._people = frozenset(people)
        left = {name: list(sources[name]) for name in judged}
        # Norms apply in the order of declaration: an event that one
        # refuses does not count for the next.
        for norm in self._on_events:
            for event_type in norm.on:
                for source, events in left.items():
                    left[source] = [
                        permitted
                        for event in events
                        for permitted in (
                            self._judged(norm, event, source)
                            if event.type == event_type
                            else (event,)
                        )
                    ]
        return {name: left.get(name, events) for name, events in sources.items()}

    def take_rejected_orders(self) -> list[RejectedOrder]:
        """Remove and return the orders of people that norms have rejected."""
        taken, self._rejected_orders = self._rejected_orders, []
        return taken

    def _judged(self, norm: Norm, event: AnyEvent, source: str) -> Iterator[AnyEvent]:
        """The events of an event or batch that a norm permits."""
        if isinstance(event, Event):
            who = event.sender or source
            forbidden = self._forbids(norm, event, source) and self._breaks(
                norm, who, f" by {event}"
            )
            if not (forbidden and norm.refuses):
                yield event
            elif is_people(source):
                self._rejected_orders.append((source, event, norm.name))
            return
        kept = np.ones(event.count, np.bool_)
        for row in np.flatnonzero(self._forbids_of_many(norm, event, source)).tolist():
            who = event.senders[row] if event.senders is not None else source
            if self._breaks(norm, who, f" by {event.type}") and norm.refuses:
                kept[row] = False
        if kept.all():
            yield event
        elif kept.any():
            yield event.take(np.flatnonzero(kept))

    def _forbids(self, norm: Norm, event: Event, source: str) -> bool:
        sender = self._composition.kind(event.sender) if event.sender else ""
        if not norm.concerns(sender, *self._known_as(source)):
            return False
        state: dict[str, Any] = dict(self._state(event.sender)) if sender else {}
        state |= {EVENT + name: value for name, value in event.data.items()}
        state |= {name: self._elsewhere(name) for name in norm.named}
        return norm.holds(state)

    def _forbids_of_many(self, norm: Norm, events: Events, source: str) -> NDArray[np.bool_]:
        forbidden = np.zeros(events.count, np.bool_)
        if events.senders is None:
            forbidden[:] = norm.concerns(*self._known_as(source))
            for condition in norm.conditions:
                forbidden &= condition.holds_of_many(self._many(norm, events), events.count)
            return forbidden
        # Senders in columns are judged as whole columns; those that
        # remain `single` are judged one by one.
        single = np.ones(events.count, np.bool_)
        for part in self._composition.parts.values():
            at = part.ids.rows_of(events.senders) if part.ids is not None else forbidden - 1
            rows = np.flatnonzero(at >= 0)
            single[rows] = False
            if not len(rows) or not norm.concerns(part.symbol, *self._known_as(source)):
                continue
            state = self._many(norm, events.take(rows))
            state |= {name: part.column(name)[at[rows]] for name in part.names}
            holds = np.ones(len(rows), np.bool_)
            for condition in norm.conditions:
                holds &= condition.holds_of_many(state, len(rows))
            forbidden[rows] = holds
        for row in np.flatnonzero(single).tolist():
            forbidden[row] = self._forbids(norm, events.event(row), source)
        return forbidden

    def _known_as(self, source: str) -> tuple[str, ...]:
        """The names under which norms may mention a source."""
        if source in self._people:  # An attached generator is the person of its name.
            return source, PEOPLE, source_of(source)
        return (source, PEOPLE) if is_people(source) else (source,)

    def _many(self, norm: Norm, events: Events) -> dict[str, Any]:
        state: dict[str, Any] = {EVENT + name: events.data(name) for name in events.names}
        return state | {name: self._elsewhere(name) for name in norm.named}

    # --- outcomes of agents ---

    def agents(self, frame: int, changed: Mapping[str, Scene], sent: SentBy) -> Trial | None:
        """Judge the results of fragments before they enter w; None if no norm applies to them."""
        if not self._on_agents or not changed:
            return None
        self._begin(frame)
        trial = Trial(self._composition, changed, sent, self._elsewhere)
        for norm in self._on_agents:
            trial.judge(norm, partial(self._breaks, norm))
        return trial

    def stages(self, trial: Trial, events: Sequence[AnyEvent]) -> Iterator[tuple[AnyEvent, ...]]:
        """The reduced events by which agents with a rejected outcome may still continue."""
        always = {norm.sanction.type for norm in self._norms if norm.sanction is not None}
        if self._refusal is not None:
            always.add(self._refusal.name)
        return trial.stages(events, self._vocabulary, frozenset(always))

    def reconsider(self, trial: Trial, changed: Mapping[str, Scene], sent: SentBy) -> None:
        """Judge rejected agents again, evolved by reduced events; violations are not counted."""
        refusing = [norm for norm in self._on_agents if norm.refuses]
        trial.reconsider(changed, sent, refusing, self._exceeds)

    def _exceeds(self, norm: Norm, who: str) -> bool:
        return self._counts.exceeds(norm, who, self._frame)

    def verdict(self, trial: Trial) -> NormVerdict:
        """The outcome of a frame after norms."""
        return trial.verdict(self._vocabulary)

    # --- both ---

    def _begin(self, frame: int) -> None:
        self._frame = frame
        self._seen = {}

    def _breaks(self, norm: Norm, who: str, what: str = "") -> bool:
        """Count an act of an agent or source; True if it violates the norm."""
        if not self._counts.breaks(norm, who, self._frame):
            return False
        is_agent = self._composition.home(who) is not None
        # Only the first violation of a norm is logged, since there may be one per agent and frame.
        # People need to know what becomes of each order.
        whom = person_of(who) if is_people(who) else f"#{who}" if is_agent else who
        self._last[norm.name] = self._frame, whom
        if self._counts.broken[norm.name] == 1 or is_people(who):
            later = "" if is_people(who) else "; from now on this is only counted"
            self._lines.append(
                f"{norm.name} is broken by {whom} in frame {self._frame}"
                f"{what[:_MAX_SHOWN]}: {_FOLLOWS[norm.then]}{later}"
            )
        if is_agent:
            sanctions = self._sanctions_of(norm)
            # Only agents can be sanctioned: generators and people receive no events.
            self._sanctions += [replace(event, receivers=(who,)) for event in sanctions]
        return True

    def _sanctions_of(self, norm: Norm) -> list[Event]:
        """The events that a violator receives in the next frame."""
        sanctions = [] if norm.sanction is None else [norm.sanction]
        if self._refusal is not None and norm.refuses_steps:
            refusal = sanction_of(norm.name, self._refusal, {})
            sanctions += [refusal] if refusal.type not in [e.type for e in sanctions] else []
        return sanctions

    def _elsewhere(self, name: str) -> Any:
        """The value of `#id.attribute`; None if there is no such agent."""
        if name not in self._seen:
            who, _, attribute = name[1:].partition(".")
            self._seen[name] = self._state(who).get(attribute)
        return self._seen[name]

    def _state(self, who: str) -> Mapping[str, Any]:
        """An agent's state in the string before the frame; empty if it has none."""
        outermost = self._composition.agent(who)
        nodes = agents(Scene((outermost,))) if outermost is not None else ()
        for agent in nodes:
            if agent.id == who:
                return agent.state
        return {}


_MAX_SHOWN = 200
_FOLLOWS = {Then.REFUSE: "refused", Then.SANCTION: "sanctioned", Then.COUNT: "allowed"}
