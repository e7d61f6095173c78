"""λ of one agent, equation 2, for the events of one frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container, Mapping, Sequence
from typing import Any

from minerva_bus.errors import MinervaError, MisuseError, StateError
from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.events import Event
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
from minerva_bus.source import assignments
from minerva_bus.world.agent import Agent
from minerva_bus.world.context import Context
from minerva_bus.world.kinds import ActivityError, Addressed, Kinds

Activity = Callable[..., Any]


def live(
    node: AgentNode, places: list[int], addressed: Addressed, kinds: Kinds, moment: Context
) -> Scene:
    """What an agent becomes by the events at these places, one after another.

    An agent that λ turns into one of another kind meets the frame's later events as such.
    Raises ActivityError.
    """
    life, pending = AgentStep(node, kinds, moment), deque(places)
    while pending and life.symbol in kinds:
        place, before = pending.popleft(), life.symbol
        life.meet(addressed.event(place))
        if life.symbol != before and life.symbol in kinds:
            later = addressed.places(node.id, kinds[life.symbol].activities)
            pending = deque([one for one in later if one > place])
    return life.string


class AgentStep:
    """One agent within a frame, and all that it has made of itself so far."""

    def __init__(
        self, node: AgentNode, kinds: Kinds, moment: Context, agent: Agent | None = None
    ) -> None:
        self._node = node
        self._kinds = kinds
        self._moment = moment
        self._around = scene_of(node)
        self._inside = identities(node.scope)  # perhaps very deep; the agent is not in it
        self._agent = agent
        self._ran: list[tuple[Activity, Event]] = []
        self.symbol = node.symbol
        """Of the kind that it is of now; empty when it is no more."""

    def meet(self, event: Event) -> None:
        """Live through one event that concerns it. Raises ActivityError."""
        agent = self._agent
        if agent is None:
            agent = self._agent = self._thawed(self._node, event)
        self._event = event
        if event.condition and not holds(event.condition, self._now(agent, event).state):
            return
        probability = agent.kind.chance(event.type)
        if probability == 1.0 or self._answers(agent, event, probability):
            self.become(self._activity(agent, event), event)

    def _answers(self, agent: Agent, event: Event, probability: float | str) -> bool:
        """Whether it answers an event that it answers by chance."""
        if isinstance(probability, str):
            state: Mapping[str, Any] = self._now(agent, event).state
            return self._moment.answers(event.type, state[probability])
        return self._moment.answers(event.type, probability)

    def returned(self, activity: Activity, result: object, event: Event) -> None:
        """Take what an activity has returned elsewhere. Raises ActivityError."""
        self._ran.append((activity, event))
        try:
            scene = checked(result)
        except TypeError as error:
            raise self._failed(activity, event) from error
        self.become(scene, event)

    def become(self, result: Scene | None, event: Event) -> None:
        """Take what λ has returned."""
        self._event = event
        agent, who = self._agent, self._node.id
        if result is None or agent is None:
            return
        self._around = _put(self._around, who, result, self._inside)
        own = self._own(result, event)
        if own is None:
            self.symbol = ""
            return
        self.symbol = own.symbol
        counted = agent.counted(own)
        if own.symbol in self._kinds:
            self._agent = self._thawed(counted, event)
        else:
            self._agent = None
            self._around = _put(self._around, who, scene_of(counted), self._inside)

    @property
    def string(self) -> Scene:
        """What it is now, with all that it has put beside itself."""
        if self._agent is None or not self.symbol:
            return self._around
        now = scene_of(self._now(self._agent, self._event))
        return _put(self._around, self._node.id, now, self._inside)

    def _activity(self, agent: Agent, event: Event) -> Scene | None:
        """λ(a, e); None where the agent stays and has changed itself."""
        activity = agent.activities[event.type]
        self._ran.append((activity, event))
        try:
            return checked(activity(agent, event, self._moment))
        except (Exception, SystemExit) as error:
            raise self._failed(activity, event) from error

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
        """The agent itself in what its λ returned."""
        found = [agent for agent in agents(result, self._inside) if agent.id == self._node.id]
        if len(found) > 1:
            twice = MisuseError(f"it returned {len(found)} agents with the id #{self._node.id}")
            raise self._failed(self._ran[-1][0], event) from twice
        return found[0] if found else None

    def _failed(self, activity: Activity | None, event: Event) -> ActivityError:
        return ActivityError(activity, self._node, event, self._moment.number)


def at_fault(
    ran: Sequence[tuple[Activity, Event]], event: Event, error: MinervaError
) -> tuple[Activity | None, Event]:
    """Which of the activities that ran, each with its event, set the attribute that is wrong.

    It is the last one that sets it, or else the last one; before any has run, None, at `event`.
    """
    attribute = error.attribute if isinstance(error, StateError) else ""
    setters = [one for one in ran if attribute and assignments(one[0], attribute)]
    return (*setters[-1:], *ran[-1:], (None, event))[0]


def checked(result: object) -> Scene | None:
    """What an activity may return. Raises TypeError."""
    if isinstance(result, Agent):
        raise TypeError(f"an activity returns None or a string: self.string, not {result!r:.60}")
    if result is not None and not isinstance(result, Scene):
        raise TypeError(f"an activity returns None or a string, not {result!r:.200}")
    return result


def _put(scene: Scene, agent_id: str, result: Scene, inside: Container[int]) -> Scene:
    """The string with one agent replaced."""
    if len(scene.nodes) == 1 and getattr(scene.nodes[0], "id", None) == agent_id:
        return result

    def leave(node: Node, scope: Scene) -> Scene | Node:
        own = isinstance(node, AgentNode) and node.id == agent_id
        return result if own else rescoped(node, scope)

    return rebuild(scene, leave, inside)
