"""Tables opened for the rules of a frame: arrays with room for newborns, and lists of cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Reals
from minerva_bus.space.compiling import RuleLoop, around
from minerva_bus.space.field import FieldGrid, cell_of
from minerva_bus.space.kernels import kernel
from minerva_bus.space.lattice import CellGrid
from minerva_bus.space.occupancy import (
    ALIVE,
    FIRST,
    FREE,
    NEXT,
    PREVIOUS,
    ROWS,
    SLOT,
    UNCOUNTED,
    VACANT,
)
from minerva_bus.space.tables import INDEX, Column, InField, Inhabitants, Rows, columns_of

_PER_CELL: Final = 2
"""Inhabitants per cell of a field's search, on average."""

_UNSORTED: Final = dict(
    zip(InField.sorted_rows, (*np.empty((2, 0), np.int64), *np.empty((2, 0))), strict=True)
)
"""Of a table whose rows move."""

ENTERED, UNBORN, OUTSIDE = 0, 1, 2


@dataclass(slots=True)
class Opened:
    """The arrays of one table during a frame; `old` is its matrix in the string."""

    kind: type[Inhabitants]
    old: Reals
    arrays: dict[str, NDArray[Any]]
    shape: CellGrid | FieldGrid

    @staticmethod
    def of(
        kind: type[Inhabitants],
        matrix: Reals,
        lattice: CellGrid,
        extent: tuple[float, float],
        births: Rows,
        *,
        free: bool,
        room: int,
    ) -> Opened:
        """Open a matrix of the string.

        Args:
            kind: the table.
            matrix: its state.
            lattice: the shape of the space in cells.
            extent: the width and height of the space.
            births: the id of the next newborn, shared by all tables, shape (1,).
            free: whether to list free cells.
            room: the most newborns of an activation, for which there is room at first.

        Raises:
            MisuseError: the matrix does not fit the space.

        """
        kind.check(matrix)
        shape = lattice
        if issubclass(kind, InField):
            shape = _field(extent, lattice.periodic, matrix.shape[1])
        opened = Opened(kind, matrix, {"births": births}, shape)
        opened._allocate(matrix, free, room)
        opened._enter()
        return opened

    def _allocate(self, matrix: Reals, free: bool, room: int) -> None:
        count, cells = matrix.shape[1], _cells(self.shape)
        capacity = _with_room(count, room)
        values = np.empty((len(matrix), capacity))
        values[:, :count] = matrix
        self.arrays |= {
            "places": np.empty((3, cells), np.int64),
            "counts": np.array([count, cells if free else UNCOUNTED, 0]),
            "values": values,
            "links": np.empty((3, capacity), np.int64),
            "cell": np.empty(capacity, np.int64),
        }

    def _enter(self) -> None:
        arrays, count = self.arrays, self.old.shape[1]
        cells = arrays["cell"][:count]
        if isinstance(self.shape, FieldGrid):
            field = self.shape
            LOCATE(cells, *self._places(), field.width, field.height, field.across, field.down)
        else:
            cells[:] = self.old[1]
        entered = ENTER(*[arrays[name] for name in _ENTERED])
        if entered == UNBORN:
            largest, births = self.old[0].max(), arrays["births"][0]
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

    def snapshot(self) -> Opened:
        """A copy of the current state, which does not change."""
        if isinstance(self.shape, CellGrid):
            arrays = {name: array.copy() for name, array in self.arrays.items()}
            return replace(self, arrays=arrays)
        arrays = {name: self.arrays[name].copy() for name in ("values", "cell", "counts", "births")}
        # Its rows are sorted instead of in lists.
        arrays |= {"links": np.empty((3, 0), np.int64), "places": np.empty((3, 0), np.int64)}
        return replace(self, arrays=arrays | self._sorted())

    def _sorted(self) -> dict[str, NDArray[Any]]:
        """The rows of each cell in the order of its list."""
        places, links = self.arrays["places"], self.arrays["links"]
        count = int(self.arrays["counts"][ROWS])
        starts, rows = np.empty(places.shape[1] + 1, np.int64), np.empty(count, np.int64)
        at = np.empty((2, count))
        SORT(places, links, *self._places(), starts, rows, *at)
        return dict(zip(self.kind.sorted_rows, (starts, rows, *at), strict=True))

    def _places(self) -> tuple[Column, Column]:
        """The positions of all rows in a field."""
        row, count = self.kind.names.index("x"), int(self.arrays["counts"][ROWS])
        x, y = self.arrays["values"][row : row + 2, :count]
        return x, y

    def arguments(self) -> list[Any]:
        """The arrays and numbers of the kind's tuple, in the order of `parameters`."""
        arrays, names = self.arrays, self.kind.names
        values = arrays["values"]
        rows = [values[names.index(name)] for name in columns_of(self.kind)]
        return [*[arrays[name] for name in INDEX], *rows, *self._extra()]

    def _extra(self) -> list[Any]:
        arrays, capacity = self.arrays, len(self.arrays["cell"])
        if "nearby" not in arrays or len(arrays["nearby"]) != capacity:
            arrays |= {"nearby": np.empty(capacity, np.int64), "apart": np.empty((2, capacity))}
        if isinstance(self.shape, CellGrid):
            return [arrays["nearby"], *self.shape]
        sorted_rows = [arrays.get(name, none) for name, none in _UNSORTED.items()]
        return [arrays["nearby"], *arrays["apart"], *sorted_rows, *self.shape]

    def close(self) -> Reals:
        """The matrix of the remaining rows and of newborns, in their order; ends its use here."""
        count = int(self.arrays["counts"][ROWS])
        values, alive = self.arrays["values"], self.arrays["links"][ALIVE, :count]
        if "cell" in self.kind.position:
            values[1, :count] = self.arrays["cell"][:count]
        kept = np.flatnonzero(alive)
        if len(kept) == values.shape[1]:
            matrix = values
        else:
            used = values[:, :count]
            matrix = used.copy() if len(kept) == count else used.take(kept, axis=1)
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


