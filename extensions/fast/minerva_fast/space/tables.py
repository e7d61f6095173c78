"""Tables of inhabitants: a matrix in the string, and the arrays that rules work on.

    class Sheep(OnLattice):
        energy: Column

The matrix has a row for each name and a column for each inhabitant: `id` and `cell` (`OnLattice`)
or `id`, `x` and `y` (`InField`), then the declared names. All are float64, which is exact for
integers up to 2^53.

While rules of a frame are applied, tables and matrices are *opened*: arrays with room for newborns,
and the lists of the rows of each cell, which kernels make or sort.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from inspect import get_annotations
from operator import itemgetter
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, Self, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.types import Reals
from minerva_fast.space.compiling import RuleLoop, around
from minerva_fast.space.kernels import kernel
from minerva_fast.space.places import (
    ALIVE,
    FIRST,
    FREE,
    GONE,
    LATER,
    NEXT,
    PREVIOUS,
    ROWS,
    SLOT,
    UNCOUNTED,
    UNLISTED,
    VACANT,
    CellGrid,
    FieldGrid,
    cell_of,
    move_to,
)

if TYPE_CHECKING:
    from minerva_fast.space.space import Space


Column: TypeAlias = NDArray[np.float64]
"""A declared name of a table, shape (n,)."""
Rows: TypeAlias = NDArray[np.int64]

INDEX: Final = ("values", "links", "places", "counts", "births", "cell")
"""Arrays of every table in a rule, before its columns (minerva_fast.space.places)."""


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


class Matrices:
    """Cells of matrices in one dimension.

    A matrix is copied when the first rule that changes it starts. Rules that only read it before
    that get the memory of the string, as read-only arrays: for those, nothing that changes cells
    can be compiled.
    """

    def __init__(self, space: Space) -> None:
        self._space = space
        self._originals: dict[str, NDArray[Any]] = {}
        self._changing: dict[str, NDArray[Any]] = {}
        self._unchanged: dict[str, NDArray[Any]] = {}

    def to_change(self, name: str) -> NDArray[Any]:
        """The cells of a matrix, for rules that change it."""
        cells = self._changing.get(name)
        if cells is None:
            matrix: NDArray[Any] = getattr(self._space, name)
            writable: NDArray[Any] = self._space.writable(name)
            # The method may have written to the same array before its rules.
            self._originals[name] = matrix.copy() if writable is matrix else matrix
            cells = self._changing[name] = writable.reshape(-1)
        return cells

    def to_read(self, name: str) -> NDArray[Any]:
        """The cells of a matrix, for rules that only read it."""
        cells = self._changing.get(name)
        if cells is None:
            cells = self._unchanged.get(name)
        if cells is None:
            matrix: NDArray[Any] = getattr(self._space, name)
            if not is_constant(matrix):
                return self.to_change(name)
            cells = self._unchanged[name] = matrix.reshape(-1)
        return cells

    def as_it_is(self, name: str) -> NDArray[Any]:
        """Cells that stay as they are while rules change the matrix, for rules that read them."""
        matrix: NDArray[Any] = getattr(self._space, name)
        if name not in self._changing and is_constant(matrix):
            return self.to_read(name)
        cells = self.to_change(name).copy()
        cells.flags.writeable = False
        return cells

    def reset(self) -> None:
        """Give the space the matrices that it had before the rules."""
        for name, matrix in self._originals.items():
            setattr(self._space, name, matrix)


def is_constant(matrix: NDArray[Any]) -> bool:
    """Whether an array is a matrix of the string, with the layout that machine code takes."""
    plain = type(matrix) is np.ndarray and matrix.flags.c_contiguous and matrix.flags.aligned
    return plain and not matrix.flags.writeable


ENTERED, UNBORN, OUTSIDE = 0, 1, 2
EXACT: Final = 2.0**52
"""From here on, reals have no fraction."""


class CellLists(NamedTuple):
    """The arrays of a table in which its rows have cells."""

    cell: Rows
    links: Rows
    places: Rows
    counts: Rows


@kernel
def enter(values: Column, cell: Rows, links: Rows, places: Rows, counts: Rows, births: Rows) -> int:
    """Admit all rows of a lattice, and build the lists of its cells, unless it is to have none.

    Returns ENTERED, UNBORN if an id is not below `births`, or OUTSIDE if a cell does not exist.
    """
    for i in range(counts[ROWS]):
        if values[0, i] >= births[0]:
            return UNBORN
        if cell[i] < 0 or cell[i] >= places.shape[1]:
            return OUTSIDE
        links[ALIVE, i] = 1
    if counts[VACANT] != UNLISTED:
        enlist(cell, links, places, counts)
    return ENTERED


@kernel
def locate(
    values: Column, cell: Rows, links: Rows, births: Rows, x: Column, y: Column,
    width: float, height: float, across: int, down: int,
) -> int:  # fmt: skip
    """Admit all rows of a field, whose cells are those of their positions; ENTERED or UNBORN."""
    field = FieldGrid(width, height, False, across, down)
    for i in range(len(x)):
        if values[0, i] >= births[0]:
            return UNBORN
        cell[i] = cell_of(field, x[i], y[i])
        links[ALIVE, i] = 1
    return ENTERED


@kernel
def enlist(cell: Rows, links: Rows, places: Rows, counts: Rows) -> None:
    """Build the lists of all cells; the rows of a cell are in the order of the table."""
    for place in range(places.shape[1]):
        places[FIRST, place] = -1
    for i in range(counts[ROWS] - 1, -1, -1):
        other = places[FIRST, cell[i]]
        links[NEXT, i], links[PREVIOUS, i] = other, -1
        places[FIRST, cell[i]] = i
        if other >= 0:
            links[PREVIOUS, other] = i
    if counts[VACANT] == UNCOUNTED:
        return
    vacant = 0
    for place in range(places.shape[1]):
        if places[FIRST, place] < 0:
            places[FREE, vacant], places[SLOT, place] = place, vacant
            vacant += 1
    counts[VACANT] = vacant


@kernel
def settle(
    cell: Rows, links: Rows, places: Rows, counts: Rows, x: Column, y: Column,
    width: float, height: float, periodic: bool, across: int, down: int,
) -> None:  # fmt: skip
    """Enter all rows into the lists of the cells of their positions."""
    field, lists = (
        FieldGrid(width, height, periodic, across, down),
        CellLists(cell, links, places, counts),
    )
    for i in range(len(x)):
        if links[ALIVE, i]:
            move_to(lists, i, cell_of(field, x[i], y[i]))


@kernel
def sort_by_cell(
    places: Rows, links: Rows, x: Column, y: Column,
    starts: Rows, rows: Rows, sorted_x: Column, sorted_y: Column,
) -> None:  # fmt: skip
    """Write the rows of all lists, with their positions, one cell after another."""
    count = 0
    for cell in range(places.shape[1]):
        starts[cell] = count
        i = places[FIRST, cell]
        while i >= 0:
            rows[count], sorted_x[count], sorted_y[count] = i, x[i], y[i]
            count, i = count + 1, links[NEXT, i]
    starts[places.shape[1]] = count


@kernel
def sort_by_number(
    cell: Rows, x: Column, y: Column,
    starts: Rows, rows: Rows, sorted_x: Column, sorted_y: Column,
) -> None:  # fmt: skip
    """The same for rows in no lists yet, whose order in these would be that of the table."""
    starts[:] = 0
    for i in range(len(x)):
        starts[cell[i] + 1] += 1
    for place in range(1, len(starts)):
        starts[place] += starts[place - 1]
    for i in range(len(x)):
        k = starts[cell[i]]
        rows[k], sorted_x[k], sorted_y[k] = i, x[i], y[i]
        starts[cell[i]] = k + 1
    for place in range(len(starts) - 1, 0, -1):  # each was the end of its cell
        starts[place] = starts[place - 1]
    starts[0] = 0


@kernel
def sharing(
    x: Column, y: Column, width: float, height: float, across: int, down: int, step: int,
    known: Column, times: Rows,
) -> int:  # fmt: skip
    """The pairs of rows that share a cell, among each `step`-th row, each pair counted twice.

    `known` and `times` are a hash table of cells with room for more cells than there are rows.
    Positions outside have cells beyond the edges here.
    """
    for slot in range(len(times)):
        times[slot] = 0
    pairs = 0
    for i in range(0, len(x), step):
        cell = whole(x[i] / width * across) * down + whole(y[i] / height * down)
        slot = int(abs(cell)) % len(times) if abs(cell) < EXACT else 0
        while times[slot] and known[slot] != cell:
            slot = slot + 1 if slot + 1 < len(times) else 0
        pairs += 2 * times[slot]
        known[slot], times[slot] = cell, times[slot] + 1
    return pairs


@kernel
def whole(number: float) -> float:
    """The largest integer that is not above a number, as a real of any size."""
    return float(math.floor(number)) if abs(number) < EXACT else number


_INTS: Final = "int64[::1]"
_TABLE: Final = "int64[:, ::1]"
_REALS: Final = "float64[::1]"
_MATRIX: Final = "float64[:, ::1]"
_SIDES: Final = ("float64", "float64")
_CELLS: Final = ("int64", "int64")
_SORTED: Final = (_INTS, _INTS, _REALS, _REALS)
ENTERING: Final = ("values", "cell", "links", "places", "counts", "births")
"""The arrays of a table that ENTER takes."""
LOCATING: Final = ("values", "cell", "links", "births")
"""The first ones that LOCATE takes."""
ENTER: Final = around(enter, (_MATRIX, _INTS, _TABLE, _TABLE, _INTS, _INTS), result="int64")
LOCATE: Final = around(
    locate, (_MATRIX, _INTS, _TABLE, _INTS, _REALS, _REALS, *_SIDES, *_CELLS), result="int64"
)
ENLIST: Final = around(enlist, (_INTS, _TABLE, _TABLE, _INTS))
SETTLE: Final = around(
    settle, (_INTS, _TABLE, _TABLE, _INTS, _REALS, _REALS, *_SIDES, "boolean", *_CELLS)
)
SORT: Final = around(sort_by_cell, (_TABLE, _TABLE, _REALS, _REALS, *_SORTED))
SORT_BY_NUMBER: Final = around(sort_by_number, (_INTS, _REALS, _REALS, *_SORTED))
SHARING: Final = around(
    sharing, (_REALS, _REALS, *_SIDES, *_CELLS, "int64", _REALS, _INTS), result="int64"
)


_PER_CELL: Final = 2
"""Inhabitants per cell of a field's search, on average."""
_CROWDED: Final = 8.0
"""Inhabitants that share a cell, above which cells are smaller."""
_MOST_CELLS: Final = 16
"""Cells per inhabitant, if they are smaller."""
_SAMPLE: Final = 4096

