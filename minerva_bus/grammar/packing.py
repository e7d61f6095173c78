"""Strings that hold runs of nodes in columns: which nodes these are, and walks over both forms.

A string prints, compares and digests alike in either form; `packed` and `unfolded` convert it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Final, cast

import numpy as np

from minerva_bus.grammar.columns import Columns, Level, Shape
from minerva_bus.grammar.ids import LONGEST
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Node,
    Piece,
    Scene,
    TransformationNode,
    Value,
    rescoped,
    with_scope,
)
from minerva_bus.grammar.traversal import of_pieces, rebuild, walk

MANY: Final = 32
"""Minimum number of neighbours of one shape that are digested together, and held in columns."""

CHAIN: Final = 8
"""Maximum number of levels of a shape: nested transformations and a figure."""

_SCALARS: Final = frozenset((float, int, bool, str))


def shape_of(node: Piece) -> Shape | None:
    """The shape of a flat node; None for others."""
    if isinstance(node, Columns):
        return node.shape
    if isinstance(node, AgentNode):
        # A column of ids holds at most `LONGEST` characters for each.
        if node.scope.pieces or len(node.id) > LONGEST or not _scalar(node.values):
            return None
        return ((node.symbol, node.names),)
    shape: list[Level] = []
    # From outside to inside: nested transformations that end with a figure or an empty scope.
    while len(shape) < CHAIN:
        if not _scalar(node.values):
            return None
        shape.append((node.symbol, node.names))
        scope = node.scope.pieces if isinstance(node, TransformationNode) else ()
        if not scope:
            return tuple(shape)
        inner = scope[0]
        if len(scope) > 1 or isinstance(inner, AgentNode):
            return None
        # A single row of columns counts as the node that it represents.
        if inner.count > 1 or inner.ids is not None:
            return None
        node = cast("FigureNode | TransformationNode", inner.nodes()[0])
    return None


def _scalar(values: tuple[Value, ...]) -> bool:
    return _SCALARS.issuperset(map(type, values))


def runs(pieces: Sequence[Piece]) -> Iterator[tuple[Shape | None, list[Piece]]]:
    """The pieces of a string in maximal groups of one shape.

    Neighbours without a shape form a group with None.
    """
    for shape, group in groupby(pieces, shape_of):
        yield shape, list(group)


def merged(group: Sequence[Piece]) -> Columns:
    """Neighbours of one shape as one `Columns`."""
    parts: list[Columns] = []
    for columnar, run in groupby(group, lambda piece: isinstance(piece, Columns)):
        if columnar:
            parts += cast("Iterator[Columns]", run)
        else:
            parts.append(Columns.of(list(cast("Iterator[Node]", run))))
    return Columns.concatenated(parts)


def size(group: Sequence[Piece]) -> int:
    """The number of nodes that the pieces represent."""
    return sum(piece.count for piece in group)


def packed(scene: Scene) -> Scene:
    """The same string with longer runs of one shape at the outermost level in columns."""
    if len(scene.pieces) < MANY and not has_columns(scene):
        return scene
    made: list[Piece] = []
    for shape, group in runs(scene.pieces):
        if shape is None or size(group) < MANY or all(isinstance(p, Columns) for p in group):
            made += group
        else:
            made.append(merged(group))
    # No run was merged, so the string remains the same object.
    if len(made) == len(scene.pieces):
        return scene
    return Scene(tuple(made)) if made else EMPTY


def one_by_one(scene: Scene) -> Scene:
    """The same string with its agents as nodes; figures and transformations stay as they are."""
    made: list[Piece] = []
    for piece in scene.pieces:
        made += (piece,) if piece.ids is None else piece.nodes()
    return of_pieces(scene, made)


def columns_in(scene: Scene) -> Iterator[Columns]:
    """The pieces at the outermost level that are held in columns."""
    return (piece for piece in scene.pieces if isinstance(piece, Columns))


def has_columns(scene: Scene) -> bool:
    """Whether nodes at the outermost level are held in columns."""
    return Columns in map(type, scene.pieces)


def rewritten(
    scene: Scene,
    leave: Callable[[Node, Scene], Scene | Node],
    whole: Callable[[Columns], Scene | None],
) -> Scene:
    """As `rebuild`, but columns at the outermost level are passed to `whole`.

    If that returns None, `leave` rewrites their rows, as nodes.
    """
    if not has_columns(scene):
        return rebuild(scene, leave)
    made: list[Piece] = []
    for piece in scene.pieces:
        result = whole(piece) if isinstance(piece, Columns) else None
        made += (rebuild(Scene((piece,)), leave) if result is None else result).pieces
    return of_pieces(scene, made)


def unfolded(scene: Scene) -> Scene:
    """The same string without columns at any level."""

    def leave(node: Node, scope: Scene) -> Node:
        return rescoped(node, _nodes_of(scope))

    return _nodes_of(rebuild(_nodes_of(scene), leave))


def _nodes_of(scene: Scene) -> Scene:
    return Scene(scene.nodes) if has_columns(scene) else scene


def walk_pieces(scene: Scene, whole: Callable[[Columns], bool]) -> Iterator[tuple[bool, Node]]:
    """As `walk`, but columns are passed to `whole` first; if it returns False, node by node."""
    stack: list[Iterator[Piece]] = [iter(scene.pieces)]
    opened: list[TransformationNode | AgentNode] = []
    while stack:
        piece = next(stack[-1], None)
        if piece is None:
            stack.pop()
            if opened:
                yield False, opened.pop()
        elif isinstance(piece, Columns):
            # Agents are passed as nodes, which φ rejects one by one.
            if piece.ids is not None or not whole(piece):
                yield from walk(Scene(piece.nodes()))
        else:
            yield True, piece
            if not isinstance(piece, FigureNode):
                opened.append(piece)
                stack.append(iter(piece.scope.pieces))


def around_each(transformations: Columns, inside: Scene) -> Scene:
    """Each of n transformations around its row of a scope of n rows, or else around all of it."""
    pieces = inside.pieces
    if not transformations.count:
        return EMPTY
    if not pieces:
        return Scene((transformations,))
    inner = pieces[0]
    if len(pieces) == 1 and isinstance(inner, Columns):
        # Row by row around another column: one level more.
        if inner.count == transformations.count and inner.ids is None and len(inner.shape) < CHAIN:
            return Scene((replace(transformations, scope=inner),))
    elif len(pieces) == 1 and isinstance(inner, FigureNode) and shape_of(inner):
        # The same figure in each row.
        every = Columns.of([inner]).take(np.zeros(transformations.count, np.intp))
        return Scene((replace(transformations, scope=every),))
    return Scene(
        tuple([with_scope(cast("TransformationNode", n), inside) for n in transformations.nodes()])
    )
