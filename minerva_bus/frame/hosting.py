"""A host of agents: evolves and visualizes the fragments that it has been given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.messages import EvolveReply, EvolveRequest, Fragments
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.agent import Agent
from minerva_bus.world.evolution import Policy, evolve
from minerva_bus.world.kinds import Addressed, Kinds
from minerva_bus.world.moment import Frame
from minerva_bus.world.views import visualize


class Host:
    """The agents' side of steps 5 and 6 of Table 2."""

    def __init__(self, name: str, kinds: Mapping[str, type[Agent]]) -> None:
        self.name = name
        self.kinds: Kinds = kinds
        self.fragments: dict[str, AgentNode] = {}
        self._shown: dict[tuple[str, str], Scene] = {}

    def take(self, given: Fragments) -> None:
        """Keep these fragments, and let go of others."""
        for fragment in given.dropped:
            self._drop(fragment)
        for fragment, scene in given.given.items():
            self._drop(fragment)
            node = scene.nodes[0] if scene.nodes else None
            if not isinstance(node, AgentNode) or node.id != fragment:
                raise ProtocolError(f"the fragment #{fragment} is no agent of that name")
            self.fragments[fragment] = node

    def _drop(self, fragment: str) -> None:
        self.fragments.pop(fragment, None)
        for key in [key for key in self._shown if key[1] == fragment]:
            del self._shown[key]

    def answer(
        self, request: EvolveRequest, frame: Frame, policy: Policy, vocabulary: Vocabulary
    ) -> EvolveReply:
        """η and π over the fragments that a request is about."""
        concerned = request.only or tuple(self.fragments)
        missing = [one for one in concerned if one not in self.fragments]
        if missing:
            raise ProtocolError(f"frame {request.frame} is about #{missing[0]}, never given here")
        views = {
            event_type: self._views(event_type, concerned, request.visual, frame)
            for event_type in sorted({event.type for event in request.visual})
        }
        events = Addressed(request.events)
        changed: dict[str, Scene] = {}
        emitted: dict[str, tuple[Event, ...]] = {}
        for fragment in concerned if request.events else ():
            node = self.fragments[fragment]
            result = evolve(Scene((node,)), events, self.kinds, frame, policy)
            for agent, sent in result.emitted.items():
                emitted[agent] = tuple([vocabulary.check_event(event) for event in sent])
            if not _same(result.scene, node):
                changed[fragment] = vocabulary.check(result.scene, f"#{fragment}")
                self._keep(fragment, changed[fragment])
        return EvolveReply(self.name, request.frame, request.part, changed, emitted, views)

    def _keep(self, fragment: str, scene: Scene) -> None:
        """Keep what a fragment has become; one with newborns is given back where it is placed."""
        own = scene.nodes[0] if len(scene.nodes) == 1 else None
        if isinstance(own, AgentNode) and own.id == fragment:
            self.fragments[fragment] = own
        else:
            self._drop(fragment)

    def _views(
        self, event_type: str, concerned: Sequence[str], visual: Sequence[Event], frame: Frame
    ) -> dict[str, Scene]:
        """The views for one event type that differ from what was shown last.

        What a fragment that has just come looked like elsewhere is not known here: its first view
        counts as another, be it ε.
        """
        events = Addressed(tuple([event for event in visual if event.type == event_type]))
        changed: dict[str, Scene] = {}
        for fragment in concerned:
            node = self.fragments[fragment]
            view = visualize(Scene((node,)), events, self.kinds, frame.number)
            if view != self._shown.get((event_type, fragment)):
                changed[fragment] = self._shown[event_type, fragment] = view
        return changed


def _same(scene: Scene, node: AgentNode) -> bool:
    """Whether nothing has happened: the string is the very node."""
    return len(scene.nodes) == 1 and scene.nodes[0] is node