def _field(extent: tuple[float, float], periodic: bool, count: int) -> FieldGrid:
    width, height = extent
    spacing = (width * height * _PER_CELL / max(count, 1)) ** 0.5
    across, down = max(1, int(width / spacing)), max(1, int(height / spacing))
    return FieldGrid(width, height, periodic, across, down)


@kernel
def enter(values: Column, cell: Rows, links: Rows, places: Rows, counts: Rows, births: Rows) -> int:
    """Build the lists of all cells; the rows of a cell are in the order of the table.

    Returns ENTERED, UNBORN if an id is not below `births`, or OUTSIDE if a cell does not exist.
    """
    cells = places.shape[1]
    for i in range(counts[ROWS]):
        if values[0, i] >= births[0]:
            return UNBORN
        if cell[i] < 0 or cell[i] >= cells:
            return OUTSIDE
    for place in range(cells):
        places[FIRST, place] = -1
    for i in range(counts[ROWS] - 1, -1, -1):
        other = places[FIRST, cell[i]]
        links[NEXT, i], links[PREVIOUS, i], links[ALIVE, i] = other, -1, 1
        places[FIRST, cell[i]] = i
        if other >= 0:
            links[PREVIOUS, other] = i
    if counts[VACANT] == UNCOUNTED:
        return ENTERED
    vacant = 0
    for place in range(places.shape[1]):
        if places[FIRST, place] < 0:
            places[FREE, vacant], places[SLOT, place] = place, vacant
            vacant += 1
    counts[VACANT] = vacant
    return ENTERED


@kernel
def locate(
    cell: Rows, x: Column, y: Column, width: float, height: float, across: int, down: int
) -> None:
    """The cell of each position in a field."""
    field = FieldGrid(width, height, False, across, down)
    for i in range(len(x)):
        cell[i] = cell_of(field, x[i], y[i])


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


_INTS: Final = "int64[::1]"
_TABLE: Final = "int64[:, ::1]"
_REALS: Final = "float64[::1]"
_ENTERED: Final = ("values", "cell", "links", "places", "counts", "births")
ENTER: Final = around(
    enter, ("float64[:, ::1]", _INTS, _TABLE, _TABLE, _INTS, _INTS), result="int64"
)
SORT: Final = around(sort_by_cell, (_TABLE, _TABLE, _REALS, _REALS, _INTS, _INTS, _REALS, _REALS))
LOCATE: Final = around(locate, (_INTS, _REALS, _REALS, "float64", "float64", "int64", "int64"))


def loops_of_table(kind: type[Inhabitants]) -> tuple[RuleLoop, ...]:
    """The loops that open a table."""
    return (LOCATE, ENTER, SORT) if issubclass(kind, InField) else (ENTER,)
