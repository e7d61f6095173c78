"""Places of nodes in a string."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from minerva_bus.grammar.scene import AgentNode, FigureNode, Node, Scene, TransformationNode, Value
from minerva_bus.grammar.traversal import walk


@dataclass(frozen=True, slots=True, eq=False)
class NodePath:
    """A node of a string with its index in the scope of its parent, and its depth."""

    node: Node
    index: int
    parent: NodePath | None = None
    depth: int = 1

    @property
    def path(self) -> tuple[int, ...]:
        """The indices from the outermost node to this one."""
        return tuple([above.index for above in self.upwards()])[::-1]

    def upwards(self) -> Iterator[NodePath]:
        """The place itself and the places around it, from inside to outside."""
        place: NodePath | None = self
        while place is not None:
            yield place
            place = place.parent


def places(scene: Scene, deepest: int) -> list[NodePath]:
    """All nodes of a string down to a depth, from left to right, outer nodes first."""
    result: list[NodePath] = []
    stack = _within(scene, None, deepest)
    while stack:
        place = stack.pop()
        result.append(place)
        if not isinstance(place.node, FigureNode):
            stack += _within(place.node.scope, place, deepest)
    return result


def _within(scene: Scene, parent: NodePath | None, deepest: int) -> list[NodePath]:
    depth = 1 if parent is None else parent.depth + 1
    if depth > deepest:
        return []
    nodes = enumerate(scene.nodes)
    # Reversed, because the stack returns the last one first.
    return [NodePath(node, index, parent, depth) for index, node in nodes][::-1]


def with_value(node: Node, n: int, value: Value) -> Node:
    """The node with another value of its nth parameter."""
    values = (*node.values[:n], value, *node.values[n + 1 :])
    if isinstance(node, FigureNode):
        return FigureNode(node.symbol, node.names, values)
    if isinstance(node, TransformationNode):
        return TransformationNode(node.symbol, node.names, values, node.scope)
    return AgentNode(node.symbol, node.id, node.names, values, node.scope)


@dataclass(frozen=True, slots=True)
class Extent:
    """The number of nodes of a string, and their maximum depth."""

    nodes: int
    depth: int

    def within(self, other: Extent) -> bool:
        """Whether neither number exceeds that of the other extent."""
        return self.nodes <= other.nodes and self.depth <= other.depth

    def joined(self, other: Extent) -> Extent:
        """The maximum of each number."""
        return Extent(max(self.nodes, other.nodes), max(self.depth, other.depth))


def extent(scene: Scene) -> Extent:
    """The extent of a string."""
    nodes = depth = deepest = 0
    for opens, node in walk(scene):
        nodes += opens
        deepest = max(deepest, depth + 1) if opens else deepest
        if not isinstance(node, FigureNode):
            depth += 1 if opens else -1
    return Extent(nodes, deepest)
