"""λ of one agent (equation 2): `evolve_agent`, event by event in an `AgentStep`.

λ of agents in columns, all at once, is in world/population_step.py.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from functools import cached_property
from itertools import takewhile
from typing import Any

import numpy as np

from minerva_bus.errors import MinervaError, MisuseError, StateError
from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.events import AnyEvent, Event, Events, as_batch
from minerva_bus.grammar.scene import (
    AgentNode,
    Node,
    Scene,
    agents,
    identities,
    rebuild,
    rescoped,
    scene_of,
)
from minerva_bus.user_code import assignments
from minerva_bus.world.agent import OWN, ActivityError, Agent, Kinds
from minerva_bus.world.context import Context
from minerva_bus.world.event_collection import Addressed
from minerva_bus.world.population import EventBatch, merged

Activity = Callable[..., Any]


def evolve_agent(
    node: AgentNode, receiver: str, events: Addressed, kinds: Kinds, context: Context
) -> Scene | AgentNode:
    """The result of a frame's events, in order; the same node if none concerns the agent.

    Its events are those for the id `receiver`, which for a copy is the id of the copied agent. An
    agent that λ turns into another kind processes later events as that kind. Raises ActivityError.
    """
    concerning = events.to(receiver, kinds[node.symbol].activities)
    if not concerning:
        return node
    return process_all(AgentStep(node, kinds, context), receiver, events, concerning, kinds)


def process_all(
    step: AgentStep,
    receiver: str,
    events: Addressed,
    concerning: Sequence[tuple[int, AnyEvent]],
    kinds: Kinds,
) -> Scene:
    """Process the events concerning an agent, also as the kinds that λ turns it into."""
    while concerning:
        symbol = step.symbol
        index = step.process(concerning)
        if step.symbol == symbol or step.symbol not in kinds:
            break
        # The new kind may respond to other types. Events before this one are over.
        concerning = events.to(receiver, kinds[step.symbol].activities, after=index)
    return step.string


class AgentStep:
    """One agent processing its events within a frame, and the string that it has become so far."""

    def __init__(
        self, node: AgentNode, kinds: Kinds, context: Context, agent: Agent | None = None
    ) -> None:
        self._node = node
        self._kinds = kinds
        self.context = context
        """The context of its activities, with the events that they have emitted."""
        self._around: Scene | None = None  # unlike the agent alone
        self._agent = agent
        self._ran: list[tuple[Activity, Event]] = []
        self.symbol = node.symbol
        """Symbol of its current kind; empty once it is gone."""

    @cached_property
    def _inside(self) -> frozenset[int]:
        """The nodes that searches skip, because the agent is not in its scope."""
        return identities(self._node.scope)

    def process(self, events: Sequence[tuple[int, AnyEvent]]) -> int:
        """Process events that concern it until its kind changes. Raises ActivityError.

        Returns the index of the last event processed.
        """
        symbol, batches, place, index = self.symbol, self._batches(), 0, -1
        while place < len(events) and self.symbol == symbol:
            index, event = events[place]
            place += 1
            if event.type in batches:
                # Events are ordered by type first, so those of one type are neighbours.
                same = [item for _, item in takewhile(_of_type(event.type), events[place:])]
                place += len(same)
                index = events[place - 1][0]
                for batch in merged([event, *same]) if same else (event,):
                    self.process_event(batch)
            elif isinstance(event, Event):  # the usual case, without the checks for batches
                self._process_single(event)
            else:
                self.process_event(event)
        return index

    def process_event(self, event: AnyEvent) -> None:
        """Process an event, or the events of a batch in order. Raises ActivityError."""
        if isinstance(event, Event) and event.type not in self._batches():
            self._process_single(event)
            return
        start, count = 0, len(event)
        while start < count and self._responds(event.type):
            rest = event.take(slice(start, None)) if start and isinstance(event, Events) else event
            if event.type in self._batches():
                self._process_batch(rest)
                return
            # An activity may change the kind, whose methods then process the rest of the batch.
            symbol = self.symbol
            for each in rest:
                self._process_single(each)
                start += 1
                if self.symbol != symbol:
                    break

    def _responds(self, event_type: str) -> bool:
        cls = self._kinds.get(self.symbol)
        return cls is not None and event_type in cls.activities

    def _batches(self) -> frozenset[str]:
        cls = self._kinds.get(self.symbol)
        return cls.batches if cls is not None else frozenset()

    def _process_batch(self, event: AnyEvent) -> None:
        events = as_batch(event)
        chosen = self._answered(events)
        if chosen.count:
            first = chosen.event(0)
            agent = self._thawed_once(first)
            batch = EventBatch(chosen, np.zeros(chosen.count, np.intp))
            self.become(self._run(agent, first, batch), first)

    def _answered(self, events: Events) -> Events:
        """The events whose condition holds now, except those that it ignores by chance."""
        first = events.event(0)
        agent = self._thawed_once(first)
        # One check suffices: the method gets all events in one call, so the state is the same for
        # each.
        if events.condition and not holds(events.condition, self._now(agent, first).state):
            return events.take(slice(0, 0))
        probability = agent.kind.chance(events.type)
        if probability == 1.0:
            return events
        # Each event takes a draw of its own, as it does for a population.
        rows = [row for row in range(events.count) if self._answers(agent, first, probability)]
        return events.take(np.array(rows, np.intp))

    def _process_single(self, event: Event) -> None:
        agent = self._agent
        if agent is None:
            agent = self._agent = self._thawed(self._node, event)
        self._event = event
        if event.condition and not holds(event.condition, self._now(agent, event).state):
            return
        probability = agent.kind.chance(event.type)
        if probability == 1.0 or self._answers(agent, event, probability):
            self.become(self._run(agent, event, event), event)

    def _thawed_once(self, event: Event) -> Agent:
        self._event = event
        if self._agent is None:
            self._agent = self._thawed(self._node, event)
        return self._agent

    def _answers(self, agent: Agent, event: Event, probability: float | str) -> bool:
        """Whether it responds to an event that it responds to with a probability."""
        if isinstance(probability, str):
            state: Mapping[str, Any] = self._now(agent, event).state
            return self.context.answers(event.type, state[probability])
        return self.context.answers(event.type, probability)

    def returned(self, activity: Activity, result: object, event: Event) -> None:
        """Continue with the result of an activity that ran in rows. Raises ActivityError."""
        self._ran.append((activity, event))
        try:
            scene = checked(result)
        except TypeError as error:
            raise self._failed(activity, event) from error
        self.become(scene, event)

    def become(self, result: Scene | None, event: Event) -> None:
        """Continue with the result of λ."""
        self._event = event
        agent = self._agent
        if result is None or agent is None:
            return
        self._around = self._with(result)
        own = self._own(result, event)
        if own is None:
            self.symbol = ""
            return
        self.symbol = own.symbol
        counted = agent.counted(own)
        if own.symbol in self._kinds:
            self._agent = self._thawed(counted, event)
        else:
            # This host has no class for the new kind, so the agent processes no further event in
            # this frame.
            self._agent = None
            self._around = self._with(scene_of(counted))

    @property
    def string(self) -> Scene:
        """The agent in its current state, with the nodes that λ has placed beside it."""
        if self._agent is None or not self.symbol:
            return scene_of(self._node) if self._around is None else self._around
        return self._with(Scene((self._now(self._agent, self._event),)))

    def _with(self, result: Scene) -> Scene:
        """The string with this result in place of the agent."""
        around = self._around
        return result if around is None else _put(around, self._node.id, result, self._inside)

    def _run(self, agent: Agent, event: Event, given: Event | EventBatch) -> Scene | None:
        """λ(a, e); None if the agent has changed its own state."""
        activity = agent.activities[event.type]
        self._ran.append((activity, event))
        try:
            made = checked(activity(agent, given, self.context))
            if made is None and "_born" in agent.__dict__ and self._is_lost(agent):
                raise TypeError("its newborn would be lost: return self.string + self.child(...)")
            return made
        except KeyboardInterrupt:
            raise
        # `sys.exit()` in a method is a failure of that method; it must not end the host's process.
        except BaseException as error:
            raise self._failed(activity, event) from error

    def _is_lost(self, agent: Agent) -> bool:
        """Whether nothing that lasts can have the string of a newborn: attributes and events."""
        state = agent.__dict__
        kept = len(state) > len(agent.kind.fields.names) + len(OWN) + 1 or self.context.emitted
        strings = [value for value in state.values() if isinstance(value, Scene)]
        return not kept and len(strings) == 1 and agent.scope is self._node.scope

    def _thawed(self, node: AgentNode, event: Event) -> Agent:
        """The agent that a node describes."""
        try:
            return self._kinds[node.symbol].thaw(node)
        except MinervaError as error:
            raise self._failed(None, event) from error

    def _now(self, agent: Agent, event: Event) -> AgentNode:
        """The agent as it is between two events."""
        try:
            return agent.freeze()
        except MinervaError as error:
            raise self._failed(*at_fault(self._ran, event, error)) from error

    def _own(self, result: Scene, event: Event) -> AgentNode | None:
        """The agent itself within a result of λ."""
        own = [agent for agent in agents(result, self._inside) if agent.id == self._node.id]
        # Two agents with one id could not be told apart by later events, nor by the next frame.
        if len(own) > 1:
            twice = MisuseError(f"it returned {len(own)} agents with the id #{self._node.id}")
            raise self._failed(self._ran[-1][0], event) from twice
        return own[0] if own else None

    def _failed(self, activity: Activity | None, event: Event) -> ActivityError:
        return ActivityError(activity, self._node, event, self.context.number)


def _of_type(event_type: str) -> Callable[[tuple[int, AnyEvent]], bool]:
    return lambda pair: pair[1].type == event_type


def at_fault(
    ran: Sequence[tuple[Activity, Event]], event: Event, error: MinervaError
) -> tuple[Activity | None, Event]:
    """The activity, with its event, that probably caused an invalid attribute.

    The last one whose source assigns the attribute, else the last one that ran. None, with `event`,
    if none has run.
    """
    attribute = error.attribute if isinstance(error, StateError) else ""
    # A heuristic on source text: states are checked when needed, not after each activity.
    setters = [entry for entry in ran if attribute and assignments(entry[0], attribute)]
    return (*setters[-1:], *ran[-1:], (None, event))[0]


def checked(result: object) -> Scene | None:
    """The result of an activity, if it is None or a string. Raises TypeError."""
    if isinstance(result, Agent):
        raise TypeError(f"an activity returns None or a string: self.string, not {result!r:.60}")
    if result is not None and not isinstance(result, Scene):
        raise TypeError(
            f"an activity returns None or a string, not {result!r:.200}; assign attributes of self"
            " and return nothing"
        )
    return result


def _put(scene: Scene, agent_id: str, result: Scene, inside: Container[int]) -> Scene:
    """The string with one agent replaced."""

    def leave(node: Node, scope: Scene) -> Scene | Node:
        own = isinstance(node, AgentNode) and node.id == agent_id
        return result if own else rescoped(node, scope)

    return rebuild(scene, leave, inside)
