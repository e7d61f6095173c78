"""Kernels that enter the rows of a table into the lists of their cells, or sort them by cell."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from minerva_fast.space.compiling import around
from minerva_fast.space.field import FieldGrid, cell_of
from minerva_fast.space.kernels import kernel
from minerva_fast.space.occupancy import (
    ALIVE,
    FIRST,
    FREE,
    NEXT,
    PREVIOUS,
    ROWS,
    SLOT,
    UNCOUNTED,
    UNLISTED,
    VACANT,
    move_to,
)
from minerva_fast.space.tables import Column, Rows

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
