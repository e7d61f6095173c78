"""The string of a world, taken apart into its static skeleton and its outermost agents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from minerva_bus.errors import VocabularyError
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    agents,
    shared,
    walk,
)


class Composition:
    """w as a skeleton with a slot for each outermost agent, and the agents by id.

    An outermost agent with all of its scope is what hosts evolve and what travels: a *fragment*.
    """

    def __init__(self, scene: Scene) -> None:
        self._take_apart(scene)

    def _take_apart(self, scene: Scene) -> None:
        self._scene: Scene | None = scene
        self.fragments: dict[str, AgentNode] = {}
        self._home: dict[str, str] = {}
        self._kind: dict[str, str] = {}
        self.skeleton = _fill(scene, self._slot)

    def _slot(self, node: AgentNode) -> Scene:
        self.fragments[node.id] = node
        for inner in agents(Scene((node,))):
            if inner.id in self._home:
                raise VocabularyError(f"two agents have the id #{inner.id}")
            self._home[inner.id] = node.id
            self._kind[inner.id] = inner.symbol
        return Scene((AgentNode(node.symbol, node.id),))

    @property
    def scene(self) -> Scene:
        """The whole string w."""
        if self._scene is None:
            self._scene = fill(self.skeleton, {i: Scene((n,)) for i, n in self.fragments.items()})
        return self._scene

    def home(self, agent: str) -> str | None:
        """The fragment in which an agent lives."""
        return self._home.get(agent)

    def kind(self, agent: str) -> str:
        """The symbol of an agent's kind; empty where there is no such agent."""
        return self._kind.get(agent, "")

    def agents(self) -> Iterable[str]:
        """The ids of all agents, also those within others."""
        return self._home

    def replace(self, changes: Mapping[str, Scene]) -> bool:
        """Put what λ returned in the agents' places; whether the skeleton is another now.

        Raises VocabularyError, and changes nothing, where two agents would share an id.
        """
        if not changes:
            return False
        if all(self._same_shape(agent, scene) for agent, scene in changes.items()):
            for agent, scene in changes.items():
                self.fragments[agent] = scene.nodes[0]  # pyright: ignore[reportArgumentType]
            self._scene = None
            return False
        parts = {i: Scene((n,)) for i, n in self.fragments.items()}
        before = self.__dict__.copy()
        try:
            self._take_apart(fill(self.skeleton, {**parts, **changes}))
        except VocabularyError:
            self.__dict__.update(before)
            raise
        return True

    def _same_shape(self, agent: str, scene: Scene) -> bool:
        if len(scene.nodes) != 1:
            return False
        node = scene.nodes[0]
        if not isinstance(node, AgentNode) or node.id != agent:
            return False
        if node.symbol != self.fragments[agent].symbol:
            return False
        old = self.fragments[agent].scope
        return node.scope is old or (node.scope == EMPTY and old == EMPTY)


def fill(skeleton: Scene, parts: Mapping[str, Scene]) -> Scene:
    """The skeleton with a string in each agent's slot; ε where there is none."""
    return _fill(skeleton, lambda slot: parts.get(slot.id, EMPTY))


def _fill(scene: Scene, part: Callable[[AgentNode], Scene]) -> Scene:
    """Replace the outermost agents, sharing whatever does not change."""
    results: list[list[Node]] = [[]]
    inside = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            inside += 1 if opens else -1
            if opens and inside == 1:
                results[-1].extend(part(node).nodes)
        elif inside:
            continue
        elif isinstance(node, FigureNode):
            results[-1].append(node)
        elif opens:
            results.append([])
        else:
            scope = shared(node.scope, results.pop())
            same = scope is node.scope
            results[-1].append(
                node if same else TransformationNode(node.symbol, node.names, node.values, scope)
            )
    return shared(scene, results[0])
