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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from inspect import get_annotations
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.types import Reals
from minerva_fast.draws import Guarded
from minerva_fast.driving import Loop
from minerva_fast.places import (
    ALIVE,
    FOUND,
    GONE,
    LATER,
    ROWS,
    UNLISTED,
    VACANT,
    CellGrid,
    FieldGrid,
    FieldRows,
    LatticeRows,
    X,
    Y,
    enlist,
    locate,
    settle,
    sort_by_cell,
)
from minerva_fast.values import Items, Reference, RuleGrid, ValueKind

if TYPE_CHECKING:
    from minerva_fast.space import Space


_SHAPES: Final = {"lattice": CellGrid, "field": FieldGrid}
BEFORE: Final = "before"
"""The parameter with the state of the subject before the rule."""
_MOVES: Final = {
    "cell": "move_to({table}, i, cell)",
    "x": "go_to({table}, i, x, y)",
    "y": "go_to({table}, i, x, y)",
}
"""How a rule changes what it may not assign to."""
Column: TypeAlias = NDArray[np.float64]
"""A declared name of a table, shape (n,)."""
Rows: TypeAlias = NDArray[np.int64]


class Inhabitants:
    """Base of tables; `OnLattice` and `InField` give their inhabitants a position.

    In a rule, columns are arrays of shape (capacity,) that are indexed by a row: `sheep.energy[i]`.
    """

    position: ClassVar[tuple[str, ...]] = ()
    rows: ClassVar[type[LatticeRows] | type[FieldRows]] = LatticeRows
    """What machine code sees, of which the last is the shape of the space."""
    searched: ClassVar[tuple[str, ...]] = ("nearby",)
    """The arrays with what the last search has found."""

    names: ClassVar[tuple[str, ...]] = ()
    """The rows of the matrix."""
    fixed: ClassVar[tuple[str, ...]] = ("id",)
    """Those to which a rule cannot assign."""
    id: Column
    cell: Rows
    values: Column

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "position" in vars(cls):
            return
        own = [name for name in get_annotations(cls) if not name.startswith("_")]
        taken = {*cls.rows._fields, "id"}
        if wrong := sorted(taken & set(own)):
            raise MisuseError(f"{cls.__name__}.{wrong[0]} is taken: every table has it")
        inherited = [name for name in cls.names if name not in ("id", *cls.position)]
        cls.names = ("id", *cls.position, *inherited, *own)
        cls.fixed = ("id", *cls.position)

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
    def parts(cls, name: str, *, own: bool) -> dict[str, Reference]:
        """What the attributes of a table are in a compiled rule.

        Args:
            name: the parameter of the rule.
            own: whether it is the subject, or its state before the rule.

        """
        before = name == BEFORE
        made: dict[str, Reference] = {}
        for column in (*columns_of(cls), "cell", *cls.searched):
            moves = _MOVES.get(column, "keep other numbers in columns of the table")
            fixed = "" if column in cls.names and column not in cls.fixed else f"write {moves}"
            if before:
                fixed = "change the subject of the rule: before is the state before it"
            slot, ints = FOUND if column in cls.searched else ROWS, column in ("cell", "nearby")
            made[column] = Items(
                f"c_{name}_{column}",
                ValueKind.INT if ints else ValueKind.REAL,
                f"n_{name}[{slot}]",
                owner=name,
                column=column,
                item="" if ints else "real",
                fixed=fixed.format(table=name),
                own=own and slot == ROWS,
            )
        shape = "field" if "field" in cls.rows._fields else "lattice"
        return {**made, shape: RuleGrid(f"g_{name}", _SHAPES[shape])}

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
    nearby: Rows
    lattice: CellGrid


class InField(Inhabitants):
    """Inhabitants at positions (x, y) of a continuous field."""

    position = ("x", "y")
    rows = FieldRows
    searched = ("nearby", "dx", "dy")
    x: Column
    y: Column
    nearby: Rows
    dx: Column
    dy: Column
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
        self._cells: dict[str, NDArray[Any]] = {}

    def cells(self, name: str, *, change: bool) -> NDArray[Any]:
        """The cells of a matrix, for rules that only read it or also change it."""
        cells = self._cells.get(name)
        if cells is None or (change and not cells.flags.writeable):
            matrix: NDArray[Any] = getattr(self._space, name)
            if change or matrix.flags.writeable:
                writable: NDArray[Any] = self._space.writable(name)
                # The method may have written to the same array before its rules.
                self._originals[name] = matrix.copy() if writable is matrix else matrix
                matrix = writable
            cells = self._cells[name] = matrix.reshape(-1)
        return cells

    def as_it_is(self, name: str) -> NDArray[Any]:
        """Cells that stay as they are while rules change the matrix, for rules that read them."""
        cells = self.cells(name, change=False)
        if cells.flags.writeable:
            cells = cells.copy()
            cells.flags.writeable = False
        return cells

    def reset(self) -> None:
        """Give the space the matrices that it had before the rules."""
        for name, matrix in self._originals.items():
            setattr(self._space, name, matrix)


