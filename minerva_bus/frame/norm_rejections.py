"""Enforces norms: which events of a frame, and which outcomes of agents, are permitted.

The unit of rejection is a result of λ: an agent with everything in its scope, with everything that
it leaves beside itself, and with the events that it sent. The exception are primitives that an
agent in columns leaves beside itself, because their author is unknown. A rejected unit is replaced
by its previous state, or by its outcome with fewer events.

Agents that are rows before and after the frame are judged by columns; newborns and others are
judged one by one.

If a norm rejects an agent's outcome, the agent is evolved again without the events of the
last type, then without those of the last two types, and so on. The first outcome that no norm
rejects counts. Thus the agent loses only the step that leads to the forbidden state, and those
after it. Events from norms are never left out; in the end they are all that it receives.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Final, TypeAlias, cast

import numpy as np

from minerva_bus.frame.composition import Composition, Fragment, ids_of
from minerva_bus.frame.messages import Parts, SentBy
from minerva_bus.frame.stimuli import PEOPLE, Instructions, is_people, person_of, source_of
from minerva_bus.frame.world_state import FrameResult
from minerva_bus.grammar.columns import Columns, Rows, packed
from minerva_bus.grammar.events import AnyEvent, Event, Events, chosen, senders_of
from minerva_bus.grammar.ids import Ids, repeated_in
from minerva_bus.grammar.scene import EMPTY, AgentNode, Node, Piece, Scene, agents, kind_counts
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.norms import (
    EVENT,
    REFUSED,
    SOURCE,
    WAS,
    Norm,
    Then,
    ViolationCounts,
    rested,
    sanction_of,
)
from minerva_bus.world.operator import NormStatus
from minerva_bus.world.population import parents_of
from minerva_bus.world.population_step import emissions

Sent: TypeAlias = tuple[AnyEvent, ...]
Elsewhere: TypeAlias = Callable[[str], Any]
"""The value of `#id.attribute`, or None if there is no such agent."""


class FragmentOutcome:
    """What λ has made of a fragment, and the units of it that norms have undone.

    An outermost agent is one unit, with all that it has become. In columns each agent is a unit,
    together with its newborns.
    """

    def __init__(self, old: Fragment, new: Scene) -> None:
        self._old = old
        self._new = new
        self._undone: dict[str, FragmentOutcome | None] = {}
        self._compared: dict[int, tuple[Rows, Rows, list[int]]] = {}

    @cached_property
    def _before(self) -> Mapping[str, AgentNode]:
        """An outermost agent before the frame, and those in its scope; empty for columns."""
        if self._old.ids is not None:
            return {}
        return {agent.id: agent for agent in agents(Scene((self._old,)))}

    @cached_property
    def _parents(self) -> Mapping[str, str]:
        """The parents of the newborns of agents in columns, which may have died in this frame."""
        old, newborns = self._old, list[str]()
        if isinstance(old, AgentNode) or self._as_columns is not None:
            return {}
        for piece in self._new.pieces:
            ids = piece.ids
            ids = Ids.of([agent.id for agent in agents(Scene((piece,)))]) if ids is None else ids
            newborns += ids.take(np.flatnonzero(ids_of(old).rows_of(ids) < 0)).texts()
        # Only kinds that count their births can be parents.
        if not newborns or "births" not in old.names or old.column("births").dtype.kind != "i":
            return {}
        births = zip(ids_of(old).texts(), old.column("births").tolist(), strict=True)
        return parents_of(newborns, dict(births))

    @cached_property
    def _as_columns(self) -> Columns | None:
        """The new string if it has the rows of the old columns, otherwise None."""
        old, new = self._old, self._new.pieces[0] if len(self._new.pieces) == 1 else None
        if old.ids is None or new is None or new.ids is None or new.symbol != old.symbol:
            return None
        return new if new.ids == old.ids else None

    @property
    def rejected(self) -> bool:
        """Whether a unit of it has been undone."""
        return bool(self._undone)

    @property
    def halted(self) -> tuple[str, ...]:
        """All agents that have been undone, sorted."""
        return tuple(sorted(self._before or self._undone)) if self._undone else ()

    def unit(self, who: str) -> str:
        """The unit of an agent: the agent whose λ returned it."""
        return self._old.id if isinstance(self._old, AgentNode) else self._parents.get(who, who)

    def was(self, who: str) -> AgentNode | None:
        """An agent as it was before the frame."""
        if isinstance(self._old, AgentNode):
            return self._before.get(who)
        row = ids_of(self._old).row_of(who)
        return cast("AgentNode", self._old.node(row)) if row >= 0 else None

    # --- judging ---

    def offenders(self, norm: Norm, elsewhere: Elsewhere) -> Iterator[str]:
        """Agents whose new state violates a norm, in the order of the string.

        Only changed states are judged; for a newborn the parent is the offender.
        """
        for piece in self._new.pieces:
            for who in self._forbidden(norm, piece, elsewhere):
                unit = self.unit(who)
                # A state undone by an earlier norm no longer exists, so later ones do not count it.
                if unit not in self._undone:
                    yield who if who in self._before else unit

    def _forbidden(self, norm: Norm, piece: Piece, elsewhere: Elsewhere) -> Iterator[str]:
        """The agents of a piece with a changed and forbidden state."""
        old = self._old
        if isinstance(old, Columns) and isinstance(piece, Columns) and piece.shape == old.shape:
            if norm.concerns(piece.symbol):
                yield from self._forbidden_rows(norm, old, piece, elsewhere)
            return
        for agent in agents(Scene((piece,))):
            if norm.concerns(agent.symbol) and self._offends(norm, agent, elsewhere):
                yield agent.id

    def _offends(self, norm: Norm, agent: AgentNode, elsewhere: Elsewhere) -> bool:
        was = self.was(agent.id)
        # An agent that stays in a state that was forbidden before does not offend again.
        changed = was is None or not same_values(was.values, agent.values)
        return changed and norm.holds(state_of(norm, agent, was, elsewhere))

    def _forbidden_rows(
        self, norm: Norm, old: Columns, new: Columns, elsewhere: Elsewhere
    ) -> Iterator[str]:
        if id(new) not in self._compared:
            self._compared[id(new)] = _compared(old, new)
        rows, former, newborn = self._compared[id(new)]
        # Usually all agents have changed; then the columns are not copied.
        whole = former is rows and len(rows) == new.count

        def value(name: str) -> Any:
            if name.startswith("#"):
                return elsewhere(name)
            part, at = (old, former) if name.startswith(WAS) else (new, rows)
            name = name.removeprefix(WAS)
            if name not in part.names:
                return None
            return part.column(name) if whole else part.column(name)[at]

        holds = norm.holds_of_many(value, len(rows))
        born = [
            row
            for row in newborn
            if self._offends(norm, cast("AgentNode", new.node(row)), elsewhere)
        ]
        forbidden = np.sort(np.append(rows[holds], np.array(born, np.intp)))
        yield from ids_of(new).take(forbidden).texts()

    def undo(self, *agents: str) -> None:
        """Replace the units of these agents by their previous states."""
        self._undone |= dict.fromkeys(map(self.unit, agents))

    def replace(self, unit: str, other: FragmentOutcome) -> None:
        """Replace a unit that was undone by its state in another outcome, by fewer events."""
        self._undone[unit] = other

    # --- results ---

    @property
    def scene(self) -> Scene:
        """The final fragment."""
        if not self._undone:
            return self._new
        others = {other for other in self._undone.values() if other is not None}
        parts = {other: other._as_columns for other in others}
        # Only outcomes with the same rows can be merged by columns.
        if self._as_columns is None or None in parts.values():
            return self._node_by_node()
        columns = self._as_columns.columns
        for other in [None, *others]:
            part = cast("Columns", self._old if other is None else parts[other])
            undone = [who for who, by in self._undone.items() if by is other]
            rows = np.sort(ids_of(part).rows_of(Ids.of(undone))) if undone else np.empty(0, np.intp)
            if len(rows):
                pairs = zip(columns, part.columns, strict=True)
                columns = tuple(
                    [new if new is old else new.put(rows, old.array[rows]) for new, old in pairs]
                )
        return Scene((self._as_columns.with_columns(columns),))

    def _node_by_node(self) -> Scene:
        """The final fragment, with the replacements of units that were undone."""
        made: list[Node] = []
        # A unit may have several nodes, an agent and its newborns. Its replacement takes the place
        # of the first one, and the others are left out.
        back = dict(self._undone)
        for node in self._new.nodes:
            units = self._units(node) & self._undone.keys()
            if not units:
                made.append(node)
            for unit in sorted(units & back.keys()):
                other, was = back.pop(unit), self.was(unit)
                made += (was,) if other is None and was is not None else ()
                made += () if other is None else other._by_unit.get(unit, ())
        return packed(Scene(tuple(made))) if made else EMPTY

    def _units(self, node: Node) -> set[str]:
        """The units to which a node belongs."""
        if isinstance(self._old, AgentNode):
            return {self._old.id}
        return {self.unit(agent.id) for agent in agents(Scene((node,)))}

    @cached_property
    def _by_unit(self) -> Mapping[str, list[Node]]:
        """The nodes of each unit in this outcome."""
        by_unit: dict[str, list[Node]] = {}
        for node in self._new.nodes:
            for unit in self._units(node):
                by_unit.setdefault(unit, []).append(node)
        return by_unit

    def left(self, sent: Sent, later: Sequence[tuple[FragmentOutcome, Sent]] = ()) -> Sent:
        """The events of the fragment that count, from this outcome and others, by their senders."""
        if not self._undone:
            return sent
        kept = self._kept(sent, lambda unit: unit not in self._undone)
        for outcome, events in later:
            kept += self._kept(events, lambda unit, by=outcome: self._undone.get(unit) is by)
        if self._old.ids is None:
            return tuple(kept)
        ids = self._old.ids
        return emissions([(ids.rows_of(_senders(event)), event) for event in kept])

    def _kept(self, sent: Sent, keeps: Callable[[str], bool]) -> list[AnyEvent]:
        """The events of those units that `keeps` accepts."""
        kept: list[AnyEvent] = []
        for event in sent:
            units = map(self.unit, _senders(event))
            kept += chosen(event, np.flatnonzero([*map(keeps, units)]))
        return kept


def _senders(event: AnyEvent) -> Ids:
    """The senders of an agent's event, or of a batch of a population."""
    return cast("Ids", senders_of(event))


