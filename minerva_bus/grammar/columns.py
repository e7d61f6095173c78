"""Many nodes of one shape as columns: n rows instead of n nodes; strings with runs of such nodes.

A string prints, compares and digests alike in either form; `packed` and `unfolded` convert it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.column import Column, Rows
from minerva_bus.grammar.ids import LONGEST, Ids, RowDelta, updated_ids
from minerva_bus.grammar.measures import Of
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    Digested,
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

Level: TypeAlias = tuple[str, tuple[str, ...]]
Shape: TypeAlias = tuple[Level, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Columns(Digested):
    """`count` neighbouring nodes of one symbol: values as columns, and ids if they are agents.

    With `scope`, each is a transformation around the node in the same row of `scope`.
    """

    symbol: str
    names: tuple[str, ...]
    columns: tuple[Column, ...]
    count: int
    ids: Ids | None = None
    scope: Columns | None = None

    @property
    def still(self) -> bool:
        """Whether these are not agents."""
        return self.ids is None

    def levels(self) -> Iterator[Columns]:
        """The levels of nesting, from outside to inside."""
        level: Columns | None = self
        while level is not None:
            yield level
            level = level.scope

    @property
    def shape(self) -> Shape:
        """Symbol and names of each level."""
        return tuple([(level.symbol, level.names) for level in self.levels()])

    def column(self, name: str) -> NDArray[Any]:
        """The values of one name of the outermost level."""
        return self.columns[self.names.index(name)].array

    def ids_in(self, name: str) -> Ids:
        """The texts of one name of the outermost level, as ids."""
        column = self.columns[self.names.index(name)]
        return Ids.of(column.list()) if column.ids is None else column.ids

    def all_columns(self) -> tuple[Column, ...]:
        """The columns of all levels, from outside to inside."""
        return tuple([column for level in self.levels() for column in level.columns])

    def nodes(self) -> tuple[Node, ...]:
        """The nodes that the rows represent."""
        made: Sequence[Node] | None = None
        for level in reversed(tuple(self.levels())):
            made = level._around(made)
        return tuple(made or ())

    def node(self, row: int) -> Node:
        """The node of one row."""
        return self.take(slice(row, row + 1)).nodes()[0]

    def _around(self, inner: Sequence[Node] | None) -> Sequence[Node]:
        values = self.rows()
        symbol, names = self.symbol, self.names
        if self.ids is not None:
            pairs = zip(self.ids.texts(), values, strict=True)
            return [AgentNode(symbol, agent_id, names, row) for agent_id, row in pairs]
        if inner is not None:
            both = zip(values, inner, strict=True)
            return [TransformationNode(symbol, names, row, Scene((node,))) for row, node in both]
        if symbol[:1] == "P":
            return [FigureNode(symbol, names, row) for row in values]
        return [TransformationNode(symbol, names, row) for row in values]

    def rows(self) -> list[tuple[Value, ...]]:
        """The values of each row at the outermost level."""
        if not self.columns:
            return [()] * self.count
        return list(zip(*[column.list() for column in self.columns], strict=True))

    def take(self, rows: Rows | slice) -> Columns:
        """The columns of these rows: an array of row numbers, or a slice."""
        count = len(range(*rows.indices(self.count))) if isinstance(rows, slice) else len(rows)
        return self.changed(lambda column: column.take(rows), count, rows)

    def changed(
        self, change: Callable[[Column], Column], count: int, rows: Rows | slice | None = None
    ) -> Columns:
        """The same shape with `change` applied to each column, and `count` rows.

        The ids are those of `rows`; None keeps all of them.
        """
        scope = self.scope.changed(change, count, rows) if self.scope is not None else None
        ids = self.ids if self.ids is None or rows is None else self.ids.take(rows)
        columns = tuple([change(column) for column in self.columns])
        return Columns(self.symbol, self.names, columns, count, ids, scope)

    def with_columns(self, columns: Sequence[Column]) -> Columns:
        """The same ids, shape and number of rows with the columns of all levels replaced."""
        return self._with(iter(columns))

    def _with(self, given: Iterator[Column]) -> Columns:
        own = tuple([next(given) for _ in self.columns])
        scope = self.scope._with(given) if self.scope is not None else None
        return Columns(self.symbol, self.names, own, self.count, self.ids, scope)

    def updated(self, row_delta: RowDelta, newborn: Columns | None) -> Columns:
        """These agents after a row delta: without those removed, and with newborns inserted."""
        born = [None] * len(self.columns) if newborn is None else newborn.columns
        pairs = zip(self.columns, born, strict=True)
        rows = row_delta.source, row_delta.born
        columns = tuple([column.moved(*rows, added) for column, added in pairs])
        newborn_ids = None if newborn is None else newborn.ids
        ids = None if self.ids is None else updated_ids(self.ids, row_delta, newborn_ids)
        return Columns(self.symbol, self.names, columns, row_delta.after, ids)

    @staticmethod
    def concatenated(parts: Sequence[Columns]) -> Columns:
        """The concatenation of columns of one shape."""
        if len(parts) == 1:
            return parts[0]
        first = parts[0]
        columns = tuple(
            map(Column.concatenated, zip(*[part.columns for part in parts], strict=True))
        )
        ids = None
        if first.ids is not None:
            ids = Ids.concatenated([part.ids for part in parts if part.ids is not None])
        scope = None
        if first.scope is not None:
            inner = [part.scope for part in parts if part.scope is not None]
            scope = Columns.concatenated(inner)
        count = sum(part.count for part in parts)
        return Columns(first.symbol, first.names, columns, count, ids, scope)

    @staticmethod
    def of(nodes: Sequence[Node]) -> Columns:
        """Columns of neighbouring nodes of one shape (`shape_of`)."""
        first = nodes[0]
        values = zip(*[node.values for node in nodes], strict=True)
        columns = tuple([Column.of(value) for value in values])
        if isinstance(first, AgentNode):
            ids = Ids.of([cast("AgentNode", node).id for node in nodes])
            return Columns(first.symbol, first.names, columns, len(nodes), ids)
        scope = None
        if isinstance(first, TransformationNode) and first.scope.pieces:
            inner = [cast("TransformationNode", node).scope.nodes[0] for node in nodes]
            scope = Columns.of(inner)
        return Columns(first.symbol, first.names, columns, len(nodes), None, scope)


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


def values_of(scene: Scene, of: Of) -> Iterator[Value]:
    """The values that a parameter of a symbol has in a string, from left to right."""
    pieces: list[Piece] = list(reversed(scene.pieces))
    while pieces:
        piece = pieces.pop()
        if isinstance(piece, Columns):
            for level in piece.levels():
                if level.symbol == of.symbol:
                    yield from level.columns[level.names.index(of.parameter)].list()
            continue
        if piece.symbol == of.symbol:
            yield piece.values[piece.names.index(of.parameter)]
        if not isinstance(piece, FigureNode):
            pieces += reversed(piece.scope.pieces)
