"""Which rows are in which cell: a list of the rows of each cell, and the free cells.

A table has no lists in a frame whose rules do not search it.

Functions for rules over tables (`minerva_fast.space.tables`). `place` and `take_out` keep the lists
complete while rows move. The rows of a cell are in a fixed order: at the start of a frame that of
the table, later the last to arrive first.
"""

from __future__ import annotations

from typing import Any

from minerva_fast.space.draws import Draws, integers
from minerva_fast.space.guarded import unchecked
from minerva_fast.space.kernels import kernel
from minerva_fast.space.lattice import NO_CELL, inside, row_of

# Rows of `table.links`: the next and the previous row in the same cell, and whether a row exists.
NEXT, PREVIOUS, ALIVE = 0, 1, 2
# Rows of `table.places`: the first row in each cell, the free cells, and where a cell is in these.
FIRST, FREE, SLOT = 0, 1, 2
# Items of `table.counts`: rows in use, free cells, rows that the last search has found, whether
# rows are entered into the lists of their cells only after the rule, and rows that were removed.
ROWS, VACANT, FOUND, LATER, GONE = 0, 1, 2, 3, 4

UNCOUNTED = -1
"""In place of the number of free cells: no rule asks for one, so there is no list of them."""

UNLISTED = -2
"""The same if no rule searches for rows either, so there are no lists of those in a cell."""

TOO_MANY = "one activation made more copies than `births` of the rule allows"
REMOVED = "a row that was removed cannot move or be removed again"


@kernel
def place(table: Any, i: int, cell: int) -> None:
    """Enter row i into the list of a cell."""
    if not 0 <= cell < table.places.shape[1]:
        raise IndexError(NO_CELL)
    table.cell[i] = cell
    if table.counts[VACANT] == UNLISTED:
        return
    first = table.places[FIRST, cell]
    table.links[NEXT, i], table.links[PREVIOUS, i] = first, -1
    table.places[FIRST, cell] = i
    if first >= 0:
        table.links[PREVIOUS, first] = i
        return
    if table.counts[VACANT] == UNCOUNTED:
        return
    # The cell was free: the last free cell takes its slot.
    slot, last = table.places[SLOT, cell], table.counts[VACANT] - 1
    other = table.places[FREE, last]
    table.places[FREE, slot], table.places[SLOT, other] = other, slot
    table.counts[VACANT] = last


@kernel
def take_out(table: Any, i: int) -> None:
    """Remove row i from the list of its cell."""
    if not table.links[ALIVE, i]:
        raise IndexError(REMOVED)
    if table.counts[VACANT] == UNLISTED:
        return
    cell, before, after = table.cell[i], table.links[PREVIOUS, i], table.links[NEXT, i]
    if after >= 0:
        table.links[PREVIOUS, after] = before
    if before >= 0:
        table.links[NEXT, before] = after
        return
    table.places[FIRST, cell] = after
    if after < 0 and table.counts[VACANT] != UNCOUNTED:
        last = table.counts[VACANT]
        table.places[FREE, last], table.places[SLOT, cell] = cell, last
        table.counts[VACANT] = last + 1


@kernel
def move_to(table: Any, i: int, cell: int) -> None:
    """Move row i to a cell."""
    if cell != table.cell[i]:
        take_out(table, i)
        place(table, i, cell)


@kernel
def remove(table: Any, i: int) -> None:
    """Remove row i from the space; it takes part in no further rule."""
    take_out(table, i)
    table.links[ALIVE, i] = 0
    table.counts[GONE] += 1


@kernel
def copy(table: Any, i: int) -> int:
    """Add a copy of row i in its cell, with a new id; returns its row."""
    j, cell = table.counts[ROWS], table.cell[i]
    if j == table.links.shape[1]:
        raise IndexError(TOO_MANY)
    table.counts[ROWS] = j + 1
    for column in range(len(table.values)):
        table.values[column, j] = table.values[column, i]
    table.values[0, j] = table.births[0]
    table.births[0] += 1
    table.links[ALIVE, j] = 1
    place(table, j, cell)
    return int(j)


@kernel
def random_at(table: Any, cell: int, draws: Draws) -> int:
    """A random row of a cell; -1 if there is none. Draws only if there are several."""
    if not 0 <= cell < table.places.shape[1]:
        raise IndexError(NO_CELL)
    first = table.places[FIRST, cell]
    if first < 0 or table.links[NEXT, first] < 0:
        return int(first)
    count, row = 0, first
    while row >= 0:
        count, row = count + 1, table.links[NEXT, row]
    row = first
    for _ in range(integers(draws, 0, count)):
        row = table.links[NEXT, row]
    return int(row)


@kernel
def random_free(table: Any, draws: Draws) -> int:
    """A random cell without rows of this table; -1 if there is none."""
    if not table.counts[VACANT]:
        return -1
    return int(table.places[FREE, integers(draws, 0, table.counts[VACANT])])


@kernel
def within(table: Any, cell: int, radius: int) -> int:
    """Find the rows within a Chebyshev distance of a cell, including its own.

    Returns their number n. `table.nearby` then has the n rows, by cell from the first row of cells
    on, until the next search.
    """
    lattice, count = table.lattice, 0
    radius = min(radius, lattice.width + lattice.height)  # all cells
    table.counts[FOUND] = table.links.shape[1]
    inside(lattice, cell)
    y = row_of(lattice, cell)
    x = cell - y * lattice.width
    left, right = span(x, radius, lattice.width, lattice.periodic)
    top, bottom = span(y, radius, lattice.height, lattice.periodic)
    # Unchecked, because these cells exist, and each has rows that no other one has.
    firsts, following = unchecked(table.places[FIRST]), unchecked(table.links[NEXT])
    nearby = unchecked(table.nearby)
    for v in range(top, bottom):
        line = connected(v, lattice.height) * lattice.width
        for u in range(left, right):
            j = firsts[line + connected(u, lattice.width)]
            while j >= 0:
                nearby[count] = j
                count, j = count + 1, following[j]
    table.counts[FOUND] = count
    return count


@kernel
def span(middle: int, radius: int, size: int, periodic: bool) -> tuple[int, int]:
    """The first and the one after the last of the cells around one; each cell occurs once."""
    if not periodic:
        return max(middle - radius, 0), min(middle + radius + 1, size)
    width = min(2 * radius + 1, size)
    return middle - width // 2, middle - width // 2 + width


@kernel
def connected(number: int, size: int) -> int:
    """A column or row less than one size beyond an edge, as the one on the other side."""
    # A remainder takes several times as long as these comparisons.
    if number < 0:
        return number + size
    return number - size if number >= size else number
