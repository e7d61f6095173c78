"""Norms of a world in one region: they reject the same acts as those of one coordinator.

Violations are counted by agent, so all counts of an agent are in its region, and move with it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.description import World
from minerva_bus.frame.event_sources import AGENTS
from minerva_bus.frame.inbox import FrameInbox
from minerva_bus.frame.lag import Divided
from minerva_bus.frame.messages import Figures
from minerva_bus.frame.norms import BROKEN, Norms, Sources
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.scene import EMPTY, agents
from minerva_bus.regions.attached import HOME
from minerva_bus.regions.merging import PlacedEvent
from minerva_bus.world.norms import SOURCE, Lately


@dataclass(frozen=True, slots=True)
class NormPart:
    """What the norms of another region need after a frame.

    `states`: the values that norms name as `#id.attribute`, of the sender's agents. `counts`: the
    recent acts of agents that move there, by norm. `sanctions` belong to the next frame, `later` to
    the one after it.
    """

    states: Figures = field(default_factory=dict[str, bool | int | float | str])
    counts: Lately = field(default_factory=dict[str, dict[str, list[int]]])
    sanctions: tuple[AnyEvent, ...] = ()
    later: tuple[AnyEvent, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.states or self.counts or self.sanctions or self.later)


NO_NORMS = NormPart()


@dataclass(frozen=True, slots=True)
class NormReport:
    """What the coordinator has to know of a region's norms after a frame, for its checkpoint.

    One coordinator judges the events of agents in the next frame, so its checkpoint has also those
    that are `rejected`, by their numbers among all that have been sent, the `counts` without them,
    and the `sanctions` for the next frame. `counts` are None without norms. `halted`: agents whose
    actions devices must not execute.
    """

    rejected: tuple[int, ...] = ()
    counts: Mapping[str, Any] | None = None
    sanctions: tuple[AnyEvent, ...] = ()
    halted: tuple[str, ...] = ()


NO_REPORT = NormReport()


def total_counts(counts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """The counts of all regions as those of one coordinator, as `ViolationCounts` saves them."""
    broken: dict[str, int] = {}
    lately: Lately = {}
    for each in counts:
        for norm, of in each["lately"].items():
            lately.setdefault(norm, {}).update(of)
        for norm, count in each["broken"].items():
            broken[norm] = broken.get(norm, 0) + count
    return {"broken": broken, "lately": lately}


Judged: TypeAlias = tuple[Sequence[PlacedEvent], tuple[int, ...]]
"""Events, and the numbers of those that norms reject."""


Crossing: TypeAlias = Callable[[Sequence[PlacedEvent]], Sequence[NDArray[np.bool_]]]
"""For each event which of its rows count later."""


class RegionNorms(Norms):
    """The norms of a world in one region.

    The events of agents are judged in the region of their sender, which knows its state, before
    they are sent to others. `people` are the sources outside of all regions that represent people.
    """

    def __init__(self, world: World, composition: Composition, number: int) -> None:
        saved = world.past.saved.get(SOURCE, {})
        super().__init__(world.norms, composition, world.vocabulary, saved)
        self.people = frozenset[str]()
        self.crossing: Crossing = lambda placed: [np.zeros(1, np.bool_) for _ in placed]
        # Orders of people are judged before the sanctions of the frame are taken, so those for the
        # next one do not wait among them.
        self._waiting: list[AnyEvent] = []
        self._number = number
        self._judged_types = frozenset(name for norm in world.norms for name in norm.on)
        self._named = sorted({name for norm in world.norms for name in norm.named})
        string = world.scene if self._named else EMPTY
        first = {agent.id: agent.state for agent in agents(string)}
        self._states: Figures = _values(self._named, lambda name: first.get(name, {}))
        self._before_judging = self.saved()

    def judge_past(self, world: World, inbox: FrameInbox) -> None:
        """Judge the events that agents had sent before a world of one coordinator continues.

        Each region judges them in the whole string, so none has to wait for another one. It keeps
        the counts of its own agents.
        """
        own, self._composition = self._composition, Composition(world.scene)
        judge_sent(world, inbox, super().events)
        self._composition = own
        others = [each.id for each in agents(world.scene) if own.home(each.id) is None]
        self._counts.remove(others)
        if self._number != HOME:
            self._counts.broken = {}
            self._lines = []
        self._before_judging = self.saved()

    def events(self, frame: int, sources: Sources, people: Collection[str] = ()) -> Sources:
        """The permitted events of a frame, by source; those of agents have been judged already."""
        others = {name: events for name, events in sources.items() if name != AGENTS}
        broken, lines = dict(self._counts.broken), len(self._lines)
        permitted = super().events(frame, others, self.people.union(people))
        if self._number != HOME:  # Generators are the same everywhere, and counted once.
            self._counts.broken = broken
            del self._lines[lines:]
        return {**sources, **permitted}

    def judge(self, frame: int, sent: Sequence[PlacedEvent]) -> Judged:
        """The events that agents of this region have sent, and which of them norms reject."""
        self._before_judging = self.saved()
        if not any(each.event.type in self._judged_types for each in sent):
            return sent, ()
        placed = [single for each in sent for single in self._single(each)]
        acts = [each for each in placed if each.event.type in self._judged_types]
        judged = [*zip([each.event for each in acts], self.crossing(acts), strict=True)]
        permitted: list[AnyEvent] = []
        for later in (False, True):  # As in a world of one coordinator.
            events = [event for event, late in judged if bool(late.any()) == later]
            permitted += super().events(frame, {AGENTS: events})[AGENTS]
        rejected = {id(event) for event, _ in judged} - {id(event) for event in permitted}
        return placed, tuple(n for n, each in enumerate(placed) if id(each.event) in rejected)

    @property
    def counts(self) -> Mapping[str, Any]:
        """What had been counted before the events of the last frame were judged."""
        return self._before_judging

    def _single(self, placed: PlacedEvent) -> Iterator[PlacedEvent]:
        event = placed.event
        if event.type not in self._judged_types:
            yield placed
        elif isinstance(event, Events):
            for row, place in enumerate(placed.places):
                yield PlacedEvent([place], event.event(row))
        else:  # A copy, because an agent may send the same object twice.
            yield PlacedEvent(placed.places, copy(event))

    def forget_judged(self) -> None:
        """Do not count the events of a frame that does not begin."""
        self._counts.broken = dict(self._before_judging["broken"])

    def states(self) -> Figures:
        """The values that norms name, of agents of this region."""
        return _values(self._named, self._state)

    def counts_of(self, moving: Iterable[str]) -> Lately:
        """Remove and return the recent acts of agents that leave the region."""
        return self._counts.remove(moving)

    def parts(
        self,
        regions: Iterable[int],
        moving: Mapping[str, int],
        sanctions: Mapping[int, Sequence[PlacedEvent]],
        later: Mapping[int, Sequence[PlacedEvent]],
    ) -> dict[int, NormPart]:
        """What the norms of each region need: all states, and the rest by region."""
        states = self.states()
        return {
            to: NormPart(
                states,
                self.counts_of([who for who, region in moving.items() if region == to]),
                tuple([each.event for each in sanctions.get(to, ())]),
                tuple([each.event for each in later.get(to, ())]),
            )
            for to in regions
        }

    def take_received(self) -> list[AnyEvent]:
        """Remove and return the sanctions of `later`, when the frame is over."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def take_later(self) -> list[AnyEvent]:
        """Remove and return the sanctions of events that have been judged for the next frame."""
        later, self._sanctions = self._sanctions, []
        return [*later]

    def received(self) -> NormPart:
        """What is known of other regions before a frame, apart from counts, which are saved."""
        return NormPart(self._states, later=tuple(self._waiting))

    def receive(self, parts: Sequence[NormPart]) -> None:
        """Continue with what all regions have sent."""
        self._states = {name: value for part in parts for name, value in part.states.items()}
        for part in parts:
            self._counts.add(part.counts)
            self._waiting += part.later

    def _elsewhere(self, name: str) -> Any:
        return self._states.get(name)


