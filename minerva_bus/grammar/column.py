"""One column of a table: n values of one name, digested by chunks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, TypeAlias, cast
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.joining import Joinable
from minerva_bus.grammar.scene import Value

CHUNK: Final = 4096

Rows: TypeAlias = NDArray[np.intp]
_TEXTS: Final = np.dtype(object)
_DTYPES: Final[dict[type, Any]] = {float: np.float64, int: np.int64, bool: np.bool_}


class Column(Joinable):
    """n values of one name: a read-only array of float64, int64, bool or, for texts, object.

    Texts that are ids stay ids, and are converted to an array on demand.
    """

    __slots__ = ("__weakref__", "_base", "_given", "chunks", "ids", "kept")

    def __init__(
        self, array: NDArray[Any] | None, chunks: list[bytes] | None = None, ids: Ids | None = None
    ) -> None:
        super().__init__()
        if array is not None:
            # Strings of several frames share columns.
            array.flags.writeable = False
        self._given = array
        self.ids = ids
        """The texts as ids, if they were given as ids."""
        self._base: tuple[ref[Column], Rows] | None = None
        self.kept: Any = None
        """Cache of a host of agents: objects that belong to these columns."""
        self.chunks = chunks
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

    @property
    def array(self) -> NDArray[Any]:
        """The values, shape (n,)."""
        if self._given is None:
            self._given = cast("Ids", self.ids).column
        return self._given

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values."""
        return _TEXTS if self.ids is not None else self.array.dtype

    def __len__(self) -> int:
        return len(self.array if self.ids is None else self.ids)

    def list(self) -> list[Any]:
        """The values as Python objects."""
        return self.array.tolist()

    def take(self, rows: Rows | slice) -> Column:
        """The values of some rows."""
        return Column(self.array[rows]) if self.ids is None else Column.of_ids(self.ids.take(rows))

    def put(self, rows: Rows, values: NDArray[Any]) -> Column:
        """A column with other values in some rows; digests of unchanged chunks are kept."""
        array = self.array.copy()
        array[rows] = values
        return self.changed(rows, array)

    def changed(self, rows: Rows, array: NDArray[Any]) -> Column:
        """As `put`, from an array that already has the other values in these rows."""
        chunks = None
        if self.chunks is not None:
            # The old column keeps its own digests.
            chunks = self.chunks.copy()
            touched = np.zeros(len(chunks), np.bool_)
            touched[rows // CHUNK] = True
            for chunk in np.flatnonzero(touched).tolist():
                chunks[chunk] = b""
        column = Column(array, chunks)
        # A weak reference: a chain of strong ones would keep the columns of all earlier frames
        # alive.
        column._base = ref(self), rows
        return column

    def moved(self, source: Rows, rows: Rows, others: Column | None) -> Column:
        """The values of the rows `source`, then those of another column in `rows`."""
        if self.ids is not None:
            taken = self.take(source)
            return taken if others is None else taken.with_rows(rows, others)
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
