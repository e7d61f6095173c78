"""Norms over a world's frames: which events happen, and what agents become."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.trial import Ruling, Trial
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode, Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.norms import EVENT, REFUSED, SOURCE, Book, Norm, Then, sanction_of

PEOPLE: Final = "~order"
"""The source of what people send, to which norms apply as to that of generators."""

Sources = Mapping[str, Sequence[AnyEvent]]
Sent = Mapping[str, tuple[AnyEvent, ...]]


class Enforcement:
    """The norms of a world at work. What is to be said and sent because of them gathers in it."""

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
        self._book = Book(saved)
        self._frame = 0
        self._people = frozenset[str]()
        self._seen: dict[str, Any] = {}
        self._told: list[str] = []
        self._sanctions: list[Event] = []

    def __bool__(self) -> bool:
        return bool(self._norms)

    @property
    def broken(self) -> Mapping[str, int]:
        """How often each norm has been broken."""
        return self._book.broken

    def saved(self) -> dict[str, Any]:
        """What is needed to go on, as plain data."""
        return self._book.saved(self._norms, self._frame)

    def take_sanctions(self) -> list[Event]:
        """The events that follow for those who have broken norms, once."""
        found, self._sanctions = self._sanctions, []
        return found

    def take_words(self) -> list[str]:
        """What is to be said in the log, once: the first time that each norm is broken."""
        found, self._told = self._told, []
        return found

    # --- events ---

    def events(self, frame: int, sources: Sources, people: Collection[str] = ()) -> Sources:
        """What is left of a frame's events, by source, where w is the string that it begins with.

        The generators `people` stand for people. Raises nothing: an event whose sender is no more
        is judged by its data alone.
        """
        judged = [name for name in sorted(sources) if not name.startswith("~") or name == PEOPLE]
        if not self._on_events or not judged:
            return sources
        self._begin(frame)
        self._people = frozenset((PEOPLE, *people))
        left = {name: list(sources[name]) for name in judged}
        for norm in self._on_events:
            for event_type in norm.on:
                for source, events in left.items():
                    left[source] = [
                        one
                        for event in events
                        for one in (
                            self._judged(norm, event, source)
                            if event.type == event_type
                            else (event,)
                        )
                    ]
        return {name: left.get(name, events) for name, events in sources.items()}

    def _judged(self, norm: Norm, event: AnyEvent, source: str) -> Iterator[AnyEvent]:
        """What a norm leaves of an event, or of many."""
        if isinstance(event, Event):
            who = event.sender or source
            forbidden = self._forbids(norm, event, source) and self._breaks(
                norm, who, f" by {event}"
            )
            if not (forbidden and norm.refuses):
                yield event
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
        state |= {name: self._elsewhere(name) for name in _elsewhere(norm)}
        return norm.holds(state)

    def _forbids_of_many(self, norm: Norm, events: Events, source: str) -> NDArray[np.bool_]:
        found = np.zeros(events.count, np.bool_)
        if events.senders is None:
            found[:] = norm.concerns(*self._known_as(source))
            for condition in norm.conditions:
                found &= condition.holds_of_many(self._many(norm, events), events.count)
            return found
        alone = np.ones(events.count, np.bool_)
        for part in self._composition.parts.values():
            at = part.ids.rows_of(events.senders) if part.ids is not None else found - 1
            rows = np.flatnonzero(at >= 0)
            alone[rows] = False
            if not len(rows) or not norm.concerns(part.symbol, *self._known_as(source)):
                continue
            state = self._many(norm, events.take(rows))
            state |= {name: part.column(name)[at[rows]] for name in part.names}
            holds = np.ones(len(rows), np.bool_)
            for condition in norm.conditions:
                holds &= condition.holds_of_many(state, len(rows))
            found[rows] = holds
        for row in np.flatnonzero(alone).tolist():
            found[row] = self._forbids(norm, events.event(row), source)
        return found

    def _known_as(self, source: str) -> tuple[str, ...]:
        """The names by which norms apply to a source."""
        return (source, PEOPLE) if source in self._people else (source,)

    def _many(self, norm: Norm, events: Events) -> dict[str, Any]:
        state: dict[str, Any] = {EVENT + name: events.data(name) for name in events.names}
        return state | {name: self._elsewhere(name) for name in _elsewhere(norm)}

    # --- what agents become ---

    def agents(self, frame: int, changed: Mapping[str, Scene], sent: Sent) -> Trial | None:
        """Judge what has become of fragments, before it is put into w; None: there is no norm."""
        if not self._on_agents or not changed:
            return None
        self._begin(frame)
        trial = Trial(self._composition, changed, sent, self._elsewhere)
        for norm in self._on_agents:
            trial.judge(norm, partial(self._breaks, norm))
        return trial

    def stages(self, trial: Trial, events: Sequence[AnyEvent]) -> Iterator[tuple[AnyEvent, ...]]:
        """The events, ever fewer, by which those who are refused may still go on."""
        always = {norm.sanction.type for norm in self._norms if norm.sanction is not None}
        if self._refusal is not None:
            always.add(self._refusal.name)
        return trial.stages(events, self._vocabulary, frozenset(always))

    def reconsider(self, trial: Trial, changed: Mapping[str, Scene], sent: Sent) -> None:
        """Judge what has become of those who are refused by fewer events; nothing is counted."""
        refusing = [norm for norm in self._on_agents if norm.refuses]
        trial.reconsider(changed, sent, refusing, self._exceeds)

    def _exceeds(self, norm: Norm, who: str) -> bool:
        return self._book.exceeds(norm, who, self._frame)

    def ruling(self, trial: Trial) -> Ruling:
        """What counts of a frame in the end."""
        return trial.ruling(self._vocabulary)

    # --- both ---

    def _begin(self, frame: int) -> None:
        self._frame = frame
        self._seen = {}

    def _breaks(self, norm: Norm, who: str, what: str = "") -> bool:
        """Note what somebody does; whether it breaks the norm."""
        if not self._book.breaks(norm, who, self._frame):
            return False
        here = self._composition.home(who) is not None
        if self._book.broken[norm.name] == 1:
            whom = "people" if who == PEOPLE else f"#{who}" if here else who
            self._told.append(
                f"{norm.name} is broken by {whom} in frame {self._frame}"
                f"{what[:_SHOWN]}: {_FOLLOWS[norm.then]}; from now on this is only counted"
            )
        if here:
            self._sanctions += [replace(one, receivers=(who,)) for one in self._follows(norm)]
        return True

    def _follows(self, norm: Norm) -> list[Event]:
        """What who breaks a norm gets in the next frame."""
        found = [] if norm.sanction is None else [norm.sanction]
        if self._refusal is not None and norm.refuses and not norm.on:
            told = sanction_of(norm.name, self._refusal, {})
            found += [told] if told.type not in [one.type for one in found] else []
        return found

    def _elsewhere(self, name: str) -> Any:
        """The value of `#id.attribute`; None where there is no such agent."""
        if name not in self._seen:
            who, _, attribute = name[1:].partition(".")
            self._seen[name] = self._state(who).get(attribute)
        return self._seen[name]

    def _state(self, who: str) -> Mapping[str, Any]:
        """An agent's state in the string that the frame began with."""
        home = self._composition.home(who)
        if home is None:
            return {}
        fragment = self._composition.fragments[home]
        if isinstance(fragment, Columns) and fragment.ids is not None:
            found = cast("AgentNode", fragment.node(fragment.ids.row_of(who)))
            return found.state
        for agent in agents(Scene((fragment,))):
            if agent.id == who:
                return agent.state
        return {}


_SHOWN = 200
_FOLLOWS = {Then.REFUSE: "refused", Then.SANCTION: "sanctioned", Then.COUNT: "allowed"}


def _elsewhere(norm: Norm) -> set[str]:
    names = {name for condition in norm.conditions for name in condition.names}
    return {name for name in names if name.startswith("#")}


__all__ = ["SOURCE", "Enforcement", "Ruling"]
