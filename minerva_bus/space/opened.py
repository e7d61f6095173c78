"""Tables opened for the rules of a frame: arrays with room for newborns, and lists of cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Reals
from minerva_bus.space.cell_lists import (
    ENTER,
    ENTERING,
    LOCATE,
    OUTSIDE,
    SETTLE,
    SORT,
    UNBORN,
    CellLists,
)
from minerva_bus.space.compiling import RuleLoop
from minerva_bus.space.field import FieldGrid
from minerva_bus.space.lattice import CellGrid
from minerva_bus.space.occupancy import (
    ALIVE,
    LATER,
    ROWS,
    UNCOUNTED,
)
from minerva_bus.space.tables import INDEX, Column, InField, Inhabitants, Rows, columns_of

_PER_CELL: Final = 2
"""Inhabitants per cell of a field's search, on average."""
_CROWDED: Final = 8.0
"""Inhabitants that share a cell, above which cells are smaller."""
_MOST_CELLS: Final = 16
"""Cells per inhabitant, if they are smaller."""
_SAMPLE: Final = 4096

_UNSORTED: Final = dict(
    zip(InField.sorted_rows, (*np.empty((2, 0), np.int64), *np.empty((2, 0))), strict=True)
)
"""Of a table whose rows move."""

_SEARCHED: Final = ("nearby", "apart")
"""What searches write."""


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
            x, y = matrix[kind.names.index("x")], matrix[kind.names.index("y")]
            shape = _field(extent, lattice.periodic, x, y)
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
            "counts": np.array([count, cells if free else UNCOUNTED, 0, 0]),
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
        entered = ENTER(*[arrays[name] for name in ENTERING])
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

    def settle(self) -> None:
        """Enter the rows that threads have moved in a field into the lists of their cells."""
        lists = [self.arrays[name] for name in CellLists._fields]
        SETTLE(*lists, *self._places(), *self.shape)

    def arguments(self, *, shared: bool = False) -> list[Any]:
        """The arrays and numbers of the kind's tuple, in the order of its fields.

        With `shared`, for one of several threads, what searches write is its own, and rows that
        move are entered by `settle`.
        """
        if shared:
            arrays = {name: each for name, each in self.arrays.items() if name not in _SEARCHED}
            arrays["counts"] = arrays["counts"].copy()
            arrays["counts"][LATER] = 1
            return replace(self, arrays=arrays).arguments()
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


def _field(extent: tuple[float, float], periodic: bool, x: Column, y: Column) -> FieldGrid:
    """The cells for a search among these positions; smaller ones where many share a cell."""
    width, height = extent
    spacing = (width * height * _PER_CELL / max(len(x), 1)) ** 0.5
    across, down = max(1, int(width / spacing)), max(1, int(height / spacing))
    shared = _sharing(x / width * across, y / height * down, down)
    if shared > _CROWDED:
        finer = min(shared / _PER_CELL, _MOST_CELLS * _PER_CELL) ** 0.5
        across, down = max(1, int(across * finer)), max(1, int(down * finer))
    return FieldGrid(width, height, periodic, across, down)


def _sharing(columns: Column, rows: Column, down: int) -> float:
    """About how many others an inhabitant shares its cell with, from a sample."""
    step = max(1, len(columns) // _SAMPLE)
    cells = np.floor(columns[::step]) * down + np.floor(rows[::step])
    _, together = np.unique(cells, return_counts=True)
    pairs = len(cells) * (len(cells) - 1)
    shared = int(np.sum(together * (together - 1)))
    return len(columns) * shared / pairs if pairs else 0.0


def loops_of_table(kind: type[Inhabitants]) -> tuple[RuleLoop, ...]:
    """The loops that open a table."""
    return (LOCATE, ENTER, SORT, SETTLE) if issubclass(kind, InField) else (ENTER,)
