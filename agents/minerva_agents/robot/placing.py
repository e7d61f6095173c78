"""Positions on a map without its own: where a robot fits, where it starts, where markers go.

A robot is a disc. It fits on a cell if no occupied, unknown or outside cell has its centre within
the disc, consistent with `distances.inflate`.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from heapq import heappop, heappush
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import MapError
from minerva_agents.robot.motion import Cell
from minerva_agents.robot.occupancy import MapPose, Marker, OccupancyMap, Point

_MIN_BLOCK_M = 0.1
_MAX_BLOCKS = 20_000
_DIAGONAL = math.sqrt(2.0)


def free_component(
    floor: OccupancyMap, radius_m: float, at: Point | None = None
) -> NDArray[np.bool_]:
    """Cells where a disc of this radius (m) fits and between which it can move.

    Of several such regions, the one that contains the point `at` (m, world frame), or without `at`
    the largest, the first among equals. Bool, in the shape of the map's cells. Raises MapError if
    the disc fits nowhere, or not at the point.
    """
    labels = _labels(floor, radius_m)
    if at is not None:
        return labels == _label_at(floor, labels, radius_m, at)
    sizes = np.bincount(labels.ravel())
    if sizes.size == 1:
        raise MapError(
            f"a disc of radius {radius_m} m fits nowhere on the map of "
            f"{labels.shape[0]} x {labels.shape[1]} cells of {floor.resolution} m; "
            "use a smaller radius, or check the map's thresholds"
        )
    return labels == 1 + int(np.argmax(sizes[1:]))


def roomiest(floor: OccupancyMap, radius_m: float, at: Point | None = None) -> MapPose:
    """The position with the most clearance in that region, as (x, y, 0 degrees).

    The first cell among equals. Raises MapError like `free_component`.
    """
    component = free_component(floor, radius_m, at)
    best = np.argmax(np.where(component, floor.room, -1.0))
    row, column = np.unravel_index(best, component.shape)
    return (*_place(floor, (int(row), int(column))), 0.0)


def spread(
    floor: OccupancyMap, count: int, radius_m: float, start: MapPose, least: int | None = None
) -> tuple[Marker, ...]:
    """Up to `count` positions, "A", "B", "C" and on, far from the start and from each other.

    Farthest-point sampling [Gonzalez 1985]: each position is the farthest, by path, from the start
    and all previous ones. Paths are measured over blocks of cells, 0.1 m or larger to bound their
    number. Where positions with twice the radius of clearance exist, only those are used, so that a
    robot can turn. Raises MapError if the robot does not fit at the start, or if fewer than `least`
    (default: `count`) positions exist.
    """
    component = free_component(floor, radius_m, start[:2])
    room = np.where(component, floor.room, 0.0)
    row, column = floor.cell_at(start[0], start[1])
    cells = list(islice(_far_cells(floor, room, radius_m, (row, column)), count))
    if len(cells) < (count if least is None else least):
        raise MapError(
            f"there is room for {len(cells)} places a robot's width apart, of {count} "
            f"requested; use fewer, or a radius smaller than {radius_m} m"
        )
    return tuple([Marker(_name(index), *_place(floor, cell)) for index, cell in enumerate(cells)])


def _far_cells(
    floor: OccupancyMap, room: NDArray[np.float64], radius_m: float, start: Cell
) -> Iterator[Cell]:
    """Cells, each the farthest by path from all previous ones, at least a robot's width apart."""
    side = _block_side(floor, room)
    blocks = _blocks(room, side).max(axis=(1, 3))
    roomy = blocks > 2 * _in_cells(floor, radius_m)
    candidates = roomy if roomy.any() else blocks > 0
    # Paths may lead through narrow blocks in which no position may lie.
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
    """Regions in which a disc of this radius can move; cached, as several functions use them."""
    labels = regions(floor.room > _in_cells(floor, radius_m))
    labels.setflags(write=False)
    return labels


def _in_cells(floor: OccupancyMap, radius_m: float) -> float:
    if not (math.isfinite(radius_m) and radius_m > 0):
        raise MapError(f"the radius is {radius_m}; expected metres > 0")
    return radius_m / floor.resolution


