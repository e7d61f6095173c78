"""One column of a table: n values of one name, digested by chunks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, TypeAlias, cast
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.coded import Coded
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.joining import Joinable
from minerva_bus.grammar.scene import Value

CHUNK: Final = 4096

Rows: TypeAlias = NDArray[np.intp]
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
        return np.flatnonzero(bits(self.array) != bits(other.array))

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
