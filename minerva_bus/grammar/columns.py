"""Many nodes of one shape as columns: n rows instead of n nodes.

A `Columns` in a string represents its rows, one node each, and prints, compares and digests like
them. A shape is flat: a single agent, a single figure, or up to eight nested transformations with
at most one figure inside; all values are numbers, bools or texts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

from numpy.typing import NDArray

from minerva_bus.grammar.column import Column, Rows
from minerva_bus.grammar.id_changes import updated_ids
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.row_delta import RowDelta
from minerva_bus.grammar.scene import (
    AgentNode,
    Digested,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
)

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
