"""Tables of inhabitants: a matrix in the string, and the arrays that rules work on.

    class Sheep(OnLattice):
        energy: Column

The matrix has a row for each name and a column for each inhabitant: `id` and `cell` (`OnLattice`)
or `id`, `x` and `y` (`InField`), then the declared names. All are float64, which is exact for
integers up to 2^53.
"""

from __future__ import annotations

from collections.abc import Sequence
from inspect import get_annotations
from typing import Any, ClassVar, Final, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.types import Reals
from minerva_fast.space.field import FieldGrid
from minerva_fast.space.lattice import CellGrid

Column: TypeAlias = NDArray[np.float64]
"""A declared name of a table, shape (n,)."""
Rows: TypeAlias = NDArray[np.int64]

INDEX: Final = ("values", "links", "places", "counts", "births", "cell")
"""Arrays of every table in a rule, before its columns (minerva_fast.space.occupancy)."""


class Inhabitants:
    """Base of tables; `OnLattice` and `InField` give their inhabitants a position.

    In a rule, columns are arrays of shape (capacity,) that are indexed by a row: `sheep.energy[i]`.
    """

    position: ClassVar[tuple[str, ...]] = ()
    extra: ClassVar[tuple[str, ...]] = ()
    """Other arrays and structures that a rule sees, after the columns."""
    sorted_rows: ClassVar[tuple[str, ...]] = ()
    """Those of a table that does not change, in the order of its cells."""

    names: ClassVar[tuple[str, ...]] = ()
    """The rows of the matrix."""
    fixed: ClassVar[tuple[str, ...]] = ("id",)
    """Those to which a rule cannot assign."""
    column_rows: ClassVar[tuple[int, ...]] = ()
    """The rows of the matrix that a rule sees as columns."""
    type: ClassVar[Any]
    """The tuple that a rule sees."""

    id: Column
    cell: Rows
    values: Column

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "position" in vars(cls):
            return
        own = [name for name in get_annotations(cls) if not name.startswith("_")]
        taken = {*INDEX, *cls.position, *cls.extra, "id"}
        if wrong := sorted(taken & set(own)):
            raise MisuseError(f"{cls.__name__}.{wrong[0]} is taken: every table has it")
        inherited = [name for name in cls.names if name not in ("id", *cls.position)]
        cls.names = ("id", *cls.position, *inherited, *own)
        cls.fixed = ("id", *cls.position)
        cls.column_rows = tuple([cls.names.index(name) for name in columns_of(cls)])
        fields = [(name, Any) for name in (*INDEX, *columns_of(cls), *cls.extra)]
        cls.type = NamedTuple(cls.__name__, fields)  # pyright: ignore[reportArgumentType]

    @classmethod
    def many(cls, count: int, *, first: int = 0, **columns: Any) -> Reals:
        """The matrix of `count` inhabitants with the ids `first`, `first + 1`, ...

        Args:
            count: number of inhabitants.
            first: the id of the first; ids are unique within a space.
            columns: each name except `id`: an array of shape (count,), or one number for all.

        Raises:
            MisuseError: a name is missing or unknown.

        """
        names = cls.names[1:]
        for name in columns:
            if name not in names:
                raise MisuseError(f"{cls.__name__} has no {name}{nearest(name, list(names))}")
        if missing := [name for name in names if name not in columns]:
            raise MisuseError(f"{cls.__name__}.many needs {missing[0]}")
        matrix = np.empty((len(cls.names), count))
        matrix[0] = np.arange(first, first + count)
        for row, name in enumerate(names, 1):
            matrix[row] = columns[name]
        matrix.flags.writeable = False
        return matrix

    @classmethod
    def read(cls, matrix: Reals) -> Self:
        """The columns of a matrix by name, for views and statistics. Raises MisuseError."""
        cls.check(matrix)
        table = cls.__new__(cls)
        for name, column in zip(cls.names, matrix, strict=True):
            setattr(table, name, column.astype(np.int64) if name == "cell" else column)
        return table

    @classmethod
    def check(cls, matrix: Reals) -> None:
        """Raise MisuseError if a matrix has not a row for each name."""
        if len(matrix) != len(cls.names):
            raise MisuseError(
                f"a matrix of {cls.__name__} has {len(cls.names)} rows ({', '.join(cls.names)}),"
                f" not {len(matrix)}"
            )


class OnLattice(Inhabitants):
    """Inhabitants in cells of a lattice; any number may share a cell."""

    position = ("cell",)
    extra = ("nearby", "lattice")
    nearby: Rows
    lattice: CellGrid


class InField(Inhabitants):
    """Inhabitants at positions (x, y) of a continuous field.

    The table `before` of a rule has its rows by cell, so that a search reads memory in its order:
    those of a cell are `sorted[starts[cell]:starts[cell + 1]]`, at `sorted_x` and `sorted_y`. In a
    table whose rows move these arrays are empty.
    """

    position = ("x", "y")
    sorted_rows = ("starts", "sorted", "sorted_x", "sorted_y")
    extra = ("nearby", "dx", "dy", *sorted_rows, "field")
    x: Column
    y: Column
    nearby: Rows
    dx: Column
    dy: Column
    starts: Rows
    sorted: Rows
    sorted_x: Column
    sorted_y: Column
    field: FieldGrid


def columns_of(table: type[Inhabitants]) -> Sequence[str]:
    """The names that a rule sees as arrays of numbers."""
    return [name for name in table.names if name not in ("id", "cell")]
