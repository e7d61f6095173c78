"""Many nodes of one shape as columns: n rows instead of n nodes; strings with runs of such nodes.

A `Column` is n values of one name, digested by chunks; texts of few different values are numbers of
these, so that few texts are compared and checked. A string prints, compares and digests alike as
columns and as nodes; `packed` and `unfolded` convert it. A `Delta` is the difference between two
states of columns, which is sent instead of the new state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Final, TypeAlias, cast
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.ids import (
    LONGEST,
    Ids,
    Joinable,
    RowDelta,
    Rows,
    row_delta_of_ids,
    same_id,
    updated_ids,
)
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
    of_pieces,
    rebuild,
    rescoped,
    walk,
    with_scope,
)
from minerva_bus.grammar.types import Of, Type, Unfit

CHUNK: Final = 4096

_TEXTS: Final = np.dtype(object)
_DTYPES: Final[dict[type, Any]] = {float: np.float64, int: np.int64, bool: np.bool_}


class Column(Joinable):
    """n values of one name: a read-only array of float64, int64, bool or, for texts, object.

    Texts that are ids stay ids, and coded texts stay coded; both become an array on demand.
    """

    __slots__ = ("__weakref__", "_base", "_coded", "_given", "chunks", "ids", "kept")

    def __init__(
        self, array: NDArray[Any] | None, ids: Ids | None = None, coded: Coded | None = None
    ) -> None:
        super().__init__()
        if array is not None:
            # Strings of several frames share columns.
            array.flags.writeable = False
        self._given = array
        self._coded = coded
        self.ids = ids
        """The texts as ids, if they were given as ids."""
        self._base: tuple[ref[Column], Rows] | None = None
        self.kept: Any = None
        """Cache of a host of agents: objects that belong to these columns."""
        self.chunks: list[bytes] | None = None
        """Digest of each 4,096 values, once known; an empty one has to be computed."""

    @staticmethod
    def of(values: Sequence[Value]) -> Column:
        """A column of scalars."""
        kinds = set(map(type, values))
        # Values of several types remain Python objects: 1, 1.0 and true are different values.
        kind = kinds.pop() if len(kinds) == 1 else object
        array: NDArray[Any] = np.empty(len(values), _DTYPES.get(kind, object))
        if kind is tuple or kind is np.ndarray:
            for row, value in enumerate(values):  # numpy would convert nested values to arrays.
                array[row] = value
        else:
            array[:] = values  # pyright: ignore[reportArgumentType, reportCallIssue]
        return Column(array)

    @staticmethod
    def of_ids(ids: Ids) -> Column:
        """A column whose texts are these ids."""
        return Column(None, ids=ids)

    @staticmethod
    def of_coded(coded: Coded) -> Column:
        """A column whose texts are these."""
        return Column(None, coded=coded)

    @property
    def array(self) -> NDArray[Any]:
        """The values, shape (n,)."""
        if self._given is None:
            texts = self.ids.column if self.ids is not None else cast("Coded", self._coded).texts()
            texts.flags.writeable = False
            self._given = texts
        return self._given

    @property
    def coded(self) -> Coded:
        """The values, which are texts, as codes; computed once."""
        if self._coded is None:
            self._coded = Coded.of(self.array)
        return self._coded

    @property
    def words(self) -> NDArray[Any] | None:
        """The different texts, if the values are coded; otherwise None."""
        if self._coded is None:
            return None
        self._coded = self._coded.used()
        return self._coded.words

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values."""
        return self._given.dtype if self._given is not None else _TEXTS

    def __len__(self) -> int:
        for values in (self._given, self.ids):
            if values is not None:
                return len(values)
        return len(cast("Coded", self._coded))

    def list(self) -> list[Any]:
        """The values as Python objects."""
        return self.array.tolist()

    def take(self, rows: Rows | slice) -> Column:
        """The values of some rows."""
        if self.ids is not None:
            return Column.of_ids(self.ids.take(rows))
        coded = None if self._coded is None else self._coded.take(rows)
        return Column(self.array[rows]) if coded is None else Column.of_coded(coded)

    def put(self, rows: Rows, values: NDArray[Any]) -> Column:
        """A column with other values in some rows; digests of unchanged chunks are kept."""
        array = self.array.copy()
        array[rows] = values
        return self.changed(rows, Column(array))

    def changed(self, rows: Rows, column: Column) -> Column:
        """As `put`, by a new column that already has the other values in these rows."""
        if self.chunks is not None:
            # The old column keeps its own digests.
            chunks = column.chunks = self.chunks.copy()
            touched = np.zeros(len(chunks), np.bool_)
            touched[rows // CHUNK] = True
            for chunk in np.flatnonzero(touched).tolist():
                chunks[chunk] = b""
        # A weak reference: a chain of strong ones would keep the columns of all earlier frames
        # alive.
        column._base = ref(self), rows
        return column

    def moved(self, source: Rows, rows: Rows, others: Column | None) -> Column:
        """The values of the rows `source`, then those of another column in `rows`."""
        if self.ids is not None:
            taken = self.take(source)
            return taken if others is None else taken.with_rows(rows, others)
        coded = None if self._coded is None else self._coded.take(source)
        if coded is not None and (others is None or are_texts(others.list())):
            return Column.of_coded(coded if others is None else coded.put(rows, others.coded))
        array = self.array[source]
        if others is not None:
            array[rows] = others.array
        return Column(array)

    def with_rows(self, rows: Rows, others: Column) -> Column:
        """As `put`; if both columns are ids, so is the result."""
        if self.ids is None or others.ids is None:
            return self.put(rows, others.array)
        return Column.of_ids(self.ids.put(rows, others.ids).known())

    def rows_since(self, old: Column) -> Rows | None:
        """The rows that `put` has replaced in an old column; None if it is not made by `put`."""
        if self._base is None or self._base[0]() is not old:
            return None
        return self._base[1]

    def differs(self, other: Column) -> Rows | None:
        """The rows in which another column of this length prints differently; None: in all."""
        if self.ids is not None and other.ids is not None:
            return self.ids.differs(other.ids)
        if self._coded is not None and other._coded is not None:
            return self._coded.differs(other._coded)
        if self.array is other.array:
            return np.empty(0, np.intp)
        if self.array.dtype != other.array.dtype:
            return None
        different = bits(self.array) != bits(other.array)
        # Populations often change as a whole, and listing all rows takes ten times as long.
        if different.all() and len(different):
            return None
        return np.flatnonzero(different)

    @classmethod
    def _in_one(cls, parts: Sequence[Column]) -> Column:
        ids = [part.ids for part in parts if part.ids is not None]
        if len(ids) == len(parts):
            return Column.of_ids(Ids.concatenated(ids))
        coded = [part._coded for part in parts if part._coded is not None]
        if len(coded) == len(parts):
            return Column.of_coded(Coded.joined(coded))
        arrays = [part.array for part in parts]
        if any(array.dtype != arrays[0].dtype for array in arrays):
            # numpy would convert ints to floats, which may lose digits and change types.
            arrays = [array.astype(object) for array in arrays]
        return Column(np.concatenate(arrays))


def are_texts(values: Iterable[object]) -> bool:
    """Whether all values are texts, and of no subclass."""
    return set(map(type, values)) <= {str}


def bits(array: NDArray[Any]) -> NDArray[Any]:
    """Values that are equal exactly if those of an array print the same."""
    return array.view(np.int64) if array.dtype == np.float64 else array


_PART: Final = 4
"""A selection of rows keeps the table of words if it has this many times as many rows."""


@dataclass(frozen=True, slots=True, eq=False)
class Coded:
    """n texts: text k is `words[codes[k]]`. The words differ; some may have no row.

    Both arrays have one dimension, of objects and of int64, and nobody writes to them.
    """

    words: NDArray[Any]
    codes: NDArray[np.int64]

    @staticmethod
    def of(texts: NDArray[Any]) -> Coded:
        """The codes of an array of texts."""
        listed = texts.tolist()
        numbers = {text: number for number, text in enumerate(dict.fromkeys(listed))}
        return Coded(_array(list(numbers)), _looked_up(numbers, listed))

    def __len__(self) -> int:
        return len(self.codes)

    def texts(self) -> NDArray[Any]:
        """The texts, as an array of objects."""
        return self.words[self.codes]

    def used(self) -> Coded:
        """The same texts without words that have no row."""
        used = np.bincount(self.codes, minlength=len(self.words)) > 0
        if used.all():
            return self
        return Coded(self.words[used], (np.cumsum(used) - 1)[self.codes])

    def take(self, rows: NDArray[np.intp] | slice) -> Coded | None:
        """The texts of some rows; None if these are few beside the words."""
        codes = self.codes[rows]
        return Coded(self.words, codes) if _PART * len(self.words) <= len(codes) else None

    def put(self, rows: NDArray[np.intp], others: Coded) -> Coded:
        """The texts with others in some rows."""
        whole = Coded.joined([self, others])
        codes = whole.codes[: len(self)].copy()
        codes[rows] = whole.codes[len(self) :]
        return Coded(whole.words, codes)

    def differs(self, other: Coded) -> NDArray[np.intp]:
        """The rows in which as many other texts differ."""
        if self.words is other.words:
            return np.flatnonzero(self.codes != other.codes)
        numbers = {word: number for number, word in enumerate(self.words.tolist())}
        own = np.array([numbers.get(word, -1) for word in other.words.tolist()], np.int64)
        return np.flatnonzero(self.codes != own[other.codes])

    @staticmethod
    def joined(parts: Sequence[Coded]) -> Coded:
        """The texts of all parts, one after another."""
        numbers: dict[str, int] = {}
        made: list[NDArray[np.int64]] = []
        for part in parts:
            words = part.words.tolist()
            for word in words:
                numbers.setdefault(word, len(numbers))
            made.append(_looked_up(numbers, words)[part.codes])
        return Coded(_array(list(numbers)), np.concatenate(made))


def _array(texts: Sequence[str]) -> NDArray[Any]:
    array = np.empty(len(texts), object)
    array[:] = texts
    return array


def _looked_up(numbers: dict[str, int], texts: Sequence[str]) -> NDArray[np.int64]:
    # Without a step of Python for each text.
    return np.fromiter(map(numbers.__getitem__, texts), np.int64, len(texts))


# --- arrays as columns of a type ---

SCALARS: Final = frozenset(("real", "int", "bool", "text"))
_KINDS = {"real": "fiub", "int": "iu", "bool": "b", "text": "OUT"}
NUMPY_TYPES: Final = {"real": np.float64, "int": np.int64, "bool": np.bool_, "text": object}
"""The array types of columns, by the kind of a type."""


def is_array(value: object) -> bool:
    """Whether a value has one element for each of many nodes."""
    return (isinstance(value, np.ndarray) and value.ndim == 1) or isinstance(value, Ids)


def fit_array(kind: Type, value: Any, *, finite: bool = True) -> Column:
    """A column of this type with the values of an array of shape (n,), or the texts of ids.

    With `finite=False`, the caller checks later that they are finite. Raises Unfit.
    """
    if kind.kind not in SCALARS:
        raise Unfit(f"a {kind}, which cannot be a column")
    if isinstance(value, Ids):
        if kind.kind != "text":
            raise Unfit(f"an array of {kind}, not of ids")
        return _among(kind, Column.of_ids(value))
    array = cast("NDArray[Any]", value)
    letter = array.dtype.kind
    if letter not in _KINDS[kind.kind] or (kind.kind == "real" and letter == "b"):
        raise Unfit(f"an array of {kind}, not of {array.dtype}")
    if kind.kind == "text":
        return _among(kind, _texts(array))
    # A writable array is copied, because its owner could change the string later.
    fitted = array.astype(NUMPY_TYPES[kind.kind], copy=array.flags.writeable)
    # Unsigned integers of 2^63 and more have become negative.
    if letter == "u" and kind.kind == "int" and (fitted < 0).any():
        raise Unfit("an array of whole numbers of at most 64 bits")
    if finite and kind.kind == "real" and not np.logical_and.reduce(np.isfinite(fitted)):
        raise Unfit(f"an array of {kind} with finite numbers")
    if kind.range is not None and fitted.size:
        # If the extremes are in the range, all values are.
        kind.check_range(fitted.min().item())
        kind.check_range(fitted.max().item())
    return Column(fitted)


def _among(kind: Type, column: Column) -> Column:
    """The column, if its texts are words of this type. Raises Unfit."""
    for word in sorted({*column.list()}) if kind.words else ():
        kind.fit(word)
    return column


def _texts(array: NDArray[Any]) -> Column:
    texts = array.tolist()
    if not are_texts(texts):
        raise Unfit("an array of texts")
    return Column(_array(texts))


def repeated(kind: Type, value: Any, count: int) -> Column:
    """A column of one value. Raises Unfit."""
    if kind.kind not in SCALARS:
        raise Unfit(f"a {kind}, which cannot be a column")
    array = np.empty(count, NUMPY_TYPES[kind.kind])
    array[:] = kind.fit(value)
    return Column(array)


def fits(kind: Type, column: Column) -> bool:
    """Whether the values of a column are of this type, without conversion."""
    if kind.kind == "text" and column.ids is not None and not kind.words:
        return True
    if kind.kind == "text":
        values = column.array if column.words is None else column.words
        texts = values.tolist() if values.dtype == object else [None]
        return are_texts(texts) and (not kind.words or {*texts} <= {*kind.words})
    array = column.array
    if kind.kind not in SCALARS or array.dtype != NUMPY_TYPES[kind.kind]:
        return False
    if kind.range is not None and array.size:
        # If the extremes are in the range, all values are; nan is an extreme that is in none.
        extremes = array.min().item(), array.max().item()
        if not all(map(kind.range.holds, extremes)):
            return False
    # Without the Python code of `all`, which takes longer for short arrays.
    return kind.kind != "real" or bool(np.logical_and.reduce(np.isfinite(array)))


# --- nodes in columns ---

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


def column_bytes(scene: Scene) -> int:
    """Bytes of the numbers in a string's columns, which its populations will send."""
    return sum(
        column.array.nbytes
        for piece in scene.pieces
        if isinstance(piece, Columns)
        for column in piece.all_columns()
        if column.array.dtype != object
    )


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
    first = scene.pieces[0] if len(scene.pieces) == 1 else None
    # The usual fragment, an agent without a scope, needs no stack.
    if isinstance(first, AgentNode) and not first.scope.pieces:
        new = leave(first, first.scope)
        return of_pieces(scene, new.nodes if isinstance(new, Scene) else (new,))
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


# --- differences between two states of columns ---

MAX_PART: Final = 0.25
"""Maximum part of a column that is sent as rows; beyond it the complete column is shorter than
rows with their numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """New values of one name at one level of the shape, in these rows or (None) in all."""

    level: int
    place: int
    rows: Rows | None
    column: Column


class Delta:
    """Changes of columns with `count` rows and these symbols, from outside to inside.

    With a `row_delta` the row numbers of changes are those after it, and each column has a change
    for the added rows, whose values are given nowhere else. `born` are the ids of added agents.

    A delta from `difference` has both states as `ends`. Its changes are computed when they are
    read: in the process that made it, the new state replaces the old one without them.
    """

    __slots__ = ("_born", "_changes", "count", "ends", "row_delta", "symbols")

    def __init__(
        self,
        count: int,
        symbols: tuple[str, ...],
        changes: tuple[Change, ...] | None,
        row_delta: RowDelta | None = None,
        born: Ids | None = None,
        ends: tuple[Columns, Columns] | None = None,
    ) -> None:
        self.count = count
        self.symbols = symbols
        self.row_delta = row_delta
        self.ends = ends
        self._changes = changes
        self._born = born

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes, by level and place."""
        if self._changes is None:
            old, new = cast("tuple[Columns, Columns]", self.ends)
            self._changes = tuple(_changes(old, new, self.row_delta))
        return self._changes

    @property
    def born(self) -> Ids | None:
        """The ids of added agents, by row; None without any."""
        if self._born is None and self.ends is not None and self.row_delta is not None:
            ids = self.ends[1].ids
            if ids is not None and len(self.row_delta.born):
                self._born = ids.take(self.row_delta.born)
        return self._born

    @property
    def empty(self) -> bool:
        """Whether both states are equal."""
        return self.row_delta is None and not self.changes

    def result(self, old: Piece) -> Columns | None:
        """The new state, if this delta was made in this process from these very columns."""
        return self.ends[1] if self.ends is not None and self.ends[0] is old else None


def difference(old: Piece, new: Piece, row_delta: RowDelta | None = None) -> Delta | None:
    """The delta from the old columns to the new; None if the new ones must be sent as they are.

    Only columns of one shape have a delta. Ids show which agents were removed and added; for
    columns without ids, `row_delta` has to be given.
    """
    if not isinstance(old, Columns) or not isinstance(new, Columns) or old.shape != new.shape:
        return None
    # The same object has no row delta; others are compared.
    if old.ids is not None and new.ids is not None and old.ids is not new.ids:
        row_delta = row_delta_of_ids(old.ids, new.ids)
        if row_delta is None:
            return None
    if new.count != (old.count if row_delta is None else row_delta.after):
        return None
    symbols = tuple([level.symbol for level in new.levels()])
    return Delta(old.count, symbols, None, row_delta, ends=(old, new))


def _changes(old: Columns, new: Columns, row_delta: RowDelta | None) -> Iterator[Change]:
    for level, (before, after) in enumerate(zip(old.levels(), new.levels(), strict=True)):
        for place, (was, now) in enumerate(zip(before.columns, after.columns, strict=True)):
            rows = (
                _changed_rows(was, now) if row_delta is None else _rows_after(row_delta, was, now)
            )
            if rows is None or len(rows) > MAX_PART * len(now):
                yield Change(level, place, None, now)
            elif len(rows):
                yield Change(level, place, rows, now.take(rows))


def _changed_rows(old: Column, new: Column) -> Rows | None:
    if old is new:
        return np.empty(0, np.intp)
    rows = new.rows_since(old)
    return old.differs(new) if rows is None else rows


def _rows_after(row_delta: RowDelta, old: Column, new: Column) -> Rows | None:
    """The rows after a row delta that have new values, including all added rows."""
    # Ids differ by the row delta only, so they need no comparison.
    old_ids, new_ids = old.ids, new.ids
    if old_ids and new_ids and row_delta_of_ids(old_ids, new_ids) is row_delta:
        return row_delta.born
    rows = old.take(row_delta.source).differs(new)
    if rows is None or not len(row_delta.born):
        return rows
    changed = np.zeros(row_delta.after, np.bool_)
    # Added rows count as changed even if their values equal those of row 0, which `source` uses
    # for rows without an old one.
    changed[rows] = changed[row_delta.born] = True
    return np.flatnonzero(changed)


def check_delta(old: Piece, delta: Delta) -> Columns:
    """The piece as columns, if the delta applies to them. Raises Unfit."""
    if isinstance(old, Columns) and delta.result(old) is not None:
        return old
    if not isinstance(old, Columns):
        raise Unfit(f"a patch of {old.symbol}, which is not in columns")
    symbols = tuple([level.symbol for level in old.levels()])
    if delta.count != old.count or delta.symbols != symbols:
        raise Unfit(f"a patch of {old.count} {old.symbol}")
    row_delta = delta.row_delta
    if row_delta is None:
        return old
    # Columns have at least one row.
    if not row_delta.after or row_delta.count != old.count:
        raise Unfit(f"a patch that removes all {old.count} {old.symbol}")
    born = 0 if delta.born is None else len(delta.born)
    if born != (len(row_delta.born) if old.ids is not None else 0):
        raise Unfit(f"a patch with {born} ids for {len(row_delta.born)} added {old.symbol}")
    # A set, because several changes of one column cover it only once.
    complete = {
        (change.level, change.place) for change in delta.changes if _covers_born(change, row_delta)
    }
    if len(row_delta.born) and len(complete) < len(old.all_columns()):
        raise Unfit(f"a patch without values for {len(row_delta.born)} added {old.symbol}")
    return old


def patched(old: Piece, delta: Delta) -> Columns:
    """The old columns with a delta applied. Raises Unfit if it does not apply to them."""
    if (result := delta.result(old)) is not None:
        return result
    # A delta may come from a remote member.
    columnar = check_delta(old, delta)
    updated = (
        columnar if delta.row_delta is None else _updated(columnar, delta.row_delta, delta.born)
    )
    changes: dict[tuple[int, int], list[Change]] = {}
    for change in delta.changes:
        changes.setdefault((change.level, change.place), []).append(change)
    return updated.with_columns([
        _patched_column(column, changes.get((number, place), []), delta.row_delta)
        for number, level in enumerate(columnar.levels())
        for place, column in enumerate(level.columns)
    ])  # fmt: skip


def _patched_column(old: Column, changes: Sequence[Change], row_delta: RowDelta | None) -> Column:
    """A column after its changes, whose row numbers are those after the row delta."""
    if row_delta is not None and (not changes or changes[0].rows is not None):
        first, changes = changes[:1], changes[1:]
        rows, values = (first[0].rows, first[0].column) if first else (None, None)
        old = old.moved(row_delta.source, np.empty(0, np.intp) if rows is None else rows, values)
    for change in changes:
        old = change.column if change.rows is None else old.with_rows(change.rows, change.column)
    return old


def _updated(old: Columns, row_delta: RowDelta, born: Ids | None) -> Columns:
    """The ids and number of rows after a row delta; the columns are still the old ones."""
    updated = old.changed(lambda column: column, row_delta.after)
    if old.ids is None:
        return updated
    ids = updated_ids(old.ids, row_delta, born)
    # A newborn must not have the id of another agent.
    if ids.duplicate is not None:
        raise Unfit(f"a patch after which {same_id(ids.duplicate)}")
    return replace(updated, ids=ids)


def _covers_born(change: Change, row_delta: RowDelta) -> bool:
    """Whether a change has values for all added rows."""
    if change.rows is None or not len(row_delta.born):
        return True
    changed = np.zeros(row_delta.after, np.bool_)
    changed[change.rows] = True
    return bool(changed[row_delta.born].all())
