"""η of a whole string, equation 3."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import count

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
    scene_of,
)
from minerva_bus.world.agent import Agent
from minerva_bus.world.crowd import evolve_many
from minerva_bus.world.kinds import Addressed, Kinds, addressed, kinds_of
from minerva_bus.world.life import live
from minerva_bus.world.moment import Frame, Moment


class Policy(Enum):
    """How equation 3 is read where a frame brings an agent several events, or none.

    SEQUENTIAL  the agent lives through its events one after another, in their order; without
                events it stays as it is
    LITERAL     the letter of the equation: the concatenation of one copy of the agent for each
                event; without events nothing is left. Copies after the first get ids `id-2`, ...
    """

    SEQUENTIAL = "sequential"
    LITERAL = "literal"


@dataclass(frozen=True, slots=True)
class Evolved:
    """What η made of a string, and the events that λ emitted (for the next frame).

    `emitted` has those of single agents by id, `many` those of agents in columns.
    """

    scene: Scene
    emitted: dict[str, tuple[Event, ...]]
    many: tuple[AnyEvent, ...] = ()


_FIRST = Frame()


def evolve(
    scene: Scene,
    events: Sequence[AnyEvent] | Addressed,
    kinds: Iterable[type[Agent]] | Kinds,
    frame: Frame = _FIRST,
    policy: Policy = Policy.SEQUENTIAL,
) -> Evolved:
    """η(w, e^v), equation 3: every agent lives through its events, scopes before their agents.

    Agents whose kind is not among `kinds` stand still. Raises ActivityError where user code did.
    """
    found = addressed(events)
    if policy is Policy.LITERAL:
        eta = _Eta(addressed(tuple(single(found.events))), kinds_of(kinds), frame)
        eta.ids.update(agent.id for agent in agents(scene))
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
    ids: set[str] = field(default_factory=set[str])

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
        node = rescoped(node, scope)
        if not isinstance(node, AgentNode) or node.symbol not in self.kinds:
            return node
        places = self.addressed.places(node.id, self.kinds[node.symbol].activities)
        concerning = set(map(self.addressed.index, places))
        result = EMPTY
        for index, event in enumerate(self.addressed.events):
            copy = node if index == 0 else self.copy(node, index + 1)
            alone = Addressed((event,))  # whatever a copy becomes, it meets no other event
            result += self.live(copy, [0], alone) if index in concerning else scene_of(copy)
        return result

    def copy(self, node: AgentNode, number: int) -> AgentNode:
        """An agent and all that is in its scope under new ids, since no two may share one."""

        def renamed(each: Node, scope: Scene) -> Node:
            each = rescoped(each, scope)
            if not isinstance(each, AgentNode):
                return each
            return replace(each, id=self.fresh(each.id, number))

        return next(agents(rebuild(scene_of(node), renamed)))

    def fresh(self, agent_id: str, number: int) -> str:
        """`id-2`, or the next number that no agent of the string has."""
        name = next(name for n in count(number) if (name := f"{agent_id}-{n}") not in self.ids)
        self.ids.add(name)
        return name

    def live(self, node: AgentNode, places: list[int], addressed: Addressed) -> Scene:
        """λ of one agent by the events at these places."""
        moment = Moment(self.frame, f"#{node.id}")
        result = live(node, places, addressed, self.kinds, moment)
        if moment.emitted:
            self.emitted[node.id] = (*self.emitted.get(node.id, ()), *moment.emitted)
        return result
