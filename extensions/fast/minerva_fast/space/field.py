"""Positions in a continuous field, and the search for neighbours in its cells."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from minerva_fast.space.guarded import unchecked
from minerva_fast.space.kernels import kernel
from minerva_fast.space.occupancy import FIRST, FOUND, LATER, NEXT, move_to

MARGIN: Final = 1e-9
FAR: Final = 1e15
"""A number of cells beyond which reals are not exact enough for the cells of a search."""


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
    # Computed even if it is not needed, because nan, which is in no cell, must be an error.
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
    wraps = field.periodic and not (
        reaches_no_edge(x, radius, field.width, field.across) and reaches_no_edge(y, radius, field.height, field.down)
    )
    count = 0
    table.counts[FOUND] = table.values.shape[1]
    # Unchecked, because these cells exist, and each has rows that no other one has.
    starts, order = unchecked(table.starts), unchecked(table.sorted)
    sorted_x, sorted_y = unchecked(table.sorted_x), unchecked(table.sorted_y)
    firsts, following = unchecked(table.places[FIRST]), unchecked(table.links[NEXT])
    row_x, row_y = unchecked(table.x), unchecked(table.y)
    for _ in range(columns):
        if len(table.starts):
            # Two parts if the cells continue at the other edge.
            first, beyond = u * field.down, max(top + rows - field.down, 0)
            k, end = starts[first + top], starts[first + top + rows - beyond]
            while True:
                while k < end:
                    dx, dy = sorted_x[k] - x, sorted_y[k] - y
                    count += meet(table, count, order[k], dx, dy, radius, other_than, wraps)
                    k += 1
                if not beyond:
                    break
                k, end, beyond = starts[first], starts[first + beyond], 0
        else:
            v = top
            for _ in range(rows):
                j = firsts[u * field.down + v]
                while j >= 0:
                    dx, dy = row_x[j] - x, row_y[j] - y
                    count += meet(table, count, j, dx, dy, radius, other_than, wraps)
                    j = following[j]
                v = v + 1 if v + 1 < field.down else 0
        u = u + 1 if u + 1 < field.across else 0
    table.counts[FOUND] = count
    return count


@kernel
def meet(
    table: Any, count: int, j: int, dx: float, dy: float, radius: float, other_than: int,
    wraps: bool,
) -> int:  # fmt: skip
    """Write row j at `count` of `nearby`; 1 if it is near, else 0."""
    field = table.field
    if wraps:
        dx, dy = shortest(dx, field.width), shortest(dy, field.height)
    # Without a branch, because a processor cannot foresee which of the rows are near.
    nearby, apart_x, apart_y = unchecked(table.nearby), unchecked(table.dx), unchecked(table.dy)
    nearby[count], apart_x[count], apart_y[count] = j, dx, dy
    return int(j != other_than) & int(dx * dx + dy * dy <= radius * radius)


@kernel
def reaches_no_edge(center: float, radius: float, size: float, cells: int) -> bool:
    """Whether an interval meets no cell at an edge, so that no way across edges is shorter.

    Cells at an edge also have the rows outside. A little more than a cell, because of rounding.
    """
    margin = radius + 1.001 * size / cells
    return margin < center and center < size - margin


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
    below, above = low / size * cells - MARGIN, high / size * cells + MARGIN
    if not (below > -FAR and above < FAR):  # also without a number
        return 0, cells
    first, last = math.floor(below), math.floor(above)
    if periodic:
        start = first if 0 <= first < cells else first % cells
        return start, min(max(last - first + 1, 0), cells)
    # Positions outside the field are in the cells at its edge.
    first, last = min(max(first, 0), cells - 1), min(max(last, 0), cells - 1)
    return first, max(last - first + 1, 0)