def _agent_of(name: str) -> str:
    """The agent that a norm names as `#id.attribute`."""
    return name[1:].partition(".")[0]


def _values(names: Sequence[str], state_of: Callable[[str], Mapping[str, Any]]) -> Figures:
    values = {name: state_of(_agent_of(name)).get(name.partition(".")[2]) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def judged(world: World) -> Divided:
    """The permitted events that agents had sent before a world continues, as `divided` returns."""
    inbox, lag = FrameInbox(world.past, world.scene), world.lag
    if world.norms:
        counts = world.past.saved.get(SOURCE, {})
        norms = Norms(world.norms, Composition(world.scene), world.vocabulary, counts)
        judge_sent(world, inbox, norms.events)
    late = () if lag is None else inbox.take_postponed(world.past.frame + lag.frames)
    return inbox.emitted, late


def judge_sent(world: World, inbox: FrameInbox, judge: Callable[[int, Sources], Sources]) -> None:
    """Keep the permitted ones of the events that agents had sent before a world continues."""
    frame = world.past.frame
    inbox.emitted = [*judge(frame, {AGENTS: inbox.emitted})[AGENTS]]
    if world.lag is not None:  # Those that have waited longer have been judged.
        later = frame + world.lag.frames
        inbox.postpone(later, judge(frame, {AGENTS: inbox.take_postponed(later)})[AGENTS])


def violations(figures: Mapping[str, Any]) -> dict[str, Any]:
    """The figures that count violations of norms."""
    return {name: value for name, value in figures.items() if name.startswith(BROKEN)}


def total_figures(figures: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The figures of all regions: violations are added, others are those of the first region.

    The members of one region report the figures of all, because generators are equal.
    """
    total = dict(figures[0]) if figures else {}
    for other in figures[1:]:
        for name, count in violations(other).items():
            total[name] = total.get(name, 0) + count
    return total