LOCATE, ENLIST, SETTLE, SORT = map(Loop, (locate, enlist, settle, sort_by_cell))

_PER_CELL: Final = 2
"""Inhabitants per cell of a field's search, on average."""
_CROWDED: Final = 8.0
"""Inhabitants that share a cell, above which cells are smaller."""
_MOST_CELLS: Final = 16
"""Cells per inhabitant, if they are smaller."""


@dataclass(slots=True)
class Opened:
    """One table during a frame; `old` is its matrix in the string.

    `listed` is whether its rows are in the lists of their cells, which many rules do not need, and
    `moved` whether rows have moved since they were entered. `used` is whether rules have had the
    rows, and may have changed them.
    """

    kind: type[Inhabitants]
    old: Reals
    rows: LatticeRows | FieldRows
    listed: bool = False
    moved: bool = False
    used: bool = False

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
        capacity, shape = _with_room(count, room), lattice
        values = np.empty((len(matrix), capacity))
        values[:, :count] = matrix
        if issubclass(kind, InField):
            shape = _field(*extent, lattice.periodic, max(count, 1) / _PER_CELL)
        size = _size(shape)
        counts = np.array([count, size if vacant is None else vacant, 0, 0, 0])
        links, places = np.empty((3, capacity), np.int64), np.empty((3, size), np.int64)
        cell, nearby = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
        rows = LatticeRows(values, links, places, counts, births, cell, nearby, lattice)
        if isinstance(shape, FieldGrid):
            (dx, dy), reals, none = np.empty((2, capacity)), np.empty(0), np.empty(0, np.int64)
            x, y = values[X], values[Y]
            rows = FieldRows(*rows[:-1], dx, dy, none, none, reals, reals, x, y, shape)
        opened = Opened(kind, matrix, rows)
        opened._enter()
        return opened

    @property
    def shape(self) -> CellGrid | FieldGrid:
        """The cells of the lattice or field."""
        return self.rows[-1]

    def _enter(self) -> None:
        """Admit all rows. Raises MisuseError."""
        rows, (ids, where, *_) = self.rows, self.old
        largest, births = ids.max(initial=-1), rows.births[0]
        if largest >= births:
            raise MisuseError(
                f"{self.kind.__name__}: the id {largest:.0f} is not below the space's `births`"
                f" ({births:.0f}), from which newborns get their ids; set births={len(ids)} or more"
            )
        rows.links[ALIVE, : len(ids)] = 1
        if isinstance(rows, FieldRows):
            LOCATE(rows)
            self._divide_crowds(rows)
            return
        rows.cell[: len(ids)] = where
        last = rows.places.shape[1] - 1
        if where.min(initial=0) < 0 or where.max(initial=0) > last:
            raise MisuseError(
                f"{self.kind.__name__}: cells are numbers from 0 to {last} in a lattice of"
                f" {self.shape.width} x {self.shape.height}"
            )

    def _divide_crowds(self, rows: FieldRows) -> None:
        """Make the cells of a field smaller if many rows share one."""
        count, field = int(rows.counts[ROWS]), rows.field
        sizes = np.bincount(rows.cell[:count])
        shared = float(sizes @ sizes - count) / max(count - 1, 1)
        if shared <= _CROWDED:
            return
        finer = min(shared / _PER_CELL, _MOST_CELLS * _PER_CELL) ** 0.5
        field = field._replace(
            across=max(1, int(field.across * finer)), down=max(1, int(field.down * finer))
        )
        self.rows = rows._replace(field=field, places=np.empty((3, _size(field)), np.int64))
        LOCATE(self.rows)

    def reserve(self, births: int) -> None:
        """Make room for newborns."""
        count, capacity = int(self.rows.counts[ROWS]), len(self.rows.cell)
        if capacity - count >= births:
            return
        capacity = _with_room(count, births)
        wider: dict[str, NDArray[Any]] = {}
        for name in ("values", "links", "cell"):
            old: NDArray[Any] = getattr(self.rows, name)
            wider[name] = np.empty((*old.shape[:-1], capacity), old.dtype)
            wider[name][..., :count] = old[..., :count]
        self.rows = _with(self.rows, **wider)

    def snapshot(self) -> Opened:
        """The current state, which does not change, in read-only arrays of `values`."""
        self.enlist()
        values = self.old
        if self.used or values.flags.writeable:
            values = self.rows.values.copy()
            values.flags.writeable = False
        copied = ["cell", "counts", "births"]
        arrays = {"values": values}
        if isinstance(self.rows, LatticeRows):
            copied += ["links", "places"]
        else:
            # Its rows are sorted instead of in lists.
            arrays |= {"links": np.empty((3, 0), np.int64), "places": np.empty((3, 0), np.int64)}
            arrays |= self._sorted()
        arrays |= {name: getattr(self.rows, name).copy() for name in copied}
        return replace(self, rows=_with(self.rows, **arrays))

    def _sorted(self) -> dict[str, NDArray[Any]]:
        """The rows of each cell in the order of its list; none if no rule searches for rows."""
        count, places = int(self.rows.counts[ROWS]), self.rows.places
        if self.rows.counts[VACANT] == UNLISTED:
            return {}
        starts, order = np.empty(places.shape[1] + 1, np.int64), np.empty(count, np.int64)
        x, y = np.empty((2, count))
        SORT(self.rows, starts, order, x, y)
        return {"starts": starts, "sorted": order, "sorted_x": x, "sorted_y": y}

    def enlist(self) -> None:
        """Enter all rows into the lists of the cells where they are."""
        rows = self.rows
        if rows.counts[VACANT] == UNLISTED:
            return
        if not self.listed:
            ENLIST(rows.cell, rows.links, rows.places, rows.counts)
            self.listed = True
        if self.moved:
            SETTLE(rows)
            self.moved = False

    def argument(self, *, shared: bool = False) -> LatticeRows | FieldRows:
        """The rows for a rule.

        With `shared`, for a thread, what searches write is its own, and rows that move are entered
        into lists by `enlist`.
        """
        self.used = True
        if not shared:
            return self.rows
        counts = self.rows.counts.copy()
        counts[LATER] = 1
        return _with(self.rows, counts=counts)

    def table(self, name: str) -> SimpleNamespace:
        """What a rule sees that runs as Python; `name` is the parameter."""
        rows = self.argument()
        seen: dict[str, Any] = rows._asdict()
        for row, column in enumerate(self.kind.names):
            if column not in ("id", "cell"):
                seen[column] = rows.values[row]
        slots = dict.fromkeys(self.kind.names, ROWS) | dict.fromkeys(self.kind.searched, FOUND)
        for column, slot in slots.items():
            if column != "id":
                seen[column] = Guarded(f"{name}.{column}", seen[column], rows.counts, slot)
        return SimpleNamespace(**seen)

    def close(self) -> Reals:
        """The matrix of the remaining rows and of newborns, in their order; ends its use here."""
        counts, values = self.rows.counts, self.rows.values
        count = int(counts[ROWS])
        if isinstance(self.rows, LatticeRows):
            values[1, :count] = self.rows.cell[:count]
        if counts[GONE]:
            alive = self.rows.links[ALIVE, :count].nonzero()[0]
            matrix = values[:, :count].take(alive, axis=1)
        else:
            matrix = values if count == values.shape[1] else values[:, :count].copy()
        # Read-only arrays that own their memory become attributes without another copy.
        matrix.flags.writeable = False
        return matrix


