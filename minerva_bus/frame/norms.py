"""Enforces norms: which events of a frame, and which outcomes of agents, are permitted."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.event_sources import PEOPLE, is_people, person_of, source_of
from minerva_bus.frame.inbox import FrameInbox
from minerva_bus.frame.instructions import Instructions
from minerva_bus.frame.trial import NormVerdict, Trial
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.norms import EVENT, REFUSED, SOURCE, Norm, Then, ViolationCounts, sanction_of
from minerva_bus.world.operator import NormStatus

NORMS: Final = "norms"
"""The name under which violations are logged."""

Sources = Mapping[str, Sequence[AnyEvent]]
RejectedOrder = tuple[str, Event, str]
"""A person's order: its source, the event, and the norm that rejected it."""

SentBy = Mapping[str, tuple[AnyEvent, ...]]


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

    def publish(
        self, out: Instructions, inbox: FrameInbox, saved: dict[str, Mapping[str, Any]]
    ) -> None:
        """Log violations, queue sanctions for the next frame, and save the counts."""
        for text in self._lines:
            out.log(NORMS, text)
        inbox.sanctions += self._sanctions
        self._lines, self._sanctions = [], []
        saved[SOURCE] = self.saved()

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


__all__ = ["PEOPLE", "SOURCE", "NormVerdict", "Norms"]
