"""η, the evolution of a string (equation 3), and its policies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, TypeAlias

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns, rewritten
from minerva_bus.grammar.events import AnyEvent, Event, single
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    Node,
    Scene,
    agents,
    checked_string,
    rebuild,
    rescoped,
    walk,
)
from minerva_bus.values import fast_dataclass
from minerva_bus.world.agent import Agent, Kinds, kinds_of
from minerva_bus.world.agent_evolution import evolve_agent
from minerva_bus.world.context import Context, Frame
from minerva_bus.world.event_collection import Addressed, addressed
from minerva_bus.world.population import copy_id, newest_copy
from minerva_bus.world.population_step import evolve_population

Division: TypeAlias = Callable[[Addressed], Sequence[Addressed]]


@fast_dataclass
class PolicyRules:
    """Everything that depends on the policy of a world.

    Args:
        divide: the events that each copy of an agent processes, from the events of a frame. The
            first copy is the agent. There is one copy, or there are at most as many as events.
        makes_copies: whether there may be several copies, or none. Each agent is then a fragment
            of its own, ids of copies derive from its id (world/population.py), and one host evolves
            all agents.
        without_events: whether agents may change in a frame without events that concern them. The
            host then evolves them in every frame, and the world never rests.

    """

    divide: Division
    makes_copies: bool = False
    without_events: bool = False


def _each(events: Addressed) -> Sequence[Addressed]:
    return [Addressed((event,)) for event in single(events.events)]


class Policy(Enum):
    """Reading of equation 3 for an agent with several events in a frame, or none.

    - SEQUENTIAL: the agent processes its events in order; without events it does not change.
    - LITERAL: the equation to the letter: one copy of the agent for each event of the frame,
      whether or not the event concerns it, and no copy in a frame without events.

    A policy is a name with its rules; no other code compares policies.
    """

    _value_: str
    rules: PolicyRules

    SEQUENTIAL = "sequential", PolicyRules(lambda events: (events,))
    LITERAL = "literal", PolicyRules(_each, makes_copies=True, without_events=True)

    def __new__(cls, name: str, rules: PolicyRules) -> Policy:
        """A member whose value is its name."""
        policy = object.__new__(cls)
        policy._value_ = name
        policy.rules = rules
        return policy


@dataclass(frozen=True, slots=True)
class Evolved:
    """The result of η, and the events that λ emitted, which belong to the next frame.

    `emitted` has the events of single agents by id, `batches` those of populations. The key of
    events from copies is the id of the copied agent; their sender is the copy.
    """

    scene: Scene
    emitted: dict[str, tuple[Event, ...]]
    batches: tuple[AnyEvent, ...] = ()


_FIRST = Frame()
MOST_COPIES: Final = 1_000_000
"""Maximum number of agents that a frame may make of a fragment by copying."""


def evolve(
    scene: Scene,
    events: Sequence[AnyEvent] | Addressed,
    kinds: Iterable[type[Agent]] | Kinds,
    frame: Frame = _FIRST,
    policy: Policy = Policy.SEQUENTIAL,
) -> Evolved:
    """η(w, e^v), equation 3: every agent processes its events, scopes before their agents.

    Ids of copies contain the frame's number, or a higher one if the string already has copies of
    later frames.

    Args:
        scene: w, checked by its vocabulary.
        events: e^v, in the world's order.
        kinds: agent classes; agents of other kinds do not change.
        frame: its number, duration and seed, for random numbers and `moment`.
        policy: how an agent processes several events.

    Returns:
        `scene`, the next string, and `emitted`, the events of each agent, by id.

    Raises:
        ActivityError: code of an agent fails.
        MisuseError: an argument is of a wrong type; before there are too many copies.

    Example:
        >>> evolve(Fox("f1", energy=0.5).string, [eHunger(amount=1.0)], [Fox]).scene == EMPTY
        True

    """
    checked_string(scene)
    if not isinstance(frame, Frame):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"frame must be a Frame, such as Frame(3), not {frame!r:.60}")
    if not isinstance(policy, Policy):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"policy must be a Policy, such as {Policy.LITERAL}, not {policy!r:.60}")
    eta = _Eta(policy.rules.divide(addressed(events)), kinds_of(kinds), frame, {}, [])
    if len(eta.copies) > 1:
        _check_few(scene, len(eta.copies), frame, policy)
        last = newest_copy(agent.id for agent in agents(scene))
        eta.copying = max(frame.number, last + 1)
    return Evolved(rewritten(scene, eta.node, eta.columns), eta.emitted, tuple(eta.batches))


@dataclass(slots=True)
class _Eta:
    """η of one frame: the events for each copy, and the emitted events."""

    copies: Sequence[Addressed]
    kinds: Kinds
    frame: Frame
    emitted: dict[str, tuple[Event, ...]]
    batches: list[AnyEvent]
    copying: int = 0

    def columns(self, part: Columns) -> Scene | None:
        """Evolve agents in columns at once; None if they must be evolved as nodes."""
        # Columns without ids are figures or transformations, which do not evolve.
        if part.ids is None or part.symbol not in self.kinds:
            return Scene((part,))
        if len(self.copies) != 1:
            return None  # each row becomes several neighbouring agents, which arrays cannot hold
        scene, sent = evolve_population(part, self.copies[0], self.kinds, self.frame)
        self.batches += sent
        return scene

    def node(self, node: Node, scope: Scene) -> Scene | Node:
        """Evolve an agent, in as many copies as the policy requires."""
        height = 0
        if len(self.copies) > 1 and isinstance(node, AgentNode):
            # The nesting before this frame. λ may empty a scope, and two agents around it with
            # equal heights would then give copies of an agent within both the same id.
            height = 1 + _nesting(node.scope)
        node = rescoped(node, scope)
        if not isinstance(node, AgentNode) or node.symbol not in self.kinds:
            return node
        if len(self.copies) == 1:
            return self._lambda(node, self.copies[0], node.id)
        made: list[Node] = []
        for number, events in enumerate(self.copies, 1):
            copy = node if number == 1 else self.copy(node, number, height)
            result = self._lambda(copy, events, node.id)
            made += result.nodes if isinstance(result, Scene) else (result,)
        return Scene(tuple(made)) if made else EMPTY

    def copy(self, node: AgentNode, number: int, height: int) -> AgentNode:
        """A copy of an agent; it and the agents in its scope get new ids."""

        def renamed(each: Node, scope: Scene) -> Node:
            each = rescoped(each, scope)
            if not isinstance(each, AgentNode):
                return each
            return replace(each, id=copy_id(each.id, self.copying, number, height))

        scope = rebuild(node.scope, renamed)
        return replace(node, id=copy_id(node.id, self.copying, number), scope=scope)

    def _lambda(self, node: AgentNode, events: Addressed, original: str) -> Scene | AgentNode:
        """Apply λ to an agent, or to a copy of the agent with the id `original`."""
        # With its list, because the factory of its type would take as long as all else here.
        context = Context(self.frame, f"#{node.id}", [])
        result = evolve_agent(node, original, events, self.kinds, context)
        if context.emitted:
            self.emitted[original] = (*self.emitted.get(original, ()), *context.emitted)
        return result


def _check_few(scene: Scene, number: int, frame: Frame, policy: Policy) -> None:
    """Raise MisuseError if copying would exceed `MOST_COPIES`, before memory is used."""
    level = copies = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            level += 1 if opens else -1
            # An agent at level k is copied once more by each agent around it.
            copies += number**level if opens else 0
            if copies > MOST_COPIES:
                raise MisuseError(
                    f'policy = "{policy.value}" makes {number} copies of each agent in frame'
                    f" {frame.number}, and those in scopes once more for each agent around"
                    f" them: more than {MOST_COPIES:,} copies; use fewer events, or the policy"
                    f' "{Policy.SEQUENTIAL.value}"'
                )


def _nesting(scene: Scene) -> int:
    """The depth to which agents are nested in a string."""
    level = deepest = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            level += 1 if opens else -1
            deepest = max(deepest, level)
    return deepest
