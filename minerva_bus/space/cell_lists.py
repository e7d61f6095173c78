"""Kernels that enter the rows of a table into the lists of their cells, or sort them by cell."""

from __future__ import annotations

from typing import Final, NamedTuple

from minerva_bus.space.compiling import around
from minerva_bus.space.field import FieldGrid, cell_of
from minerva_bus.space.kernels import kernel
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
    move_to,
)
from minerva_bus.space.tables import Column, Rows

ENTERED, UNBORN, OUTSIDE = 0, 1, 2


class CellLists(NamedTuple):
    """The arrays of a table in which its rows have cells."""

    cell: Rows
    links: Rows
    places: Rows
    counts: Rows


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


_INTS: Final = "int64[::1]"
_TABLE: Final = "int64[:, ::1]"
_REALS: Final = "float64[::1]"
ENTERING: Final = ("values", "cell", "links", "places", "counts", "births")
"""The arrays of a table that ENTER takes."""
ENTER: Final = around(
    enter, ("float64[:, ::1]", _INTS, _TABLE, _TABLE, _INTS, _INTS), result="int64"
)
SORT: Final = around(sort_by_cell, (_TABLE, _TABLE, _REALS, _REALS, _INTS, _INTS, _REALS, _REALS))
SETTLE: Final = around(
    settle,
    (
        _INTS,
        _TABLE,
        _TABLE,
        _INTS,
        _REALS,
        _REALS,
        "float64",
        "float64",
        "boolean",
        "int64",
        "int64",
    ),
)
LOCATE: Final = around(locate, (_INTS, _REALS, _REALS, "float64", "float64", "int64", "int64"))
