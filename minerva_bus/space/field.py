"""Positions in a continuous field, and the search for neighbours in cell lists."""

from __future__ import annotations

from typing import Any, NamedTuple

from minerva_bus.space.kernels import kernel
from minerva_bus.space.occupancy import FIRST, NEXT, move_to, span


class FieldGrid(NamedTuple):
    """A rectangle, divided into cells for the search.

    Attributes:
        width: in the units of x.
        height: in the units of y.
        periodic: whether opposite edges are connected.
        across: cells in a row.
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
    return row * field.across + column


@kernel
def wrapped(number: float, size: float) -> float:
    """A coordinate within [0, size) of a periodic field."""
    inside = number % size
    return inside if inside < size else 0.0


@kernel
def shorter(difference: float, size: float) -> float:
    """A difference of coordinates in a periodic field, by the shorter way."""
    if difference > 0.5 * size:
        return difference - size
    return difference + size if difference < -0.5 * size else difference


@kernel
def go_to(table: Any, i: int, x: float, y: float) -> None:
    """Move row i to a position; beyond a periodic edge it enters on the other side."""
    field = table.field
    if field.periodic:
        x, y = wrapped(x, field.width), wrapped(y, field.height)
    table.x[i], table.y[i] = x, y
    move_to(table, i, cell_of(field, x, y))


@kernel
def near(table: Any, x: float, y: float, radius: float, other_than: int) -> int:
    """Find the rows within a Euclidean distance of a position, without row `other_than`.

    Returns their number n. `table.nearby`, `table.dx` and `table.dy` then have the n rows and their
    differences to the position, until the next search. Their order depends on the cells only, so
    sums over them have the same bits everywhere.
    """
    field = table.field
    home = cell_of(field, x, y)
    row, column = home // field.across, home % field.across
    # One more cell on both sides, because the position is anywhere in its own.
    left = int(radius / field.width * field.across) + 1
    up = int(radius / field.height * field.down) + 1
    first_u, last_u = span(column, left, field.across, field.periodic)
    first_v, last_v = span(row, up, field.down, field.periodic)
    count, square = 0, radius * radius
    for v in range(first_v, last_v):
        for u in range(first_u, last_u):
            j = table.places[FIRST, v % field.down * field.across + u % field.across]
            while j >= 0:
                dx, dy = table.x[j] - x, table.y[j] - y
                if field.periodic:
                    dx, dy = shorter(dx, field.width), shorter(dy, field.height)
                if j != other_than and dx * dx + dy * dy <= square:
                    table.nearby[count], table.dx[count], table.dy[count] = j, dx, dy
                    count += 1
                j = table.links[NEXT, j]
    return count
