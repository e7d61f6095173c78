"""Strings with slots: agents by name only, which are replaced by other strings."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Node,
    Piece,
    Scene,
    TransformationNode,
)
from minerva_bus.grammar.traversal import of_pieces, shared, walk


def fill(skeleton: Scene, parts: Mapping[str, Scene]) -> Scene:
    """The skeleton with each slot replaced by its fragment, or by ε if there is none."""
    made: list[Piece] = []
    for piece in skeleton.pieces:
        if isinstance(piece, AgentNode):
            made += parts.get(piece.id, EMPTY).pieces
        # Columns of agents cannot be slots, which are single nodes.
        elif piece.still or piece.ids is not None:
            made.append(piece)
        else:
            made += fill_slots(Scene((piece,)), lambda slot: parts.get(slot.id, EMPTY)).pieces
    return of_pieces(skeleton, made)


def fill_slots(scene: Scene, part: Callable[[AgentNode], Scene]) -> Scene:
    """Replace the outermost agents; unchanged parts are shared."""
    # One list of new nodes for each transformation that is open.
    results: list[list[Node]] = [[]]
    inside = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            inside += 1 if opens else -1
            if opens and inside == 1:
                results[-1].extend(part(node).nodes)
        # Within an outermost agent, which is replaced as a whole.
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
