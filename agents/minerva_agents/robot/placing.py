"""Places on a map that has none of its own: where a robot fits, starts, and is worth going to.

A robot is a disc. It fits on a cell if no cell that is occupied, unknown or off the map has its
centre within the disc, which is also how `planning.inflate` sees it.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from heapq import heappop, heappush
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Cell, MapError
from minerva_agents.robot.occupancy import Marker, OccupancyMap, Point, Pose

_FINEST_BLOCK_M = 0.1
_MOST_BLOCKS = 20_000
_DIAGONAL = math.sqrt(2.0)


def free_component(
    floor: OccupancyMap, radius_m: float, at: Point | None = None
) -> NDArray[np.bool_]:
    """Cells where a disc of this radius (metres) fits and between which it can move.

    Of several such regions it is the one that holds the point `at` (metres of the world), without
    a point the largest, the first of equals. Bool, in the shape of the map's cells. Raises
    MapError where the disc fits nowhere, or not at the point.
    """
    labels = _labels(floor, radius_m)
    if at is not None:
        return labels == _label_at(floor, labels, radius_m, at)
    sizes = np.bincount(labels.ravel())
    if sizes.size == 1:
        raise MapError(
            f"a disc of radius {radius_m} m fits nowhere on the map of "
            f"{labels.shape[0]} x {labels.shape[1]} cells of {floor.resolution} m; "
            "take a smaller radius, or check the map's thresholds"
        )
    return labels == 1 + int(np.argmax(sizes[1:]))


def roomiest(floor: OccupancyMap, radius_m: float, at: Point | None = None) -> Pose:
    """The place with the most clearance in that component, as (x, y, 0 degrees).

    The first such cell of equals. Raises what `free_component` raises.
    """
    component = free_component(floor, radius_m, at)
    best = np.argmax(np.where(component, floor.room, -1.0))
    row, column = np.unravel_index(best, component.shape)
    return (*_place(floor, (int(row), int(column))), 0.0)


def spread(
    floor: OccupancyMap, count: int, radius_m: float, start: Pose, least: int | None = None
) -> tuple[Marker, ...]:
    """So many places, "A", "B", "C" and on, far from the start and from each other.

    Farthest-point sampling [Gonzalez 1985]: each is the one that is farthest, by path, from the
    start and from those before it. Paths are measured over blocks of cells, of 0.1 m or what keeps
    them few. Where there are places with twice the radius of clearance only those are taken, so
    that a robot has room to turn. Raises MapError if it does not fit at the start, and if there is
    room for fewer than `least` (default: for fewer than `count`).
    """
    component = free_component(floor, radius_m, start[:2])
    room = np.where(component, floor.room, 0.0)
    row, column = floor.cell_at(start[0], start[1])
    cells = list(islice(_far_cells(floor, room, radius_m, (row, column)), count))
    if len(cells) < (count if least is None else least):
        raise MapError(
            f"there is room for {len(cells)} places a robot's width apart, of the {count} "
            f"asked for; ask for fewer, or take a radius smaller than {radius_m} m"
        )
    return tuple([Marker(_name(index), *_place(floor, cell)) for index, cell in enumerate(cells)])


def _far_cells(
    floor: OccupancyMap, room: NDArray[np.float64], radius_m: float, start: Cell
) -> Iterator[Cell]:
    """Cells, each the farthest by path from those before, until they are a robot's width apart."""
    side = _block_side(floor, room)
    blocks = _blocks(room, side).max(axis=(1, 3))
    roomy = blocks > 2 * _in_cells(floor, radius_m)
    candidates = roomy if roomy.any() else blocks > 0
    distances = np.where(blocks > 0, np.inf, -1.0)
    source = (start[0] // side, start[1] // side)
    while True:
        lower(distances, source)
        far = np.where(candidates, distances, -1.0)
        source = divmod(int(np.argmax(far)), far.shape[1])
        if far[source] * side <= 2 * _in_cells(floor, radius_m):
            return
        yield _roomiest_cell(room, source, side)


@lru_cache(maxsize=1)
def _labels(floor: OccupancyMap, radius_m: float) -> NDArray[np.intp]:
    """The regions in which a disc of this radius can move; kept, for several places need them."""
    labels = regions(floor.room > _in_cells(floor, radius_m))
    labels.setflags(write=False)
    return labels


def _in_cells(floor: OccupancyMap, radius_m: float) -> float:
    if not (math.isfinite(radius_m) and radius_m > 0):
        raise MapError(f"the radius is {radius_m}; expected metres, more than 0")
    return radius_m / floor.resolution


def _place(floor: OccupancyMap, cell: Cell) -> Point:
    """The cell's centre to a tenth of a millimetre, so that no place reads 2.1250000000000004."""
    x, y = floor.centre_of(cell)
    return round(x, 4), round(y, 4)


def _label_at(floor: OccupancyMap, labels: NDArray[np.intp], radius_m: float, at: Point) -> int:
    label = int(labels[floor.cell_at(*at)]) if floor.holds(*at) else 0
    if not label:
        raise MapError(
            f"a disc of radius {radius_m} m does not fit at ({at[0]}, {at[1]}) m; "
            "expected a place on the map, free and so far from walls; choose another, or a "
            "smaller radius"
        )
    return label


def regions(free: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Connected regions of free cells, numbered from 1; 0 where not free.

    Neighbours are those of a side: a diagonal that cuts no corner joins no others. Runs along the
    rows are joined where they touch, which is far fewer steps than cell by cell.
    """
    begins = free & ~np.pad(free, ((0, 0), (1, 0)))[:, :-1]
    runs = np.where(free, np.cumsum(begins).reshape(free.shape), 0)
    touching = free[:-1] & free[1:]
    most = int(runs.max(initial=0)) + 1
    pairs = np.sort(runs[:-1][touching] * most + runs[1:][touching])
    roots = list(range(most))
    for one, other in (divmod(pair, most) for pair in pairs[_firsts(pairs)].tolist()):
        first, second = sorted((_root(roots, one), _root(roots, other)))
        roots[second] = first
    merged = np.array([_root(roots, run) for run in range(most)])
    numbers = np.cumsum(np.bincount(merged, minlength=most) > 0) - 1
    return numbers[merged][runs]


def _firsts(ordered: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which items of an ordered array differ from those before them."""
    return np.concatenate((np.ones(min(1, ordered.size), np.bool_), ordered[1:] != ordered[:-1]))


def _root(roots: list[int], run: int) -> int:
    while roots[run] != run:
        roots[run] = roots[roots[run]]
        run = roots[run]
    return run


def _block_side(floor: OccupancyMap, room: NDArray[np.float64]) -> int:
    """How many cells make the side of a block."""
    side = max(1, round(_FINEST_BLOCK_M / floor.resolution))
    return max(side, math.ceil(math.sqrt(np.count_nonzero(room) / _MOST_BLOCKS)))


def _blocks(room: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """The grid cut into blocks, (block rows, side, block columns, side), padded with 0."""
    rows, columns = room.shape
    padded = np.pad(room, ((0, -rows % side), (0, -columns % side)))
    return padded.reshape(padded.shape[0] // side, side, padded.shape[1] // side, side)


def _roomiest_cell(room: NDArray[np.float64], block: Cell, side: int) -> Cell:
    inside = _blocks(room, side)[block[0], :, block[1], :]
    row, column = divmod(int(np.argmax(inside)), side)
    return block[0] * side + row, block[1] * side + column


def lower(distances: NDArray[np.float64], source: Cell) -> None:
    """Lower the distances (in blocks, -1 where blocked) to those from one more source.

    Dijkstra's search (1959), which does not go on from where another source is nearer.
    """
    width = distances.shape[1] + 2
    flat: list[float] = np.pad(distances, 1, constant_values=-1.0).ravel().tolist()
    first = (source[0] + 1) * width + source[1] + 1
    flat[first] = 0.0
    queue = [(0.0, first)]
    while queue:
        distance, cell = heappop(queue)
        if distance > flat[cell]:
            continue
        for step, length in _moves(flat, cell, width):
            if distance + length < flat[cell + step]:
                flat[cell + step] = distance + length
                heappush(queue, (distance + length, cell + step))
    distances[:] = np.array(flat).reshape(-1, width)[1:-1, 1:-1]


def _moves(flat: list[float], cell: int, width: int) -> list[tuple[int, float]]:
    down, up = flat[cell + width] >= 0, flat[cell - width] >= 0
    right, left = flat[cell + 1] >= 0, flat[cell - 1] >= 0
    moves = [(width, 1.0), (-width, 1.0), (1, 1.0), (-1, 1.0)]
    if down and right:
        moves.append((width + 1, _DIAGONAL))
    if down and left:
        moves.append((width - 1, _DIAGONAL))
    if up and right:
        moves.append((1 - width, _DIAGONAL))
    if up and left:
        moves.append((-1 - width, _DIAGONAL))
    return moves


def _name(index: int) -> str:
    """A, B, ..., Z, AA, AB, ..., as a spreadsheet names its columns."""
    before, letter = divmod(index, 26)
    return (_name(before - 1) if before else "") + chr(ord("A") + letter)
