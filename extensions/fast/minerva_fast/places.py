"""Where inhabitants are: cells of lattices, positions in fields, nodes of graphs, and neighbours.

    lattice     cell = y * width + x
    field       positions (x, y), and cells in which neighbours are searched
    graph       edges between nodes, which are the cells of a space, usually in one row

A table has a list of the rows of each cell, and the free cells, but not in a frame whose rules do
not search it. `place` and `take_out` keep the lists complete while rows move. The rows of a cell
are in a fixed order: at the start of a frame that of the table, later the last to arrive first.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Reals
from minerva_fast.draws import Draws, integers


class CellGrid(NamedTuple):
    """Width and height in cells, and whether opposite edges are connected.

    `inner` is a cell with 8 neighbours beside it without a way across an edge, which saves `beside`
    the comparisons, or -1.
    """

    width: int
    height: int
    periodic: bool
    inner: int = -1


Numbers: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Columns: TypeAlias = np.ndarray[tuple[int, int], np.dtype[np.float64]]
Links: TypeAlias = np.ndarray[tuple[int, int], np.dtype[np.int64]]


def sure(index: int) -> int:
    """An index that is known to exist, which machine code does not count from the end."""
    return index


class LatticeRows(NamedTuple):
    """What machine code sees of a table in a lattice."""

    values: Columns
    links: Links
    places: Links
    counts: Ints
    births: Ints
    cell: Ints
    nearby: Ints
    lattice: CellGrid


NO_CELL = "a cell is outside of the lattice, as -1 of `beside` or `random_free` is; test it before"


def inside(lattice: CellGrid, cell: int) -> None:
    """Raise IndexError if there is no such cell."""
    if not 0 <= cell < lattice.width * lattice.height:
        raise IndexError(NO_CELL)


def row_of(lattice: CellGrid, cell: int) -> int:
    """The row y of a cell."""
    # Division of 64-bit ints takes several times as long, and most time of a cellular automaton.
    return int(np.uint32(cell) // np.uint32(lattice.width))


def surrounded(lattice: CellGrid, cell: int) -> bool:
    """Whether a cell, from 0, has 8 neighbours without a way across an edge."""
    if lattice.width < 3 or lattice.height < 3:
        return False
    row = row_of(lattice, cell)
    return 0 < row < lattice.height - 1 and 0 < cell - row * lattice.width < lattice.width - 1


def beside(lattice: CellGrid, cell: int, dx: int, dy: int) -> int:
    """The cell at a distance of dx columns and dy rows; -1 if it is outside."""
    if 0 <= cell == lattice.inner and -1 <= dx <= 1 and -1 <= dy <= 1:
        return cell + dy * lattice.width + dx
    inside(lattice, cell)
    row = row_of(lattice, cell)
    x, y = cell - row * lattice.width + dx, row + dy
    if 0 <= x < lattice.width and 0 <= y < lattice.height:
        return y * lattice.width + x
    if not lattice.periodic:
        return -1
    # Remainders first, so that no distance is too large.
    x, y = cell - row * lattice.width + dx % lattice.width, row + dy % lattice.height
    return y % lattice.height * lattice.width + x % lattice.width


def next_cell(lattice: CellGrid, cell: int, draws: Draws) -> int:
    """A random one of the (up to) 8 cells around a cell."""
    while True:
        place = integers(draws, 0, 8)
        place += place >= 4  # Without the middle of the 3 x 3 cells.
        other = beside(lattice, cell, place % 3 - 1, place // 3 - 1)
        if other >= 0:
            return other


# Rows of `table.values` in a field.
X, Y = 1, 2
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


def take_out(table: Any, i: int) -> None:
    """Remove row i from the list of its cell."""
    # First, because it refuses an index that is no row: links beyond the rows have any value.
    cell = table.cell[i]
    if not table.links[ALIVE, i]:
        raise IndexError(REMOVED)
    if table.counts[VACANT] == UNLISTED:
        return
    before, after = table.links[PREVIOUS, i], table.links[NEXT, i]
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


def move_to(table: Any, i: int, cell: int) -> None:
    """Move row i to a cell."""
    if cell != table.cell[i]:
        take_out(table, i)
        place(table, i, cell)


def remove(table: Any, i: int) -> None:
    """Remove row i from the space; it takes part in no further rule."""
    take_out(table, i)
    table.links[ALIVE, i] = 0
    table.counts[GONE] += 1


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


def random_free(table: Any, draws: Draws) -> int:
    """A random cell without rows of this table; -1 if there is none."""
    if not table.counts[VACANT]:
        return -1
    return int(table.places[FREE, integers(draws, 0, table.counts[VACANT])])


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
    firsts, following, nearby = table.places[FIRST], table.links[NEXT], table.nearby
    for v in range(top, bottom):
        line = connected(v, lattice.height) * lattice.width
        for u in range(left, right):
            j = firsts[sure(line + connected(u, lattice.width))]
            while j >= 0:
                nearby[sure(count)] = j
                count, j = count + 1, following[sure(j)]
    table.counts[FOUND] = count
    return count


def span(middle: int, radius: int, size: int, periodic: bool) -> tuple[int, int]:
    """The first and the one after the last of the cells around one; each cell occurs once."""
    if not periodic:
        return max(middle - radius, 0), min(middle + radius + 1, size)
    width = min(2 * radius + 1, size)
    return middle - width // 2, middle - width // 2 + width


def connected(number: int, size: int) -> int:
    """A column or row less than one size beyond an edge, as the one on the other side."""
    # A remainder takes several times as long as these comparisons.
    if number < 0:
        return number + size
    return number - size if number >= size else number


NO_POSITION = "a position in a field must be a finite number"
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


class FieldRows(NamedTuple):
    """What machine code sees of a table in a field.

    The table `before` of a rule has its rows by cell, so that a search reads memory in its order:
    those of a cell are `sorted[starts[cell]:starts[cell + 1]]`, at `sorted_x` and `sorted_y`. In a
    table whose rows move these arrays are empty.
    """

    values: Columns
    links: Links
    places: Links
    counts: Ints
    births: Ints
    cell: Ints
    nearby: Ints
    dx: Numbers
    dy: Numbers
    starts: Ints
    sorted: Ints
    sorted_x: Numbers
    sorted_y: Numbers
    x: Numbers
    y: Numbers
    field: FieldGrid


def cell_of(field: FieldGrid, x: float, y: float) -> int:
    """The cell that contains a position; positions outside belong to the nearest cell."""
    column = part_of(x / field.width * field.across, field.across)
    return column * field.down + part_of(y / field.height * field.down, field.down)


def part_of(number: float, size: int) -> int:
    """The one of `size` parts that contains a number; the nearest one for others."""
    if not math.isfinite(number):
        raise ValueError(NO_POSITION)
    if not number > 0.0:
        return 0
    return int(number) if number < size else size - 1


def wrapped(number: float, size: float) -> float:
    """A coordinate within [0, size) of a periodic field."""
    # The usual case: a remainder takes many times as long as these comparisons.
    if 0.0 < number < size:
        return number
    inside = number % size
    return inside if inside < size else 0.0


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
        reaches_no_edge(x, radius, field.width, field.across)
        and reaches_no_edge(y, radius, field.height, field.down)
    )
    count = 0
    table.counts[FOUND] = table.values.shape[1]
    starts, order = table.starts, table.sorted
    sorted_x, sorted_y = table.sorted_x, table.sorted_y
    firsts, following = table.places[FIRST], table.links[NEXT]
    row_x, row_y = table.x, table.y
    nearby, apart_x, apart_y = table.nearby, table.dx, table.dy
    for _ in range(columns):
        if len(starts):
            # Two parts if the cells continue at the other edge.
            first, beyond = u * field.down, max(top + rows - field.down, 0)
            k, end = starts[sure(first + top)], starts[sure(first + top + rows - beyond)]
            while True:
                while k < end:
                    j, dx, dy = order[sure(k)], sorted_x[sure(k)] - x, sorted_y[sure(k)] - y
                    if wraps:
                        dx, dy = shortest(dx, field.width), shortest(dy, field.height)
                    # Without a branch: a processor cannot foresee which of the rows are near.
                    nearby[sure(count)] = j
                    apart_x[sure(count)], apart_y[sure(count)] = dx, dy
                    count += is_near(j, dx, dy, radius, other_than)
                    k += 1
                if not beyond:
                    break
                k, end, beyond = starts[sure(first)], starts[sure(first + beyond)], 0
        else:
            v = top
            for _ in range(rows):
                j = firsts[sure(u * field.down + v)]
                while j >= 0:
                    dx, dy = row_x[sure(j)] - x, row_y[sure(j)] - y
                    if wraps:
                        dx, dy = shortest(dx, field.width), shortest(dy, field.height)
                    nearby[sure(count)] = j
                    apart_x[sure(count)], apart_y[sure(count)] = dx, dy
                    count += is_near(j, dx, dy, radius, other_than)
                    j = following[sure(j)]
                v = v + 1 if v + 1 < field.down else 0
        u = u + 1 if u + 1 < field.across else 0
    table.counts[FOUND] = count
    return count


def is_near(j: int, dx: float, dy: float, radius: float, other_than: int) -> int:
    """1 if a row at these differences is near, else 0."""
    return int(j != other_than) & int(dx * dx + dy * dy <= radius * radius)


def reaches_no_edge(center: float, radius: float, size: float, cells: int) -> bool:
    """Whether an interval meets no cell at an edge, so that no way across edges is shorter.

    Cells at an edge also have the rows outside. A little more than a cell, because of rounding.
    """
    margin = radius + 1.001 * size / cells
    return margin < center and center < size - margin


def shortest(difference: float, size: float) -> float:
    """A difference of coordinates, across connected edges if this is shorter."""
    if difference > 0.5 * size:
        return difference - size
    if difference < -0.5 * size:
        return difference + size
    return difference


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


NO_NODE = "a node is not in the graph, as -1 of `random_neighbour` is; test it before"
NO_EDGE = "a node has no edge with this number; they are from 0 to `degree` - 1"


class Edges(NamedTuple):
    """What a rule sees of a matrix of edges; see `degree`, `neighbour`, `random_neighbour`, `edge`.

    The neighbours of node n are `ends[starts[n]:starts[n + 1]]`, in ascending order.
    """

    starts: NDArray[np.int64]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, pairs: ArrayLike, *, directed: bool = False) -> Reals:
        """The matrix of a graph, shape (2, edges): from a node, to a node, sorted; each edge once.

        Args:
            pairs: nodes from 0 on, shape (pairs, 2).
            directed: whether a pair is an edge from its first node to its second one only;
                otherwise the matrix has both directions.

        Raises:
            MisuseError: these are not pairs of nodes.

        """
        nodes = np.asarray(pairs)
        if nodes.size == 0:
            nodes = np.empty((0, 2), np.int64)
        if nodes.ndim != 2 or nodes.shape[1] != 2 or nodes.dtype.kind not in "iu":
            raise MisuseError(
                f"Edges.of expects pairs of nodes, ints of shape (pairs, 2), not {nodes.dtype}"
                f" of shape {nodes.shape}"
            )
        if nodes.size and nodes.min() < 0:
            raise MisuseError(f"Edges.of: nodes are numbers from 0, not {nodes.min()}")
        both = nodes if directed else np.concatenate((nodes, nodes[:, ::-1]))
        matrix = np.ascontiguousarray(np.unique(both, axis=0).T, np.float64)
        matrix.flags.writeable = False
        return matrix


def opened_edges(name: str, matrix: NDArray[Any], nodes: int) -> Edges:
    """The edges of a matrix, in a space with this number of nodes. Raises MisuseError."""
    if matrix.shape[0] != len(Edges._fields):
        raise MisuseError(
            f"{name} must be the matrix of a graph, with 2 rows, not {len(matrix)}; use Edges.of"
        )
    begins, ends = matrix.astype(np.int64)
    if begins.size and (matrix.min() < 0 or matrix.max() >= nodes):
        raise MisuseError(
            f"{name} has edges between nodes from {matrix.min():.0f} to {matrix.max():.0f}, but the"
            f" cells of the space are 0 to {nodes - 1}; set `width` to the number of nodes"
        )
    if np.any(begins[1:] < begins[:-1]):
        raise MisuseError(f"the edges of {name} must be sorted by their first node; use Edges.of")
    starts = np.zeros(nodes + 1, np.int64)
    np.cumsum(np.bincount(begins, minlength=nodes), out=starts[1:])
    return Edges(starts, ends)


def degree(edges: Edges, node: int) -> int:
    """The number of edges from a node."""
    if not 0 <= node < len(edges.starts) - 1:
        raise IndexError(NO_NODE)
    return edges.starts[node + 1] - edges.starts[node]


def edge(edges: Edges, node: int, k: int) -> int:
    """The column of the k-th edge from a node, at which other matrices have numbers for it."""
    if not 0 <= k < degree(edges, node):
        raise IndexError(NO_EDGE)
    return edges.starts[node] + k


def neighbour(edges: Edges, node: int, k: int) -> int:
    """The node at the other end of the k-th edge from a node."""
    return edges.ends[edge(edges, node, k)]


def random_neighbour(edges: Edges, node: int, draws: Draws) -> int:
    """The node at the other end of a random edge from a node; -1 if it has none."""
    count = degree(edges, node)
    if not count:
        return -1
    return neighbour(edges, node, integers(draws, 0, count))


SEARCHES: Final = (near, within, random_at, random_free)
CHANGES: Final = (go_to, move_to, remove, copy)
READING: Final = (near, within, beside, degree, edge, neighbour)
"""Functions that change nothing except the list of rows that a search has found."""
FUNCTIONS: Final = (
    *SEARCHES,
    *CHANGES,
    beside,
    next_cell,
    degree,
    edge,
    neighbour,
    random_neighbour,
)
"""Functions for rules."""


# --- tables: their lists at the start of a frame ---


def locate(table: FieldRows) -> None:
    """Find the cells of all rows of a field, which are those of their positions."""
    for i in range(table.counts[ROWS]):
        table.cell[i] = cell_of(table.field, table.x[i], table.y[i])


def enlist(cell: Ints, links: Links, places: Links, counts: Ints) -> None:
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


def settle(table: FieldRows) -> None:
    """Enter all rows into the lists of the cells of their positions."""
    for i in range(table.counts[ROWS]):
        if table.links[ALIVE, i]:
            move_to(table, i, cell_of(table.field, table.x[i], table.y[i]))


def sort_by_cell(
    table: FieldRows, starts: Ints, rows: Ints, sorted_x: Numbers, sorted_y: Numbers
) -> None:
    """Write the rows of all lists, with their positions, one cell after another."""
    count = 0
    for cell in range(table.places.shape[1]):
        starts[cell] = count
        i = table.places[FIRST, cell]
        while i >= 0:
            rows[count], sorted_x[count], sorted_y[count] = i, table.x[i], table.y[i]
            count, i = count + 1, table.links[NEXT, i]
    starts[table.places.shape[1]] = count