def state_of(norm: Norm, now: AgentNode, old: AgentNode | None, elsewhere: Elsewhere) -> Any:
    """The values that the conditions of a norm on states can name."""
    state: dict[str, Any] = dict(now.state)
    for name in {name for condition in norm.conditions for name in condition.names}:
        if name.startswith("#"):
            state[name] = elsewhere(name)
        elif name.startswith(WAS) and old is not None:
            state[name] = old.state.get(name.removeprefix(WAS))
    return state


def _compared(old: Columns, new: Columns) -> tuple[Rows, Rows, list[int]]:
    """The rows of `new` that have changed, their rows in `old`, and the rows of newborns."""
    former = known = np.arange(old.count)
    before, after = old, new
    if new.ids != old.ids:
        former = ids_of(old).rows_of(ids_of(new))
        known = np.flatnonzero(former >= 0)
        before, after = old.take(former[known]), new.take(known)
    changed = np.zeros(len(known), np.bool_)
    for was, now in zip(before.columns, after.columns, strict=True):
        rows = now.differs(was)
        changed[slice(None) if rows is None else rows] = True
    rows = known[changed]
    return rows, rows if former is known else former[rows], np.flatnonzero(former < 0).tolist()


class Trial:
    """The outcome of one frame while norms judge it."""

    def __init__(self, norms: Norms, changed: Parts, sent: SentBy) -> None:
        self._norms = norms
        self._composition = composition = norms.composition
        self._changed = dict(changed)
        self._sent = dict(sent)
        # In the order of the string, because replies arrive in any order, and the order of judging
        # is that of the sanctions among the events of the next frame.
        places = composition.places(changed)
        self._outcomes = {
            name: FragmentOutcome(composition.fragments[name], changed[name])
            for name in sorted(changed, key=places)
        }
        self._open: dict[str, dict[str, Norm]] = {}
        self._later: list[tuple[str, FragmentOutcome, SentBy]] = []
        self._leniently = False
        for norm in norms.on_agents:
            for name, outcome in self._outcomes.items():
                for who in outcome.offenders(norm, norms.elsewhere):
                    if norms.breaks(norm, who) and norm.refuses:
                        self._open.setdefault(name, {})[outcome.unit(who)] = norm
                        outcome.undo(who)

    @property
    def open(self) -> tuple[str, ...]:
        """The fragments with a rejected agent that may still be evolved by fewer events."""
        return tuple(self._open)

    def stages(self, events: Sequence[AnyEvent]) -> Iterator[tuple[AnyEvent, ...]]:
        """Reduced events of a frame, stage by stage, by which rejected agents are evolved again.

        After each stage `reconsider` takes the results of the `open` fragments. Events from norms
        are part of all stages.
        """
        kinds = {
            kind for name in self._open for kind in kind_counts(self._composition.fragments[name])
        }
        known = self._norms.vocabulary.kinds
        met = frozenset[str]().union(*(known[kind].subscribes for kind in kinds))
        # In the order of the frame. Types that none of the agents subscribes to cannot have caused
        # the forbidden state, so they need no stage.
        types = list(dict.fromkeys(event.type for event in events if event.type in met))
        always, before = self._norms.own_types, frozenset(types)
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

    def reconsider(self, changed: Parts, sent: SentBy) -> None:
        """Accept outcomes of units by fewer events, unless a norm rejects them as well.

        Violations are not counted again. By events from norms alone, a state that was forbidden
        before the frame is not rejected.
        """
        norms = self._norms
        for name, refused in list(self._open.items()):
            old = self._composition.fragments[name]
            other = FragmentOutcome(old, changed.get(name, Scene((old,))))
            wrong = {
                other.unit(who)
                for norm in norms.on_agents
                if norm.refuses
                for who in other.offenders(norm, norms.elsewhere)
                # The norm that rejected the unit has counted this act already. For other norms it
                # is a new act, which counts only if their limit is reached.
                if refused.get(other.unit(who)) is norm or norms.exceeds(norm, who)
                if not (self._leniently and self._was_forbidden(norm, other, who))
            }
            for unit in sorted(refused.keys() - wrong):
                self._outcomes[name].replace(unit, other)
                del refused[unit]
            if not refused:
                del self._open[name]
            # Kept even if units of it were rejected: accepted ones have
            # sent their events in this stage.
            self._later.append((name, other, sent))

    def _was_forbidden(self, norm: Norm, outcome: FragmentOutcome, who: str) -> bool:
        was = outcome.was(who)
        return was is not None and norm.holds(state_of(norm, was, was, self._norms.elsewhere))

    def settle(self, result: FrameResult) -> set[str]:
        """Make a result the permitted one; returns the agents with a rejected step, at rest."""
        rejected = {n: outcome for n, outcome in self._outcomes.items() if outcome.rejected}
        for name, outcome in rejected.items():
            # Units of different stages may share an agent if a host has moved it between them.
            if repeated_in(outcome.scene) is not None:
                old = cast("Columns", self._composition.fragments[name])
                rejected[name] = FragmentOutcome(old, Scene((old,)))
                rejected[name].undo(*ids_of(old).texts())
        for name, outcome in rejected.items():
            # At rest, because in the next frame λ would assume that the action was executed.
            kinds = self._norms.vocabulary.kinds
            self._changed[name] = rested(outcome.scene, outcome.halted, kinds)
        self._count_sent(rejected)
        result.changed, result.sent, result.rejected = self._changed, self._sent, tuple(rejected)
        return {who for outcome in rejected.values() for who in outcome.halted}

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
        self.vocabulary = vocabulary
        self.composition = composition
        self.on_agents = tuple(norm for norm in norms if not norm.on)
        self._on_events = tuple(norm for norm in norms if norm.on)
        self._refusal = vocabulary.events.get(REFUSED)
        sanctions = {norm.sanction.type for norm in norms if norm.sanction is not None}
        self.own_types = frozenset(sanctions | ({REFUSED} if self._refusal is not None else set()))
        """The event types that only norms send."""
        self._norms = norms
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

    def publish(self, out: Instructions, saved: dict[str, Mapping[str, Any]]) -> list[Event]:
        """Log violations and save the counts; returns the sanctions, events of the next frame."""
        for text in self._lines:
            out.log(NORMS, text)
        sanctions = self._sanctions
        self._lines, self._sanctions = [], []
        saved[SOURCE] = self._counts.saved(self._norms, self._frame)
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

    def _judged(self, norm: Norm, event: AnyEvent, source: str) -> Sequence[AnyEvent]:
        """The events of an event or batch that a norm permits."""
        forbidden = self._forbidden(norm, event, source)
        if not forbidden:
            return (event,)
        senders, shown = senders_of(event), event if isinstance(event, Event) else event.type
        refused = [
            row
            for row in forbidden
            if self.breaks(norm, senders[row] if senders else source, f" by {shown}")
            and norm.refuses
        ]
        if refused and isinstance(event, Event) and is_people(source):
            self._rejected_orders.append((source, event, norm.name))
        return chosen(event, np.delete(np.arange(len(event)), refused)) if refused else (event,)

    def _forbidden(self, norm: Norm, event: AnyEvent, source: str) -> list[int]:
        """The rows of a batch that a norm forbids; a single event is row 0."""
        if isinstance(event, Event):
            return [0] if self._forbids(norm, event, source) else []
        every = np.arange(event.count)
        if event.senders is None:
            concerned = norm.concerns(*self._known_as(source))
            return self._forbidden_rows(norm, event, None, every) if concerned else []
        forbidden, single = list[int](), np.ones(event.count, np.bool_)
        # Senders in columns are judged as whole columns; those that
        # remain `single` are judged one by one.
        for part in self.composition.parts.values():
            rows = np.flatnonzero(ids_of(part).rows_of(event.senders) >= 0)
            single[rows] = False
            if len(rows) and norm.concerns(part.symbol, *self._known_as(source)):
                forbidden += self._forbidden_rows(norm, event, part, rows)
        rest = np.flatnonzero(single).tolist()
        forbidden += [row for row in rest if self._forbids(norm, event.event(row), source)]
        return sorted(forbidden)

    def _forbidden_rows(
        self, norm: Norm, events: Events, part: Columns | None, rows: Rows
    ) -> list[int]:
        """Those of some rows that a norm forbids; their senders, if any, are in one part."""
        at = None if part is None else ids_of(part).rows_of(cast("Ids", events.senders))[rows]

        def value(name: str) -> Any:
            if name.startswith("#"):
                return self.elsewhere(name)
            if name.startswith(EVENT):
                name = name.removeprefix(EVENT)
                return events.data(name)[rows] if name in events.names else None
            return part.column(name)[at] if part is not None and name in part.names else None

        return rows[norm.holds_of_many(value, len(rows))].tolist()

    def _forbids(self, norm: Norm, event: Event, source: str) -> bool:
        sender = self.composition.kind(event.sender) if event.sender else ""
        if not norm.concerns(sender, *self._known_as(source)):
            return False
        state: dict[str, Any] = dict(self._state(event.sender)) if sender else {}
        state |= {EVENT + name: value for name, value in event.data.items()}
        state |= {name: self.elsewhere(name) for name in norm.named}
        return norm.holds(state)

    def _known_as(self, source: str) -> tuple[str, ...]:
        """The names under which norms may mention a source."""
        if source in self._people:  # An attached generator is the person of its name.
            return source, PEOPLE, source_of(source)
        return (source, PEOPLE) if is_people(source) else (source,)

    # --- outcomes of agents ---

    def agents(self, frame: int, changed: Parts, sent: SentBy) -> Trial | None:
        """Judge the results of fragments before they enter w; None if no norm applies to them."""
        if not self.on_agents or not changed:
            return None
        self._begin(frame)
        return Trial(self, changed, sent)

    def exceeds(self, norm: Norm, who: str) -> bool:
        """Whether a further act of an agent would violate the norm; does not count it."""
        return self._counts.exceeds(norm, who, self._frame)

    # --- both ---

    def _begin(self, frame: int) -> None:
        self._frame = frame
        self._seen = {}

    def breaks(self, norm: Norm, who: str, what: str = "") -> bool:
        """Count an act of an agent or source; True if it violates the norm."""
        if not self._counts.breaks(norm, who, self._frame):
            return False
        is_agent = self.composition.home(who) is not None
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

    def elsewhere(self, name: str) -> Any:
        """The value of `#id.attribute`; None if there is no such agent."""
        if name not in self._seen:
            who, _, attribute = name[1:].partition(".")
            self._seen[name] = self._state(who).get(attribute)
        return self._seen[name]

    def _state(self, who: str) -> Mapping[str, Any]:
        """An agent's state in the string before the frame; empty if it has none."""
        outermost = self.composition.agent(who)
        nodes = agents(Scene((outermost,))) if outermost is not None else ()
        for agent in nodes:
            if agent.id == who:
                return agent.state
        return {}


_MAX_SHOWN = 200
_FOLLOWS = {Then.REFUSE: "refused", Then.SANCTION: "sanctioned", Then.COUNT: "allowed"}
