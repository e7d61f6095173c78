"""Positions in a continuous field, and the search for neighbours in its cells."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from minerva_bus.space.kernels import kernel
from minerva_bus.space.occupancy import FIRST, FOUND, LATER, NEXT, move_to

MARGIN: Final = 1e-9


class FieldGrid(NamedTuple):
    """A rectangle, divided into cells for the search; cell = column * down + row.

    Attributes:
        width: in the units of x.
        height: in the units of y.
        periodic: whether opposite edges are connected.
        across: columns of cells.
        down: rows of cells.

    """

    width: float
    height: float
    periodic: bool
    across: int
    down: int


@kernel
def cell_of(field: FieldGrid, x: float, y: float) -> int:
    """The cell that contains a position; positions outside belong to the nearest cell."""
    column = min(max(int(x / field.width * field.across), 0), field.across - 1)
    row = min(max(int(y / field.height * field.down), 0), field.down - 1)
    return column * field.down + row


@kernel
def wrapped(number: float, size: float) -> float:
    """A coordinate within [0, size) of a periodic field."""
    # The usual case: a remainder takes many times as long as these comparisons.
    if 0.0 < number < size:
        return number
    inside = number % size
    return inside if inside < size else 0.0


@kernel
def go_to(table: Any, i: int, x: float, y: float) -> None:
    """Move row i to a position; beyond a periodic edge it enters on the other side."""
    field = table.field
    if field.periodic:
        x, y = wrapped(x, field.width), wrapped(y, field.height)
    table.x[i], table.y[i] = x, y
    # Also before it is needed: for nan, which is in no cell, this is an error.
    cell = cell_of(field, x, y)
    if not table.counts[LATER]:
        move_to(table, i, cell)


@kernel
def near(table: Any, x: float, y: float, radius: float, other_than: int) -> int:
    """Find the rows within a Euclidean distance of a position, without row `other_than`.

    Returns their number n. `table.nearby`, `table.dx` and `table.dy` then have the n rows and their
    differences to the position, until the next search. Their order depends on the cells only, so
    sums over them have the same bits everywhere. Rows that are sorted by cell have the order of the
    lists that they were in.
    """
    field, radius = table.field, float(radius)
    # A little more than the radius, so that rounding cannot exclude a cell at its edge.
    u, columns = cells_between(x - radius, x + radius, field.width, field.across, field.periodic)
    top, rows = cells_between(y - radius, y + radius, field.height, field.down, field.periodic)
    count = 0
    table.counts[FOUND] = table.values.shape[1]
    for _ in range(columns):
        if len(table.starts):
            # Two parts if the cells continue at the other edge.
            first, beyond = u * field.down, max(top + rows - field.down, 0)
            k, end = table.starts[first + top], table.starts[first + top + rows - beyond]
            while True:
                while k < end:
                    j = table.sorted[k]
                    dx, dy = table.sorted_x[k] - x, table.sorted_y[k] - y
                    count += meet(table, count, j, dx, dy, radius, other_than)
                    k += 1
                if not beyond:
                    break
                k, end, beyond = table.starts[first], table.starts[first + beyond], 0
        else:
            v = top
            for _ in range(rows):
                j = table.places[FIRST, u * field.down + v]
                while j >= 0:
                    dx, dy = table.x[j] - x, table.y[j] - y
                    count += meet(table, count, j, dx, dy, radius, other_than)
                    j = table.links[NEXT, j]
                v = v + 1 if v + 1 < field.down else 0
        u = u + 1 if u + 1 < field.across else 0
    table.counts[FOUND] = count
    return count


@kernel
def meet(
    table: Any, count: int, j: int, dx: float, dy: float, radius: float, other_than: int
) -> int:
    """Write row j at `count` of `nearby`; 1 if it is near, else 0."""
    field = table.field
    if field.periodic:
        dx, dy = shortest(dx, field.width), shortest(dy, field.height)
    # Without a branch, because a processor cannot foresee which of the rows are near.
    table.nearby[count], table.dx[count], table.dy[count] = j, dx, dy
    return int(j != other_than) & int(dx * dx + dy * dy <= radius * radius)


@kernel
def shortest(difference: float, size: float) -> float:
    """A difference of coordinates, across connected edges if this is shorter."""
    if difference > 0.5 * size:
        return difference - size
    if difference < -0.5 * size:
        return difference + size
    return difference


@kernel
def cells_between(
    low: float, high: float, size: float, cells: int, periodic: bool
) -> tuple[int, int]:
    """The first of the cells that an interval of coordinates meets, and their number."""
    first = math.floor(low / size * cells - MARGIN)
    last = math.floor(high / size * cells + MARGIN)
    if periodic:
        start = first if 0 <= first < cells else first % cells
        return start, min(last - first + 1, cells)
    # Positions outside the field are in the cells at its edge.
    first, last = min(max(first, 0), cells - 1), min(max(last, 0), cells - 1)
    return first, last - first + 1
