"""η of a whole string, equation 3."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent, single
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    Node,
    Piece,
    Scene,
    agents,
    of_pieces,
    rebuild,
    rescoped,
    walk,
)
from minerva_bus.world.agent import Agent
from minerva_bus.world.agent_step import live
from minerva_bus.world.context import Context, Frame
from minerva_bus.world.kinds import Addressed, Kinds, addressed, kinds_of
from minerva_bus.world.lineage import copy_id, newest_copy
from minerva_bus.world.population_step import evolve_many


class Policy(Enum):
    """How equation 3 is read where a frame brings an agent several events, or none.

    SEQUENTIAL  the agent lives through its events one after another, in their order; without
                events it stays as it is
    LITERAL     the letter of the equation: the concatenation of one copy of the agent for each
                event of the frame, whether it concerns the agent or not; in a frame without
                events nothing is left. The first copy keeps the id, the others have ids made
                from it (world/lineage.py).
    """

    SEQUENTIAL = "sequential"
    LITERAL = "literal"


@dataclass(frozen=True, slots=True)
class Evolved:
    """What η made of a string, and the events that λ emitted (for the next frame).

    `emitted` has those of single agents by id, `many` those of agents in columns. Events of an
    agent's copies stand under the agent's id; each has the copy's id as its sender.
    """

    scene: Scene
    emitted: dict[str, tuple[Event, ...]]
    many: tuple[AnyEvent, ...] = ()


_FIRST = Frame()
MOST_COPIES: Final = 1_000_000
"""Agents that one frame may make of a fragment under the literal policy."""


def evolve(
    scene: Scene,
    events: Sequence[AnyEvent] | Addressed,
    kinds: Iterable[type[Agent]] | Kinds,
    frame: Frame = _FIRST,
    policy: Policy = Policy.SEQUENTIAL,
) -> Evolved:
    """η(w, e^v), equation 3: every agent lives through its events, scopes before their agents.

    Agents whose kind is not among `kinds` stand still. Under the literal policy copies get ids by
    the frame's number; where a string has ids of later copies already, by the number after those.
    Raises ActivityError where user code did, and MisuseError where that makes too many copies.
    """
    found = addressed(events)
    if policy is Policy.LITERAL:
        eta = _Eta(addressed(tuple(single(found.events))), kinds_of(kinds), frame)
        last = newest_copy(agent.id for agent in agents(scene))
        eta.copying = max(frame.number, last + 1)
        _check_few(scene, len(eta.addressed.events), frame)
        return Evolved(rebuild(scene, eta.copies), eta.emitted)
    eta = _Eta(found, kinds_of(kinds), frame)
    if not any(isinstance(piece, Columns) for piece in scene.pieces):
        return Evolved(rebuild(scene, eta.once), eta.emitted)
    return eta.piecewise(scene)


@dataclass(slots=True)
class _Eta:
    """η of one frame: what it knows of the frame, and what it gathers on its way."""

    addressed: Addressed
    kinds: Kinds
    frame: Frame
    emitted: dict[str, tuple[Event, ...]] = field(default_factory=dict[str, tuple[Event, ...]])
    copying: int = 0

    def once(self, node: Node, scope: Scene) -> Scene | Node:
        """An agent lives through its events, one after another."""
        node = rescoped(node, scope)
        if not isinstance(node, AgentNode) or node.symbol not in self.kinds:
            return node
        places = self.addressed.places(node.id, self.kinds[node.symbol].activities)
        return self.live(node, places, self.addressed) if places else node

    def piecewise(self, scene: Scene) -> Evolved:
        """η of a string some of which is held in columns."""
        result: list[Piece] = []
        many: list[AnyEvent] = []
        for piece in scene.pieces:
            if not isinstance(piece, Columns):
                result += rebuild(Scene((piece,)), self.once).pieces
            elif piece.ids is None or piece.symbol not in self.kinds:
                result.append(piece)
            else:
                now, sent = evolve_many(piece, self.addressed, self.kinds, self.frame)
                result += now.pieces
                many += sent
        return Evolved(of_pieces(scene, result), self.emitted, tuple(many))

    def copies(self, node: Node, scope: Scene) -> Scene | Node:
        """One copy of an agent for each event of the frame: the letter of equation 3."""
        height = 1 + _nesting(node.scope) if isinstance(node, AgentNode) else 0
        node = rescoped(node, scope)
        if not isinstance(node, AgentNode) or node.symbol not in self.kinds:
            return node
        places = self.addressed.places(node.id, self.kinds[node.symbol].activities)
        concerning = set(map(self.addressed.index, places))
        made: list[Node] = []
        for index, event in enumerate(self.addressed.events):
            copy = node if index == 0 else self.copy(node, index + 1, height)
            if index not in concerning:
                made.append(copy)
                continue
            alone = Addressed((event,))  # whatever a copy becomes, it meets no other event
            made += self.live(copy, [0], alone, node.id).nodes
        return Scene(tuple(made)) if made else EMPTY

    def copy(self, node: AgentNode, number: int, height: int) -> AgentNode:
        """An agent and all that is in its scope under new ids, since no two may share one."""

        def renamed(each: Node, scope: Scene) -> Node:
            each = rescoped(each, scope)
            if not isinstance(each, AgentNode):
                return each
            return replace(each, id=copy_id(each.id, self.copying, number, height))

        scope = rebuild(node.scope, renamed)
        return replace(node, id=copy_id(node.id, self.copying, number), scope=scope)

    def live(
        self, node: AgentNode, places: list[int], addressed: Addressed, original: str = ""
    ) -> Scene:
        """λ of one agent, or of a copy of one with the id `original`, by the events at places."""
        moment = Context(self.frame, f"#{node.id}")
        result = live(node, places, addressed, self.kinds, moment)
        if moment.emitted:
            name = original or node.id
            self.emitted[name] = (*self.emitted.get(name, ()), *moment.emitted)
        return result


def _check_few(scene: Scene, events: int, frame: Frame) -> None:
    """Raise MisuseError before a frame makes more copies than anybody can hold."""
    level = copies = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            level += 1 if opens else -1
            copies += events**level if opens else 0
            if copies > MOST_COPIES:
                raise MisuseError(
                    f'policy = "literal" copies each agent for each of the {events} events of'
                    f" frame {frame.number}, and those in scopes once more for each agent around"
                    f" them: more than {MOST_COPIES:,} copies; use fewer events, or the policy"
                    ' "sequential"'
                )


def _nesting(scene: Scene) -> int:
    """How many agents stand around one another in a string, at most."""
    level = deepest = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            level += 1 if opens else -1
            deepest = max(deepest, level)
    return deepest
