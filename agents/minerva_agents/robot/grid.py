"""A robot's evidence grid: cell codes, how laser and camera update them, and masks of cells.

| code | meaning                                                                  |
  |------|--------------------------------------------------------------------------|
  | 0    | unknown, as all cells are initially (the paper's empty cell)             |
  | 1    | free                                                                     |
  | 2-9  | obstacle; the number is the evidence for it                              |
  | 10   | free, and inspected by the camera                                        |
  | 11   | closed: a norm rejected a step there, and no beam reopens it             |
  | 16+k | holds marker k, an index into the robot's `markers`                      |

Positions and cells outside the grid are ignored.

A laser covers a whole room from its door; a camera sees only what lies ahead. So a robot that
searches for a marker records which free cells its camera has seen.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.pose import Cell, GridPose, Reals
from minerva_bus import Cells, MinervaError, portable
from minerva_bus.values import fast_dataclass

Mask: TypeAlias = NDArray[np.bool_]


class MapError(MinervaError, ValueError):
    """A map is invalid, or a request cannot be satisfied on it."""


def check_grid(grid: Mask, who: str, name: str) -> None:
    """Raise MapError, naming the caller `who`, unless `grid` is a 2-D array of bool."""
    if grid.ndim != 2 or grid.dtype != np.bool_:
        kind = f"{grid.ndim}-D of {grid.dtype}"
        raise MapError(f"{who}: {name} is {kind}, expected a 2-D array of bool [row, column]")


UNKNOWN: Final = 0
FREE: Final = 1
OBSTACLE: Final = 2
SURE: Final = 9
SEEN: Final = 10
CLOSED: Final = 11
MARKER: Final = 16

Codes: TypeAlias = NDArray[np.int16]

_BORDER: Final = 1e-4
"""Cells to a border within which a position is on it: more than a distance of 32 bits is wrong by,
and far less than a laser is."""

_HIT: Final = 3
"""Evidence added by a hit; a passing beam removes 1."""


def after_passing(code: int, near: bool = True) -> int:
    """The code of a cell after a beam has passed; only near obstacles lose evidence."""
    return max(code - 1 if near and code <= SURE else code, FREE)


def after_hit(code: int) -> int:
    """The code of a cell after a hit; markers and closed cells stay."""
    if code >= MARKER or code == CLOSED:
        return code
    # All other codes stand for no evidence.
    return min(SURE, (code if FREE < code <= SURE else FREE) + _HIT)


def clearing_part(frame: int) -> float:
    """Fraction of each beam that counts as evidence against obstacles in this frame.

    A beam that grazes the wall it ends at passes many cells that contain a bit of that wall, all in
    its far half. So the far half counts in one of eight frames only, which suffices to forget
    obstacles that moved away.
    """
    return 1.0 if frame % 8 == 0 else 0.5


def doubt(grid: Cells) -> None:
    """Reduce the evidence for all obstacles; visible ones recover within a few frames."""
    grid[:] = np.where(grid <= SURE, np.where(grid > FREE, grid - 1, grid), grid)


LONGEST: Final = 100_000
"""Samples of a beam that need no allocation."""

_STEPS: Final = np.arange(LONGEST, dtype=np.float64)
_NONE: Final = np.empty(0, np.intp)


def behind(far: float) -> float:
    """What to add to a coordinate of a beam that goes `far` cells along its axis.

    A beam that is on a border of cells, within `_BORDER`, is in the cell behind it. The walls of a
    map lie on borders; there the last bit of a distance would choose the cell, and half of the hits
    would thicken the wall by the cell before it. Along a border, the upper cell counts.
    """
    return -_BORDER if far < -_BORDER else _BORDER


def all_behind(far: Reals) -> Reals:
    """`behind` of n beams, (n,)."""
    return np.where(far < -_BORDER, -_BORDER, _BORDER)


def holds(grid: Cells, cell: Cell) -> bool:
    """True if the cell lies on the grid."""
    return 0 <= cell[0] < grid.shape[0] and 0 <= cell[1] < grid.shape[1]


def mark_obstacle(grid: Cells, row: float, column: float) -> None:
    """Add evidence for an obstacle at a position; markers are not overwritten."""
    cell = math.floor(row), math.floor(column)
    if not holds(grid, cell):
        return
    grid[cell] = after_hit(int(grid[cell]))


def close(grid: Cells, row: float, column: float) -> None:
    """Close a position regardless of later scans; markers are not overwritten."""
    cell = math.floor(row), math.floor(column)
    if holds(grid, cell) and grid[cell] < MARKER:
        grid[cell] = CLOSED


def reopen(grid: Cells) -> None:
    """Reopen all closed cells: a norm need not reject a step forever."""
    grid[grid == CLOSED] = FREE


def mark_marker(grid: Cells, row: float, column: float, marker: int) -> None:
    """Set the cell of a marker; its previous cell becomes free.

    A marker on a border of cells has the upper one, so that rounding does not move it.
    """
    cell = math.floor(row + _BORDER), math.floor(column + _BORDER)
    if holds(grid, cell):
        grid[grid == MARKER + marker] = FREE
        grid[cell] = MARKER + marker


def clear_open_beam(
    grid: Cells, row: float, column: float, to_row: float, to_column: float, part: float = 1.0
) -> None:
    """Mark the cells along a beam without a hit as free, up to the first known obstacle.

    A beam may fail to return from a wall. So only the first obstacle loses evidence, and only on
    the first `part` of the beam; cells behind it stay unchanged.
    """
    cells, count = _passed(grid, row, column, to_row, to_column)
    flat: Codes = grid.reshape(-1)
    codes: Codes = flat.take(cells)
    walls = np.flatnonzero(obstacles(codes))
    if walls.size:
        end = int(walls[0])
        cells, codes = cells[: end + 1], codes[: end + 1]
        if end < part * count:
            codes[end] = after_passing(int(codes[end]))
    np.maximum(codes, FREE, out=codes)
    flat[cells] = codes


def _passed(
    grid: Cells, row: float, column: float, to_row: float, to_column: float
) -> tuple[NDArray[np.intp], int]:
    """Flat indices of the cells that a beam passes, and their count including those off the grid.

    Consecutive samples are at most one row and one column apart, so no cell is skipped; the cell in
    which the beam ends is excluded.
    """
    down, across = to_row - row, to_column - column
    count = math.ceil(max(abs(down), abs(across)) - _BORDER)
    if count <= 0:
        return _NONE, 0
    row, to_row = row + behind(down), to_row + behind(down)
    column, to_column = column + behind(across), to_column + behind(across)
    down, across = down / count, across / count
    last = math.floor((count - 1) * down + row), math.floor((count - 1) * across + column)
    if last == (math.floor(to_row), math.floor(to_column)):
        count -= 1
    high, wide = grid.shape
    # Steps of a beam that ends off the grid are a little shorter than a cell, hence two more.
    enough = max(high, wide) + 2
    steps = _STEPS[:count] if enough <= _STEPS.size else np.arange(min(count, enough), dtype=float)
    rows = (steps * down + row).astype(np.intp)
    columns = (steps * across + column).astype(np.intp)
    # A beam with both ends on the grid stays on it. Otherwise positions are tested before the
    # conversion, which rounds small negative numbers to 0.
    if not (0 <= row < high > to_row >= 0 <= column < wide > to_column >= 0):
        inside = (steps * down + row >= 0) & (steps * across + column >= 0)
        inside &= (rows < high) & (columns < wide)
        rows, columns = rows[inside], columns[inside]
    rows *= wide
    rows += columns
    return rows, count


def place_of(grid: Cells, marker: int) -> Cell | None:
    """The cell of a marker, or None if it has not been seen."""
    index = int(np.argmax(grid == MARKER + marker))
    row, column = divmod(index, grid.shape[1])
    return (row, column) if grid[row, column] == MARKER + marker else None


def obstacles(grid: Cells) -> Mask:
    """Mask of obstacle and closed cells."""
    matches = (grid - OBSTACLE).view(np.uint16) <= SURE - OBSTACLE  # one comparison for two
    return matches | (grid == CLOSED)


def free(grid: Cells) -> Mask:
    """Mask of cells known to be free; markers are not obstacles."""
    return ((grid == FREE) | (grid >= SEEN)) & (grid != CLOSED)


# --- a scan of the laser --------------------------------------------------------------------------


_AT_ONCE: Final = 1 << 20
"""Samples of beams in one pass, which bounds memory."""

# Most of these cells are the ends of beams: a call for each would take a tenth of a scan's time.
_AFTER_HIT: Final = tuple(map(after_hit, range(MARKER)))

Places = NDArray[np.intp]


@fast_dataclass
class _Passes:
    """Cells that beams pass, in order: flat indices, the beam, and whether it is near enough."""

    cells: Places
    beams: Places
    near: Mask


def mark_scan(
    grid: Cells, row: float, column: float, rows: Reals, columns: Reals, part: float = 1.0
) -> None:
    """Mark what beams with a hit at their ends show, all beams in one pass of array operations.

    The result is that of one beam after another: a beam marks the cells that it passes as free,
    then the cell at its end as an obstacle. Only the order of passes and hits of the same cell
    matters, and few cells have both, so these alone are processed in order.

    Unknown cells become free along each beam; obstacles lose evidence on its first `part` only. The
    cells at the ends gain evidence; markers and closed cells stay.

    Args:
        grid: the evidence grid, which is changed.
        row: of the laser, in cells.
        column: likewise.
        rows: of the ends of n beams in their order, (n,), in cells.
        columns: likewise.
        part: fraction of a beam on which it counts against obstacles.

    Raises:
        MapError: the end of a beam is not finite.

    """
    longest = np.maximum(np.abs(rows - row), np.abs(columns - column))
    if not np.isfinite(longest).all():
        raise MapError("a beam ends at infinity; give its distance in metres")
    counts = np.ceil(np.maximum(longest - _BORDER, 0.0))
    passes = np.cumsum(np.minimum(counts, _most_samples(grid))) // _AT_ONCE
    borders = [0, *(1 + np.flatnonzero(passes[1:] != passes[:-1])).tolist(), len(rows)]
    for begin, end in pairwise(borders):
        ends = rows[begin:end], columns[begin:end]
        _mark(grid, (row, column), ends, counts[begin:end], part)


def _mark(
    grid: Cells, start: tuple[float, float], ends: tuple[Reals, Reals], counts: Reals, part: float
) -> None:
    flat: Codes = grid.reshape(-1)
    passes = _passes(grid, start, ends, counts, part)
    high, wide = grid.shape
    rows, columns = (np.floor(to + all_behind(to - at)) for at, to in zip(start, ends, strict=True))
    hitting = np.flatnonzero((rows >= 0) & (rows < high) & (columns >= 0) & (columns < wide))
    hits = rows[hitting].astype(np.intp) * wide + columns[hitting].astype(np.intp)
    is_hit = np.zeros(flat.size, np.bool_)
    is_hit[hits] = True
    both = is_hit[passes.cells]
    _clear(flat, passes.cells[~both], passes.near[~both])
    # A hit follows the passes of its own beam.
    cells = np.concatenate((passes.cells[both], hits))
    kinds = np.concatenate((passes.near[both].astype(np.intp), np.full(len(hits), 2)))
    order = np.argsort(np.concatenate((2 * passes.beams[both], 2 * hitting + 1)), kind="stable")
    codes = dict(zip(hits.tolist(), flat[hits].tolist(), strict=True))
    for cell, kind in zip(cells[order].tolist(), kinds[order].tolist(), strict=True):
        code = codes[cell]
        if kind < 2:
            codes[cell] = after_passing(code, kind == 1)
        elif code < MARKER:
            codes[cell] = _AFTER_HIT[code]
    flat[list(codes)] = list(codes.values())


def _clear(flat: Codes, cells: Places, near: Mask) -> None:
    """Mark cells as free; each near pass of an obstacle removes 1 of its evidence."""
    codes = flat[cells]
    flat[cells] = np.maximum(codes, FREE)
    doubted = cells[near & (codes > FREE) & (codes <= SURE)]
    obstacles, times = np.unique(doubted, return_counts=True)
    flat[obstacles] = np.maximum(flat[obstacles] - times, FREE)


def _passes(
    grid: Cells, start: tuple[float, float], ends: tuple[Reals, Reals], counts: Reals, part: float
) -> _Passes:
    """The cells that beams pass before their ends, each once per beam.

    Consecutive samples are at most one row and one column apart, so no cell is skipped.
    """
    (row, column), (high, wide) = start, grid.shape
    steps = np.maximum(counts, 1.0)
    far_down, far_across = ends[0] - row, ends[1] - column
    first_row, first_column = row + all_behind(far_down), column + all_behind(far_across)
    down, across = far_down / steps, far_across / steps
    back = np.maximum(counts - 1, 0)
    ended = np.floor(back * down + first_row) == np.floor(far_down + first_row)
    ended &= np.floor(back * across + first_column) == np.floor(far_across + first_column)
    counts = np.where(ended & (counts > 0), counts - 1, counts)
    lengths = np.minimum(counts, _most_samples(grid)).astype(np.intp)
    beams = np.repeat(np.arange(len(counts)), lengths)
    number = np.arange(len(beams)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    rows = number * down[beams] + first_row[beams]
    columns = number * across[beams] + first_column[beams]
    inside = (rows >= 0) & (columns >= 0) & (rows < high) & (columns < wide)
    if not inside.all():
        beams, rows, columns = beams[inside], rows[inside], columns[inside]
        lengths = np.bincount(beams, minlength=len(counts))
        number = np.arange(len(beams)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    cells = rows.astype(np.intp) * wide + columns.astype(np.intp)
    near = number < np.ceil(part * counts)[beams]
    # Two samples may be in one cell: the last one counts.
    last = np.ones(len(cells), np.bool_)
    last[:-1] = (cells[1:] != cells[:-1]) | (beams[1:] != beams[:-1])
    return _Passes(cells[last], beams[last], near[last])


def _most_samples(grid: Cells) -> int:
    """Samples of a beam after which it has left the grid."""
    # Steps of a beam that ends off the grid are a little shorter than a cell, hence two more.
    return max(LONGEST, max(grid.shape) + 2)


# --- the view of the camera -----------------------------------------------------------------------


def look(grid: Cells, pose: GridPose, fov: float, reach: float) -> None:
    """Mark visible free cells as seen: `fov` degrees wide, `reach` cells far, up to a wall."""
    # Neighbouring rays are at most one cell apart at full range.
    rays = 2 + int(math.radians(fov) * reach)
    headings = np.radians(pose.angle + fov * (np.arange(rays) / (rays - 1) - 0.5))
    down, across = portable.cos_sin(headings)
    steps = np.arange(int(reach) + 1, dtype=np.float64)
    rows, columns = _along(pose.row, steps, down), _along(pose.column, steps, across)
    inside = (rows >= 0) & (rows < grid.shape[0]) & (columns >= 0) & (columns < grid.shape[1])
    # Positions off the grid read cell 0, but they end their ray, so its code has no effect.
    flat = np.where(inside, rows * grid.shape[1] + columns, 0)
    cells = grid.reshape(-1)
    codes = cells[flat]
    ends = (codes != FREE) & (codes < SEEN) | ~inside
    # Cells that the edge of the view only cuts count as seen. To count only those completely in
    # view makes a search depend on single cells and take more than twice as many frames.
    open_cells = flat[~np.logical_or.accumulate(ends, axis=1) & (codes == FREE)]
    cells[open_cells] = SEEN


def forget_looks(grid: Cells) -> None:
    """Reset inspected cells to free."""
    grid[grid == SEEN] = FREE


# --- masks and sums -------------------------------------------------------------------------------


def expanses(mask: Mask) -> Mask:
    """The mask without regions less than three cells wide."""
    return grown(_all_around(mask))


def grown_to_sides(mask: Mask) -> Mask:
    """The mask dilated by its four-neighbourhood."""
    result = mask.copy()
    result[1:] |= mask[:-1]
    result[:-1] |= mask[1:]
    result[:, 1:] |= mask[:, :-1]
    result[:, :-1] |= mask[:, 1:]
    return result


def _along(
    origin: float, steps: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.intp]:
    return np.floor(np.outer(slopes, steps) + origin).astype(np.intp)


def _all_around(mask: Mask) -> Mask:
    """Cells whose eight neighbours are all True; never at the border."""
    down = mask[:-2] & mask[1:-1] & mask[2:]
    result = np.zeros(mask.shape, np.bool_)
    result[1:-1, 1:-1] = down[:, :-2] & down[:, 1:-1] & down[:, 2:]
    return result


def grown(mask: Mask) -> Mask:
    """The mask dilated by its eight-neighbourhood."""
    down = mask.copy()
    down[1:] |= mask[:-1]
    down[:-1] |= mask[1:]
    result = down.copy()
    result[:, 1:] |= down[:, :-1]
    result[:, :-1] |= down[:, 1:]
    return result


def block_sums(mask: Mask, side: int) -> NDArray[np.int64]:
    """Number of True cells in each block of `side` x `side` cells; cut off at the far edges."""
    rows, columns = mask.shape
    # `np.pad` and `np.insert` take longer than the sums of grids of this size.
    padded = np.zeros((rows + -rows % side, columns + -columns % side), np.bool_)
    padded[:rows, :columns] = mask
    high, wide = padded.shape[0] // side, padded.shape[1] // side
    # One axis after the other: both at once take three times as long.
    strips = padded.reshape(high, side, -1).sum(axis=1)
    return strips.reshape(high, wide, side).sum(axis=2)


def box_sums(numbers: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
    """Per item, the sum of all items at most `reach` rows and columns away."""
    (rows, columns), width = numbers.shape, 2 * reach + 1
    # Cumulative sums begin with 0, so there is one more item before than after.
    sums = np.zeros((rows + width, columns + width), numbers.dtype)
    sums[reach + 1 : reach + 1 + rows, reach + 1 : reach + 1 + columns] = numbers
    down = sums.cumsum(axis=0)
    across = (down[width:] - down[:rows]).cumsum(axis=1)
    return across[:, width:] - across[:, :columns]


# --- distances to obstacles -----------------------------------------------------------------------


_Whole: TypeAlias = NDArray[np.int32 | np.int64]

_LINES_AT_ONCE = 2048
"""Grid rows transformed together: enough to use numpy well, few enough to bound memory."""


def inflate(obstacles: Mask, radius_cells: float) -> Mask:
    """Obstacles dilated by a disc: all cells with an obstacle's centre within the radius.

    `obstacles` is a bool grid; the radius is in cells and may be fractional. Run time grows with
    the radius and the bounding box of the obstacles. Raises MapError for an invalid grid or a
    radius that is negative or not finite.
    """
    check_grid(obstacles, "inflate", "obstacles")
    if not (math.isfinite(radius_cells) and radius_cells >= 0):
        raise MapError(f"inflate: radius_cells is {radius_cells}, expected a finite number >= 0")
    grown = np.zeros(obstacles.shape, np.bool_)
    window = _around_all(obstacles, math.floor(radius_cells))
    if window is not None:
        grown[window] = _inflate(obstacles[window], radius_cells)
    return grown


def clearance(obstacles: Mask) -> NDArray[np.float64]:
    """Euclidean distance in cells from each cell's centre to the nearest obstacle's centre.

    Exact; 0 on obstacles, infinite if the grid has none. Cells outside the grid are not obstacles.

    First comes the distance to the nearest obstacle in each column. Each row is then the lower
    envelope of parabolas, one per cell: the squared distance to an obstacle is the minimum of
    (columns across)² + (distance in that column)². The envelopes of all rows are built in parallel,
    column by column, so run time depends on the area only [Felzenszwalb, Huttenlocher 2012,
    "Distance Transforms of Sampled Functions"; Meijster, Roerdink, Hesselink 2000, with integers].

    Raises MapError unless `obstacles` is a 2-D bool grid.
    """
    check_grid(obstacles, "clearance", "obstacles")
    if not obstacles.any():
        return np.full(obstacles.shape, np.inf)
    down = _distances_down(obstacles)
    distances = np.empty(obstacles.shape)
    for first in range(0, obstacles.shape[0], _LINES_AT_ONCE):
        lines = np.s_[first : first + _LINES_AT_ONCE]
        # Transposed, so that each step of the transform processes contiguous numbers.
        distances[lines] = np.sqrt(_lower_envelope(np.ascontiguousarray(down[lines].T))).T
    return distances


def _around_all(obstacles: Mask, margin: int) -> tuple[slice, slice] | None:
    """Rows and columns of the obstacles' bounding box plus a margin; None without obstacles.

    A robot knows a small part of a large grid, so cropping saves most of the work.
    """
    spans: list[slice] = []
    for axis in (0, 1):
        lines = np.flatnonzero(obstacles.any(axis=1 - axis))
        if not lines.size:
            return None
        spans.append(slice(max(0, int(lines[0]) - margin), int(lines[-1]) + margin + 1))
    return spans[0], spans[1]


def _inflate(obstacles: Mask, radius: float) -> Mask:
    """Dilate from the rim of the disc inwards: columns get taller towards its centre."""
    grown, high = np.zeros(obstacles.shape, np.bool_), obstacles.copy()
    rows, columns = obstacles.shape
    height = 0
    for shift in range(min(math.floor(radius), columns - 1), -1, -1):
        while height < rows and float((height + 1) ** 2 + shift * shift) <= radius * radius:
            height += 1
            _spread(high, obstacles, height)
        _spread(grown.T, high.T, shift)
    return grown


def _spread(target: Mask, source: Mask, shift: int) -> None:
    """OR `source`, shifted by `shift` rows both ways, into `target`."""
    if not shift:
        target |= source
    elif shift < len(source):
        target[shift:] |= source[:-shift]
        target[:-shift] |= source[shift:]


def _distances_down(obstacles: Mask) -> _Whole:
    """Distance from each cell to the nearest obstacle in its column.

    The sum of both sides stands for infinity, in columns without obstacles.
    """
    infinite = sum(obstacles.shape)
    # Half as large where squares of distances allow it, because memory limits the speed.
    whole = np.int32 if 2 * infinite * infinite <= np.iinfo(np.int32).max else np.int64
    distances = np.where(obstacles, whole(0), whole(infinite))
    # Row by row, down and then up: `accumulate` along this axis takes far longer.
    for rows in (distances, distances[::-1]):
        for above, row in pairwise(rows):
            np.minimum(row, above + 1, out=row)
    return np.minimum(distances, whole(infinite))


def _lower_envelope(heights: _Whole) -> _Whole:
    """For each place of each line the minimum over others of (place - other)² + height(other)².

    `heights` is (places, lines); all lines advance together.
    """
    envelope = _Envelope(heights)
    for place in range(1, heights.shape[0]):
        envelope.pop_hidden_by(place)
        envelope.push(place)
    nearest = envelope.lowest()
    steps = np.arange(heights.shape[0], dtype=heights.dtype)[:, np.newaxis] - nearest
    return steps * steps + np.take_along_axis(envelope.squares, nearest, axis=0)


class _Envelope:
    """Per line, a stack of the parabolas that form the lower envelope, at first that of place 0.

    `peaks` are the parabolas' places and `begins` the first place where each is lowest, both
    (lines, depth), so that a stack is contiguous; `tops` is the depth of each line's last parabola,
    -1 for an empty stack. `peak`, `begin` and `square` are those of the last parabolas, because
    reading from stacks is slow.
    """

    def __init__(self, heights: _Whole) -> None:
        self.squares = heights * heights
        self._peaks = np.zeros(heights.shape[::-1], heights.dtype)
        self._begins = np.zeros_like(self._peaks)
        self._tops = np.zeros(heights.shape[1], np.intp)
        self._peak, self._begin = self._peaks[:, 0].copy(), self._begins[:, 0].copy()
        self._square = self.squares[0].copy()

    def pop_hidden_by(self, place: int) -> None:
        """Pop parabolas that are above this place's over their whole range."""
        lines = np.flatnonzero(self._is_hidden_by(place, np.s_[:]))
        while lines.size:
            self._tops[lines] -= 1
            lines = lines[self._tops[lines] >= 0]
            tops = self._tops[lines]
            self._peak[lines] = peaks = self._peaks[lines, tops]
            self._begin[lines] = self._begins[lines, tops]
            self._square[lines] = self.squares[peaks, lines]
            lines = lines[self._is_hidden_by(place, lines)]

    def _is_hidden_by(self, place: int, lines: slice | NDArray[np.intp]) -> NDArray[np.bool_]:
        begin = self._begin[lines]
        old = (begin - self._peak[lines]) ** 2 + self._square[lines]
        return old > (begin - place) ** 2 + self.squares[place, lines]

    def push(self, place: int) -> None:
        """Push this place's parabola if it is lowest anywhere before the line ends."""
        squares = self.squares[place]
        # The first place at which the new parabola is lowest: their intersection, exact in
        # integers.
        apart = place - self._peak
        begin = 1 + (squares - self._square + (place + self._peak) * apart) // (2 * apart)
        begin[self._tops < 0] = 0
        lines = np.flatnonzero(begin < len(self.squares))
        self._tops[lines] += 1
        tops = self._tops[lines]
        self._peaks[lines, tops] = self._peak[lines] = place
        self._begins[lines, tops] = self._begin[lines] = begin[lines]
        self._square[lines] = squares[lines]

    def lowest(self) -> _Whole:
        """For each place of each line, the place of the lowest parabola."""
        lowest = np.zeros_like(self.squares)
        # Peaks ascend along a line, so a running maximum fills the places between two beginnings.
        lines, depths = np.nonzero(np.arange(self._tops.max() + 1) <= self._tops[:, np.newaxis])
        lowest[self._begins[lines, depths], lines] = self._peaks[lines, depths]
        for before, after in pairwise(lowest):
            np.maximum(before, after, out=after)
        return lowest