_Chosen: TypeAlias = Callable[[Mapping[str, NDArray[Any]]], tuple[NDArray[Any], ...]]


def _choosing(names: tuple[str, ...]) -> _Chosen:
    """A function that takes the arrays with these names."""
    return cast("_Chosen", itemgetter(*names))


_INDEX: Final = _choosing(INDEX)
_ENTERING: Final = _choosing(ENTERING)
_LOCATING: Final = _choosing(LOCATING)
_LISTS: Final = _choosing(CellLists._fields)
_SORTED_ROWS: Final = _choosing(InField.sorted_rows)

_UNSORTED: Final = dict(
    zip(InField.sorted_rows, (*np.empty((2, 0), np.int64), *np.empty((2, 0))), strict=True)
)
"""Of a table whose rows move."""


@dataclass(slots=True)
class Opened:
    """The arrays of one table during a frame; `old` is its matrix in the string.

    `listed` is whether its rows are in the lists of their cells, which many rules do not need, and
    `moved` whether rows have moved since they were entered. `passed` are the arguments of rules,
    and `used` is whether rules have had them, and may have changed them.
    """

    kind: type[Inhabitants]
    old: Reals
    arrays: dict[str, NDArray[Any]]
    shape: CellGrid | FieldGrid
    listed: bool = False
    moved: bool = False
    used: bool = False
    passed: list[Any] = dataclass_field(default_factory=list[Any])

    @staticmethod
    def of(
        kind: type[Inhabitants],
        matrix: Reals,
        lattice: CellGrid,
        extent: tuple[float, float],
        births: Rows,
        *,
        vacant: int | None,
        room: int,
    ) -> Opened:
        """Open a matrix of the string.

        Args:
            kind: the table.
            matrix: its state.
            lattice: the shape of the space in cells.
            extent: the width and height of the space.
            births: the id of the next newborn, shared by all tables, shape (1,).
            vacant: UNCOUNTED or UNLISTED, if there are no lists of free cells or none at all.
            room: the most newborns of an activation, for which there is room at first.

        Raises:
            MisuseError: the matrix does not fit the space.

        """
        kind.check(matrix)
        count = matrix.shape[1]
        values = np.empty((len(matrix), _with_room(count, room)))
        values[:, :count] = matrix
        shape = lattice
        if issubclass(kind, InField):
            row = kind.names.index("x")
            x, y = values[row : row + 2, :count]
            shape = _field(extent, lattice.periodic, x, y)
        opened = Opened(kind, matrix, {"births": births, "values": values}, shape)
        opened._allocate(count, vacant)
        opened._enter()
        return opened

    def _allocate(self, count: int, vacant: int | None) -> None:
        capacity, cells = self.arrays["values"].shape[1], _cells(self.shape)
        self.arrays |= {
            "places": np.empty((3, cells), np.int64),
            "counts": np.array([count, cells if vacant is None else vacant, 0, 0, 0]),
            "links": np.empty((3, capacity), np.int64),
            "cell": np.empty(capacity, np.int64),
        }

    def _enter(self) -> None:
        arrays, cells = self.arrays, self.arrays["cell"]
        if isinstance(self.shape, FieldGrid):
            width, height, _, across, down = self.shape
            entered = LOCATE(*_LOCATING(arrays), *self._places(), width, height, across, down)
        else:
            cells[: self.old.shape[1]] = self.old[1]
            entered = ENTER(*_ENTERING(arrays))
            self.listed = True
        if entered == UNBORN:
            largest, births, count = self.old[0].max(), arrays["births"][0], self.old.shape[1]
            raise MisuseError(
                f"{self.kind.__name__}: the id {largest:.0f} is not below the space's `births`"
                f" ({births:.0f}), from which newborns get their ids; set births={count} or more"
            )
        if entered == OUTSIDE:
            raise MisuseError(
                f"{self.kind.__name__}: cells are numbers from 0 to {_cells(self.shape) - 1}"
                f" in a lattice of {self.shape.width} x {self.shape.height}"
            )

    def reserve(self, births: int) -> None:
        """Make room for newborns."""
        count, capacity = int(self.arrays["counts"][ROWS]), len(self.arrays["cell"])
        if capacity - count >= births:
            return
        capacity = _with_room(count, births)
        for name in ("values", "links", "cell"):
            old = self.arrays[name]
            wide = np.empty((*old.shape[:-1], capacity), old.dtype)
            wide[..., :count] = old[..., :count]
            self.arrays[name] = wide
        self.passed = []

    def snapshot(self) -> Opened:
        """The current state, which does not change, in read-only arrays of `values`."""
        values = self.old
        if self.used or not is_constant(values):
            values = self.arrays["values"].copy()
            values.flags.writeable = False
        arrays = {"values": values}
        if isinstance(self.shape, CellGrid):
            copied = [name for name in self.arrays if name != "values"]
        else:
            # Its rows are sorted instead of in lists.
            arrays |= {"links": np.empty((3, 0), np.int64), "places": np.empty((3, 0), np.int64)}
            arrays |= self._sorted()
            copied = ["cell", "counts", "births"]
        arrays |= {name: self.arrays[name].copy() for name in copied}
        return replace(self, arrays=arrays, passed=[])

    def _sorted(self) -> dict[str, NDArray[Any]]:
        """The rows of each cell in the order of its list."""
        places, count = self.arrays["places"], int(self.arrays["counts"][ROWS])
        starts, rows = np.empty(places.shape[1] + 1, np.int64), np.empty(count, np.int64)
        at = np.empty((2, count))
        if self.arrays["counts"][VACANT] != UNLISTED and (self.listed or self.moved):
            self.enlist()
            SORT(places, self.arrays["links"], *self._places(), starts, rows, *at)
        else:
            SORT_BY_NUMBER(self.arrays["cell"][:count], *self._places(), starts, rows, *at)
        return dict(zip(self.kind.sorted_rows, (starts, rows, *at), strict=True))

    def _places(self) -> tuple[Column, Column]:
        """The positions of all rows in a field."""
        row, count = self.kind.names.index("x"), int(self.arrays["counts"][ROWS])
        x, y = self.arrays["values"][row : row + 2, :count]
        return x, y

    def enlist(self) -> None:
        """Enter all rows into the lists of the cells where they are."""
        unlisted = self.arrays["counts"][VACANT] == UNLISTED
        if unlisted or (self.listed and not self.moved):
            return
        lists = _LISTS(self.arrays)
        if not self.listed:
            ENLIST(*lists)
            self.listed = True
        if self.moved:
            SETTLE(*lists, *self._places(), *self.shape)
            self.moved = False

    def arguments(self, *, shared: bool = False) -> list[Any]:
        """The arrays and numbers of the kind's tuple, in the order of its fields.

        With `shared`, for a thread, what searches write is its own, and rows that move are entered
        into lists by `enlist`.
        """
        self.used = True
        if shared:
            counts = self.arrays["counts"].copy()
            counts[LATER] = 1
            return replace(self, arrays={**self.arrays, "counts": counts}, passed=[]).arguments()
        if not self.passed:
            columns = map(self.arrays["values"].__getitem__, self.kind.column_rows)
            self.passed = [*_INDEX(self.arrays), *columns, *self._extra()]
        return self.passed

    def _extra(self) -> list[Any]:
        capacity = len(self.arrays["cell"])
        nearby = np.empty(capacity, np.int64)
        if isinstance(self.shape, CellGrid):
            return [nearby, *self.shape[:3]]
        sorted_rows = _SORTED_ROWS(_UNSORTED | self.arrays)
        return [nearby, *np.empty((2, capacity)), *sorted_rows, *self.shape]

    def close(self) -> Reals:
        """The matrix of the remaining rows and of newborns, in their order; ends its use here."""
        counts, values = self.arrays["counts"], self.arrays["values"]
        count = int(counts[ROWS])
        if "cell" in self.kind.position:
            values[1, :count] = self.arrays["cell"][:count]
        if counts[GONE]:
            alive = self.arrays["links"][ALIVE, :count].nonzero()[0]
            matrix = values[:, :count].take(alive, axis=1)
        else:
            matrix = values if count == values.shape[1] else values[:, :count].copy()
        # Read-only arrays that own their memory become attributes without another copy.
        matrix.flags.writeable = False
        return matrix


