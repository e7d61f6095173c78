"""Exact Euclidean distances to obstacles on a grid, in cells.

`clearance` first computes the distance to the nearest obstacle in each column. Each row is then the
lower envelope of parabolas, one per cell: the squared distance to an obstacle is the minimum of
(columns across)² + (distance in that column)².
"""

import math
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import MapError, Mask, check_grid

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
    Run time depends on the area only: the lower envelopes of all rows are built in parallel, column
    by column [Felzenszwalb, Huttenlocher 2012, "Distance Transforms of Sampled Functions";
    Meijster, Roerdink, Hesselink 2000, with integers]. Raises MapError unless `obstacles` is a 2-D
    bool grid.
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
