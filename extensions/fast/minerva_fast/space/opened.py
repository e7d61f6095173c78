"""Tables opened for the rules of a frame: arrays with room for newborns, and lists of cells."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from operator import itemgetter
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Reals
from minerva_fast.space.cell_lists import (
    ENLIST,
    ENTER,
    ENTERING,
    LOCATE,
    LOCATING,
    OUTSIDE,
    SETTLE,
    SHARING,
    SORT,
    SORT_BY_NUMBER,
    UNBORN,
    CellLists,
)
from minerva_fast.space.compiling import RuleLoop
from minerva_fast.space.field import FieldGrid
from minerva_fast.space.lattice import CellGrid
from minerva_fast.space.matrices import is_constant
from minerva_fast.space.occupancy import ALIVE, GONE, LATER, ROWS, UNLISTED, VACANT
from minerva_fast.space.tables import INDEX, Column, InField, Inhabitants, Rows

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