def _with_room(count: int, births: int) -> int:
    """A capacity for rows and newborns, with which most tables need no second one."""
    return max(2 * count, count + births) if births else count


def _cells(shape: CellGrid | FieldGrid) -> int:
    if isinstance(shape, FieldGrid):
        return shape.across * shape.down
    return shape.width * shape.height


def _field(extent: tuple[float, float], periodic: bool, x: Column, y: Column) -> FieldGrid:
    """The cells for a search among these positions; smaller ones where many share a cell."""
    width, height = extent
    spacing = (width * height * _PER_CELL / max(len(x), 1)) ** 0.5
    field = FieldGrid(
        width, height, periodic, max(1, int(width / spacing)), max(1, int(height / spacing))
    )
    shared = _sharing(field, x, y)
    if shared <= _CROWDED:
        return field
    finer = min(shared / _PER_CELL, _MOST_CELLS * _PER_CELL) ** 0.5
    return field._replace(
        across=max(1, int(field.across * finer)), down=max(1, int(field.down * finer))
    )


def _sharing(field: FieldGrid, x: Column, y: Column) -> float:
    """About how many others an inhabitant shares its cell with, from a sample."""
    step = max(1, len(x) // _SAMPLE)
    size = -(-len(x) // step)
    pairs = size * (size - 1)
    if not pairs:
        return 0.0
    width, height, _, across, down = field
    table = np.empty(2 * size), np.empty(2 * size, np.int64)
    return len(x) * SHARING(x, y, width, height, across, down, step, *table) / pairs


def loops_of_table(kind: type[Inhabitants]) -> tuple[RuleLoop, ...]:
    """The loops that open a table."""
    in_field = SHARING, LOCATE, ENLIST, SETTLE, SORT, SORT_BY_NUMBER
    return in_field if issubclass(kind, InField) else (ENTER,)
