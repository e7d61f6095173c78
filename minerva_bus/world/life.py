"""λ of one agent, equation 2, for the events of one frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Container

from minerva_bus.errors import MinervaError, MisuseError
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
from minerva_bus.world.agent import Agent
from minerva_bus.world.kinds import ActivityError, Addressed, Kinds
from minerva_bus.world.moment import Moment


def live(
    node: AgentNode, places: list[int], addressed: Addressed, kinds: Kinds, moment: Moment
) -> Scene:
    """What an agent becomes by the events at these places, one after another.

    An agent that λ turns into one of another kind meets the frame's later events as such.
    Raises ActivityError.
    """
    around, pending = scene_of(node), deque(places)
    inside = identities(node.scope)  # perhaps very deep, and the agent itself is not in it
    event = addressed.events[places[0]]
    agent = _thawed(kinds[node.symbol], node, event, moment)
    while pending:
        place = pending.popleft()
        event = addressed.events[place]
        if event.condition and not holds(event.condition, _now(agent, node, event, moment).state):
            continue
        result = _activity(agent, node, event, moment)
        if result is None:
            continue
        around = _put(around, node.id, result, inside)
        own = _own(result, inside, node, event, moment)
        cls = kinds.get(own.symbol) if own is not None else None
        if own is None:
            return around
        if cls is None:
            return _put(around, node.id, scene_of(agent.counted(own)), inside)
        if cls is not type(agent):
            later = addressed.places(node.id, cls.activities)
            pending = deque([one for one in later if one > place])
        agent = _thawed(cls, agent.counted(own), event, moment)
    return _put(around, node.id, scene_of(_now(agent, node, event, moment)), inside)


def _activity(agent: Agent, node: AgentNode, event: Event, moment: Moment) -> Scene | None:
    """λ(a, e); None where the agent stays and has changed itself."""
    try:
        result = agent.activities[event.type](agent, event, moment)
        if result is not None and not isinstance(result, Scene):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise TypeError(f"an activity returns None or a string, not {result!r}")
        return result
    except Exception as error:
        raise ActivityError("λ", node, event, moment.number) from error


def _thawed(cls: type[Agent], node: AgentNode, event: Event, moment: Moment) -> Agent:
    """The agent that a node describes."""
    try:
        return cls.thaw(node)
    except MinervaError as error:
        raise ActivityError("the state", node, event, moment.number) from error


def _now(agent: Agent, node: AgentNode, event: Event, moment: Moment) -> AgentNode:
    """The agent as it is between two events."""
    try:
        return agent.freeze()
    except MinervaError as error:
        raise ActivityError("the state", node, event, moment.number) from error


def _own(
    result: Scene, inside: Container[int], node: AgentNode, event: Event, moment: Moment
) -> AgentNode | None:
    """The agent itself in what its λ returned."""
    found = [agent for agent in agents(result, inside) if agent.id == node.id]
    if len(found) > 1:
        twice = MisuseError(f"it returned {len(found)} agents with the id #{node.id}")
        raise ActivityError("λ", node, event, moment.number) from twice
    return found[0] if found else None


def _put(scene: Scene, agent_id: str, result: Scene, inside: Container[int]) -> Scene:
    """The string with one agent replaced."""
    if len(scene.nodes) == 1 and getattr(scene.nodes[0], "id", None) == agent_id:
        return result

    def leave(node: Node, scope: Scene) -> Scene | Node:
        own = isinstance(node, AgentNode) and node.id == agent_id
        return result if own else rescoped(node, scope)

    return rebuild(scene, leave, inside)