def _with(rows: Any, **arrays: NDArray[Any]) -> Any:
    """Rows with other arrays, and with new ones for what a search finds."""
    made: dict[str, NDArray[Any]] = {"values": rows.values, "cell": rows.cell, **arrays}
    capacity = len(made["cell"])
    made["nearby"] = np.empty(capacity, np.int64)
    if isinstance(rows, FieldRows):
        made["dx"], made["dy"] = np.empty((2, capacity))
        made["x"], made["y"] = made["values"][X], made["values"][Y]
    return rows._replace(**made)


def _with_room(count: int, births: int) -> int:
    """A capacity for rows and newborns, with which most tables need no second one."""
    return max(2 * count, count + births) if births else count


def _size(shape: CellGrid | FieldGrid) -> int:
    if isinstance(shape, FieldGrid):
        return shape.across * shape.down
    return shape.width * shape.height


def _field(width: float, height: float, periodic: bool, cells: float) -> FieldGrid:
    """A field with about this number of square cells for the search."""
    spacing = (width * height / cells) ** 0.5
    across, down = max(1, int(width / spacing)), max(1, int(height / spacing))
    return FieldGrid(width, height, periodic, across, down)


def loops_of_table(kind: type[Inhabitants]) -> tuple[Loop, ...]:
    """The loops that open a table."""
    return (LOCATE, ENLIST, SETTLE, SORT) if issubclass(kind, InField) else (ENLIST,)