def _place(floor: OccupancyMap, cell: Cell) -> Point:
    """The cell's centre, rounded to 0.1 mm so that coordinates print without rounding noise."""
    x, y = floor.centre_of(cell)
    return round(x, 4), round(y, 4)


def _label_at(floor: OccupancyMap, labels: NDArray[np.intp], radius_m: float, at: Point) -> int:
    label = int(labels[floor.cell_at(*at)]) if floor.holds(*at) else 0
    if not label:
        raise MapError(
            f"a disc of radius {radius_m} m does not fit at ({at[0]}, {at[1]}) m; "
            "expected a position on the map, free and that far from walls. Use another one, or a "
            "smaller radius"
        )
    return label


def regions(free: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Connected regions of free cells, numbered from 1; 0 where not free.

    Cells connect by their sides; a diagonal without a cut corner connects no further cells. Runs
    along the rows are merged where they touch, which takes far fewer steps than cell by cell.
    """
    # Number the runs of free cells along the rows.
    begins = free & ~np.pad(free, ((0, 0), (1, 0)))[:, :-1]
    runs = np.where(free, np.cumsum(begins).reshape(free.shape), 0)
    touching = free[:-1] & free[1:]
    most = int(runs.max(initial=0)) + 1
    # Pairs of touching runs, each as one integer, so that sorting brings repeats together.
    pairs = np.sort(runs[:-1][touching] * most + runs[1:][touching])
    roots = list(range(most))
    for run, neighbour in (divmod(pair, most) for pair in pairs[_firsts(pairs)].tolist()):
        # Merge by union-find. The lower number becomes the root, so regions are numbered in the
        # order of their first cells.
        first, second = sorted((_root(roots, run), _root(roots, neighbour)))
        roots[second] = first
    merged = np.array([_root(roots, run) for run in range(most)])
    # Renumber the remaining roots without gaps; 0 stays for blocked cells.
    numbers = np.cumsum(np.bincount(merged, minlength=most) > 0) - 1
    return numbers[merged][runs]


def _firsts(ordered: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mask of items of a sorted array that differ from their predecessors."""
    return np.concatenate((np.ones(min(1, ordered.size), np.bool_), ordered[1:] != ordered[:-1]))


def _root(roots: list[int], run: int) -> int:
    while roots[run] != run:
        # Path halving keeps the trees flat.
        roots[run] = roots[roots[run]]
        run = roots[run]
    return run


def _block_side(floor: OccupancyMap, room: NDArray[np.float64]) -> int:
    """Side of a block in cells."""
    side = max(1, round(_MIN_BLOCK_M / floor.resolution))
    return max(side, math.ceil(math.sqrt(np.count_nonzero(room) / _MAX_BLOCKS)))


def _blocks(room: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """The grid as blocks, (block rows, side, block columns, side), padded with 0."""
    rows, columns = room.shape
    padded = np.pad(room, ((0, -rows % side), (0, -columns % side)))
    return padded.reshape(padded.shape[0] // side, side, padded.shape[1] // side, side)


def _roomiest_cell(room: NDArray[np.float64], block: Cell, side: int) -> Cell:
    inside = _blocks(room, side)[block[0], :, block[1], :]
    row, column = divmod(int(np.argmax(inside)), side)
    return block[0] * side + row, block[1] * side + column


def lower(distances: NDArray[np.float64], source: Cell) -> None:
    """Lower distances (in blocks, -1 where blocked) in place by paths from another source.

    Dijkstra's algorithm (1959), pruned where another source is closer.
    """
    width = distances.shape[1] + 2
    # A list, because reading single items of an array is slow.
    flat: list[float] = np.pad(distances, 1, constant_values=-1.0).ravel().tolist()
    first = (source[0] + 1) * width + source[1] + 1
    flat[first] = 0.0
    queue = [(0.0, first)]
    while queue:
        distance, cell = heappop(queue)
        # A shorter path to this cell was found after the entry had been queued.
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
    """A, B, ..., Z, AA, AB, ..., like spreadsheet columns."""
    before, letter = divmod(index, 26)
    return (_name(before - 1) if before else "") + chr(ord("A") + letter)
