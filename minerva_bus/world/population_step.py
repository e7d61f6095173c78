"""η of agents that are held in columns: what equation 3 makes of them, all at once.

Each of them lives through its events in their order, as in `life`. What is written for one agent
runs for one after another; what is written for a population runs on arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby, repeat
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.columns import Columns, Rows
from minerva_bus.grammar.condition import holds_of_many
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.world.addressing import Round, narrowed, turns
from minerva_bus.world.agent import Agent
from minerva_bus.world.agent_step import AgentStep, at_fault
from minerva_bus.world.assembling import Unsound, assembled, emissions
from minerva_bus.world.context import Context, Frame
from minerva_bus.world.declaring import TOGETHER
from minerva_bus.world.kinds import ActivityError, Addressed, Kinds
from minerva_bus.world.population import (
    BatchContext,
    EventBatch,
    Population,
    PopulationState,
    returns_nothing,
)
from minerva_bus.world.row_adapter import RowAdapter
from minerva_bus.world.streams import RowContext, Streams


class PopulationStep:
    """Agents in columns within a frame.

    They take three forms: `_herd` has arrays that populations work on; `_objects` has those that
    have been spoken to one by one; `_lives` has those that have returned a string, and may be
    several by now, or none, or of another kind.
    """

    def __init__(self, part: Columns, kinds: Kinds, frame: Frame) -> None:
        self._ids = cast("Ids", part.ids)
        self._kinds = kinds
        self._frame = frame
        self._cls = kinds[part.symbol]
        self._herd = PopulationState(part, self._cls.kind.fields)
        self._draws = Streams(self._ids, frame)
        self._by_chance = dict(self._cls.kind.chances)
        self._objects = RowAdapter(self._cls, self._herd)
        self._lives: dict[int, tuple[AgentStep, Context]] = {}
        self._said: list[tuple[int, Sequence[Event]]] = []
        self._ran: list[tuple[Callable[..., Any], AnyEvent]] = []

    def meet(self, addressed: Addressed) -> None:
        """Live through a frame's events. Raises ActivityError."""
        for event_type, group in groupby(addressed.events, lambda event: event.type):
            if event_type not in self._cls.activities and not self._lives:
                continue
            population = self._cls.population.get(event_type)
            activity = population or self._cls.activities.get(event_type)
            if population is not None and getattr(population, TOGETHER, False):
                self._together(population, list(group))
                continue
            for event, rows in self._rounds(group):
                if population is not None:
                    given = EventBatch(event) if isinstance(event, Events) else event
                    self._as_population(population, given, event, rows)
                elif activity is not None:
                    self._one_by_one(activity, event, rows)

    # --- who is concerned ---

    def _rounds(
        self, items: Iterator[AnyEvent] | Sequence[AnyEvent], *, at_once: bool = False
    ) -> Iterator[Round]:
        """Events by turns, for those that are mere rows; the others live through theirs here.

        Where all are wanted `at_once` a row may be there several times.
        """
        for item in items:
            for event, rows in turns(item, self._ids, at_once=at_once and not self._lives):
                if self._lives:
                    self._live_on(event, rows)
                keep = None if self._herd.away is None else ~self._herd.away
                if item.condition:
                    keep = self._willing(event, keep)
                left = (event, rows) if keep is None else narrowed(event, rows, keep)
                if left is not None and item.type in self._by_chance:
                    left = self._answering(*left)
                if left is not None:
                    yield left

    def _answering(self, event: AnyEvent, rows: Rows | None) -> Round | None:
        """Those who answer an event that they answer by chance."""
        probability: Any = self._by_chance[event.type]
        if isinstance(probability, str):
            self._settle(event)
            values = self._herd.value(probability)
            probability = values if rows is None else values[rows]
        answers = self._draws.answers(event.type, rows, probability)
        keep = np.ones(len(self._ids), np.bool_)
        keep[slice(None) if rows is None else rows] = answers
        return narrowed(event, rows, keep)

    def _willing(self, event: AnyEvent, keep: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        """Those for whom the condition holds."""
        self._settle(event)
        state = {name: self._herd.value(name) for name in self._herd.fields.names}
        willing = holds_of_many(event.condition, state, len(self._ids))
        return willing if keep is None else willing & keep

    def _live_on(self, event: AnyEvent, rows: Rows | None) -> None:
        at = None if rows is None else {row: n for n, row in enumerate(rows.tolist())}
        for row, (life, _) in self._lives.items():
            cls = self._kinds.get(life.symbol)
            if cls is None or event.type not in cls.activities or not (at is None or row in at):
                continue
            place = at[row] if at is not None else 0
            life.meet(event if isinstance(event, Event) else event.event(place))

    # --- what is written for populations ---

    def _together(self, activity: Callable[..., Any], items: Sequence[AnyEvent]) -> None:
        """All events of a type at once."""
        many, row, chosen = self._mine(items)
        if not len(row):
            return
        there = np.zeros(len(self._ids), np.bool_)
        there[row] = True
        concerned = None if there.all() else np.flatnonzero(there)
        if concerned is not None:
            place = np.empty(len(self._ids), np.intp)
            place[concerned] = np.arange(len(concerned))
            row = place[row]
        one = many if chosen is None else many.take(chosen[:1])
        self._as_population(activity, EventBatch(many, row, chosen), one, concerned)

    def _mine(self, items: Sequence[AnyEvent]) -> tuple[Events, Rows, Rows | None]:
        """Events of one type, the row of each, and which of them are for somebody here."""
        first = items[0]
        simple = len(items) == 1 and not self._lives and self._herd.away is None
        simple &= first.type not in self._by_chance
        if simple and isinstance(first, Events) and first.receivers and not first.condition:
            rows = self._ids.rows_of(first.receivers)
            chosen = np.flatnonzero(rows >= 0)
            return (
                (first, rows, None) if len(chosen) == len(rows) else (first, rows[chosen], chosen)
            )
        rounds = list(self._rounds(items, at_once=True))
        if not rounds:
            return Events(first.type, (), (), 0), np.empty(0, np.intp), None
        everyone = np.arange(len(self._ids))
        every = [everyone if some is None else some for _, some in rounds]
        events = [
            event if isinstance(event, Events) else Events.repeated(event, len(some))
            for (event, _), some in zip(rounds, every, strict=True)
        ]
        many = Events.concatenated(events)
        if many is None:
            raise MisuseError(f"{first.type} comes in forms that cannot be taken together")
        return many, np.concatenate(every), None

    def _as_population(
        self, activity: Callable[..., Any], given: Any, event: AnyEvent, rows: Rows | None
    ) -> None:
        if rows is not None and len(rows) == len(self._ids):
            rows = None  # everybody, and nobody twice
        self._settle(event)
        self._objects.forget()
        self._draws.gather()
        self._herd.turn += 1
        people = Population(self._herd, self._cls, rows)
        self._ran.append((activity, event))
        try:
            returns_nothing(activity(people, given, self._moments(people, rows)))
        except (Exception, SystemExit) as error:
            row = 0 if rows is None else int(rows[0])
            raise self._failed(activity, row, event) from error

    def _moments(self, people: Population, rows: Rows | None) -> BatchContext:
        return BatchContext(self._frame, self._draws.many, people, rows)

    # --- what is written for one agent ---

    def _one_by_one(self, activity: Callable[..., Any], some: AnyEvent, rows: Rows | None) -> None:
        agents = self._objects.of(rows)
        chosen = range(len(agents)) if rows is None else rows.tolist()
        events = some if isinstance(some, Events) else repeat(some, len(agents))
        returned: list[tuple[int, Agent, Any, Event]] = []
        moment = RowContext(self._frame, self._draws)
        row, event = 0, cast("Event", some)
        self._ran.append((activity, some))
        try:
            for row, agent, event in zip(chosen, agents, events, strict=True):
                moment.agent, moment.row = agent, row
                result = activity(agent, event, moment)
                if moment.emitted:
                    self._said.append((row, moment.emitted))
                    moment.emitted = []
                if result is not None:
                    returned.append((row, agent, result, event))
        except (Exception, SystemExit) as error:
            raise self._failed(activity, row, event) from error
        for row, agent, result, event in returned:
            self._let_go(row, agent, activity, result, event)

    def _let_go(
        self, row: int, agent: Agent, activity: Callable[..., Any], result: Any, event: Event
    ) -> None:
        """From now on it is more, or less, or other than a row."""
        moment = Context(self._frame, "#" + agent.id)
        self._draws.lend(row, moment)
        life = AgentStep(self._node(row), self._kinds, moment, agent)
        life.returned(activity, result, event)
        self._lives[row] = life, moment
        self._herd.leave(row)
        self._objects.drop(row)

    def _settle(self, event: AnyEvent) -> None:
        """Put into the arrays what has been said to agents one by one."""
        try:
            grown = self._objects.settle()
        except MinervaError as error:
            raise self._unsound(self._objects.at_fault, event, error) from error
        for row, agent in grown:
            alone = event if isinstance(event, Event) else event.event(0)
            self._let_go(row, agent, self._ran[-1][0], agent.string, alone)

    # --- the end of the frame ---

    def end(self, event: AnyEvent) -> tuple[Scene, tuple[AnyEvent, ...]]:
        """The string that has come of them, and what they have sent, by type and in order."""
        self._settle(event)
        lives = {row: life.string for row, (life, _) in sorted(self._lives.items())}
        said = [*self._said]
        said += [(row, moment.emitted) for row, (_, moment) in sorted(self._lives.items())]
        try:
            scene = assembled(self._herd, lives)
        except Unsound as error:
            raise self._unsound(error.row, event, error) from error
        if len(scene.pieces) == 1 and isinstance(scene.pieces[0], Columns):
            self._objects.keep(scene.pieces[0])
        return scene, emissions(self._herd.said, said)

    def _node(self, row: int) -> AgentNode:
        return cast("AgentNode", self._herd.part.node(row))

    def _unsound(self, row: int, event: AnyEvent, error: MinervaError) -> ActivityError:
        """The state of an agent is wrong: by which activity, as far as can be seen."""
        ran = [(activity, _alone(one)) for activity, one in self._ran]
        activity, alone = at_fault(ran, _alone(event), error)
        return self._failed(activity, row, alone)

    def _failed(
        self, activity: Callable[..., Any] | None, row: int, event: AnyEvent
    ) -> ActivityError:
        return ActivityError(activity, self._node(row), _alone(event), self._frame.number)


def _alone(event: AnyEvent) -> Event:
    return event if isinstance(event, Event) else event.event(0)


def evolve_many(
    part: Columns, addressed: Addressed, kinds: Kinds, frame: Frame
) -> tuple[Scene, tuple[AnyEvent, ...]]:
    """η of agents in columns, and the events that they sent. Raises ActivityError."""
    cls = kinds[part.symbol]
    if not addressed.types & cls.activities.keys():
        return Scene((part,)), ()
    crowd = PopulationStep(part, kinds, frame)
    crowd.meet(addressed)
    return crowd.end(addressed.events[-1])
