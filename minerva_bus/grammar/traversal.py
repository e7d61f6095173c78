"""Walks over a string from left to right, rewriting it from the leaves up, and filling slots.

A slot is an agent by name only, which is replaced by another string.
None of them recurses: only memory limits the depth of a string.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping
from operator import is_

from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Node,
    Piece,
    Scene,
    TransformationNode,
    agents,
)


def walk(scene: Scene) -> Iterator[tuple[bool, Node]]:
    """(True, node) at the start of each node and (False, node) at the end of its scope, in order.

    A figure has no scope, so it has a start only.
    """
    stack = [iter(scene.nodes)]
    open_nodes: list[Node] = []
    while stack:
        node = next(stack[-1], None)
        if node is None:
            stack.pop()
            if open_nodes:
                yield False, open_nodes.pop()
            continue
        yield True, node
        if not isinstance(node, FigureNode):
            open_nodes.append(node)
            stack.append(iter(node.scope.nodes))


def rebuild(
    scene: Scene,
    leave: Callable[[Node, Scene], Scene | Node],
    whole: Container[int] = (),
) -> Scene:
    """Rewrite a string from the leaves up: `leave(node, its rewritten scope)` replaces each node.

    If `leave` returns the same node, the original is shared. Nodes whose `id()` is in `whole` are
    passed to `leave` with their scope unchanged.
    """
    # A stack of its own: strings may be nested more deeply than Python recurses.
    nodes, made = iter(scene.nodes), list[Node]()
    opened: list[tuple[TransformationNode | AgentNode, Iterator[Node], list[Node]]] = []
    while True:
        # `made` has the new nodes of the current scope; `opened` the nodes around it, with the
        # siblings that are still to come and those that are done.
        for node in nodes:
            if isinstance(node, FigureNode):
                new = leave(node, EMPTY)
            elif not node.scope.pieces or id(node) in whole:
                new = leave(node, node.scope)
            else:
                opened.append((node, nodes, made))
                nodes, made = iter(node.scope.nodes), []
                break
            made += new.nodes if isinstance(new, Scene) else (new,)
        else:
            if not opened:
                return shared(scene, made)
            done, nodes, outer = opened.pop()
            new = leave(done, shared(done.scope, made))
            outer += new.nodes if isinstance(new, Scene) else (new,)
            made = outer


def shared(old: Scene, nodes: list[Node]) -> Scene:
    """The string of these nodes; the old string if they are the same objects as its nodes."""
    former = old.nodes
    if len(nodes) == len(former) and all(map(is_, nodes, former)):
        return old
    return Scene(tuple(nodes)) if nodes else EMPTY


def of_pieces(old: Scene, pieces: list[Piece]) -> Scene:
    """As `shared`, for pieces: columns are compared as objects, not by their rows."""
    if len(pieces) == len(old.pieces) and all(map(is_, pieces, old.pieces)):
        return old
    return Scene(tuple(pieces)) if pieces else EMPTY


def kind_counts(*pieces: Piece) -> Counter[str]:
    """Number of agents of each kind in pieces of a string, including agents in scopes."""
    counts: Counter[str] = Counter()
    for piece in pieces:
        if piece.ids is not None:
            counts[piece.symbol] += piece.count
        elif not piece.still:
            counts.update(agent.symbol for agent in agents(Scene((piece,))))
    return counts


def identities(scene: Scene) -> frozenset[int]:
    """The `id()` of each node of a string, to recognize the nodes in another string."""
    return frozenset(map(id, scene.nodes))


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
