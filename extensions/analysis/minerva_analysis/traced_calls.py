"""The calls of λ for one agent in a frame, computed again.

A frame's result does not contain the method that made it. An agent within another one is changed by
its own methods first, then by those of the agents around it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode, Scene, agents, walk, with_scope
from minerva_bus.world.agent import ActivityError, Kinds
from minerva_bus.world.agent_evolution import AgentStep, process_all
from minerva_bus.world.context import Context, Frame
from minerva_bus.world.event_collection import Addressed
from minerva_bus.world.evolution import evolve


@dataclass(frozen=True, slots=True)
class TracedCall:
    """One call of a method: of the agent `caller`, for `event` or a batch that begins with it.

    `emitted` are the events that this call sent, `string` what the agent has become after it.
    """

    caller: AgentNode
    method: Callable[..., Any]
    event: Event
    emitted: tuple[Event, ...]
    string: Scene

    def agent(self, name: str) -> AgentNode | None:
        """The agent with an id after the call; None if it is gone."""
        return next((agent for agent in agents(self.string) if agent.id == name), None)


class _TracedStep(AgentStep):
    """An agent that processes its events, with a list of the calls."""

    def __init__(self, node: AgentNode, kinds: Kinds, context: Context) -> None:
        super().__init__(node, kinds, context)
        self.calls: list[TracedCall] = []
        self._sent = 0

    def become(self, result: Scene | None, event: Event) -> None:
        super().become(result, event)
        emitted = self.context.emitted
        sent, self._sent = tuple(emitted[self._sent :]), len(emitted)
        try:
            string = self.string
        # A state is only checked when it is needed, so it may be invalid between two events.
        except ActivityError:
            string = self.calls[-1].string if self.calls else Scene((self._node,))
        self.calls.append(TracedCall(self._node, self._ran[-1][0], event, sent, string))


def trace_calls(
    around: Scene, name: str, events: Addressed, kinds: Kinds, frame: Frame
) -> list[TracedCall]:
    """The calls of a frame for the agent `name` and those around it, in order.

    Args:
        around: the part of the string that is the agent, or contains it.
        name: an id.
        events: those of the frame, in order.
        kinds: agent classes; agents of other kinds do not change.
        frame: for random numbers and the time.

    Raises:
        ActivityError: code of an agent fails.

    """
    calls: list[TracedCall] = []
    for agent in reversed(_path(around, name)):
        cls = kinds.get(agent.symbol)
        concerning = [] if cls is None else events.to(agent.id, cls.activities)
        if not concerning:
            continue
        # A scope is evolved before the agent around it (equation 3).
        node = with_scope(agent, evolve(agent.scope, events, kinds, frame).scene)
        step = _TracedStep(node, kinds, Context(frame, f"#{agent.id}"))
        process_all(step, agent.id, events, concerning, kinds)
        calls += step.calls
    return calls


def _path(around: Scene, name: str) -> list[AgentNode]:
    """The agents from the outermost one down to the one with an id."""
    path: list[AgentNode] = []
    for opens, node in walk(around):
        if not isinstance(node, AgentNode):
            continue
        if not opens:
            path.pop()
            continue
        path.append(node)
        if node.id == name:
            return path
    return []
