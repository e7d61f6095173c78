"""Distances to obstacles on a grid: exact, Euclidean, in cells.

Clearance begins with the distance down each column to an obstacle of that column. Then each row is
the lower envelope of parabolas, one for each of its cells: the square of the distance to the
obstacle is the least of (steps across)² + (distance down)².
"""

import math

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Grid, MapError, check_grid

_LINES_AT_ONCE = 2048
"""Rows of the grid that are transformed together: enough for numpy, few enough for the memory."""


def inflate(obstacles: Grid, radius_cells: float) -> Grid:
    """The obstacles grown by a disc: every cell whose centre is within the radius of one's centre.

    `obstacles` is a bool grid, the radius is in cells and need not be whole. The time grows with
    the radius and the area that obstacles lie in. Raises MapError for another grid and for a radius
    that is negative or not finite.
    """
    check_grid(obstacles, "inflate", "obstacles")
    if not (math.isfinite(radius_cells) and radius_cells >= 0):
        raise MapError(f"inflate: radius_cells is {radius_cells}, expected a number from 0 up")
    grown = np.zeros(obstacles.shape, np.bool_)
    window = _around_all(obstacles, math.floor(radius_cells))
    if window is not None:
        grown[window] = _inflate(obstacles[window], radius_cells)
    return grown


def clearance(obstacles: Grid) -> NDArray[np.float64]:
    """The Euclidean distance, in cells, from each cell's centre to that of the nearest obstacle.

    Exact; 0 on obstacles, infinite where the grid has none. What lies outside the grid is not an
    obstacle. The time grows with the area alone: the lower envelopes of all rows are built side by
    side, column by column [Felzenszwalb, Huttenlocher 2012, "Distance Transforms of Sampled
    Functions"; Meijster, Roerdink, Hesselink 2000, in whole numbers]. Raises MapError for what is
    not a 2-D bool grid.
    """
    check_grid(obstacles, "clearance", "obstacles")
    if not obstacles.any():
        return np.full(obstacles.shape, np.inf)
    down = _whole_distances_down(obstacles)
    distances = np.empty(obstacles.shape)
    for first in range(0, obstacles.shape[0], _LINES_AT_ONCE):
        lines = np.s_[first : first + _LINES_AT_ONCE]
        distances[lines] = np.sqrt(_lower_envelope(np.ascontiguousarray(down[lines].T))).T
    return distances


def _around_all(obstacles: Grid, margin: int) -> tuple[slice, slice] | None:
    """The rows and columns between the outermost obstacles and a margin, None without obstacles.

    A robot knows a small part of a large grid, and nothing is inflated elsewhere.
    """
    spans: list[slice] = []
    for axis in (0, 1):
        lines = np.flatnonzero(obstacles.any(axis=1 - axis))
        if not lines.size:
            return None
        spans.append(slice(max(0, int(lines[0]) - margin), int(lines[-1]) + margin + 1))
    return spans[0], spans[1]


def _inflate(obstacles: Grid, radius: float) -> Grid:
    """From the rim of the disc to its middle: the farther in a column is, the higher it is."""
    grown, high = np.zeros(obstacles.shape, np.bool_), obstacles.copy()
    rows, columns = obstacles.shape
    height = 0
    for shift in range(min(math.floor(radius), columns - 1), -1, -1):
        while height < rows and float((height + 1) ** 2 + shift * shift) <= radius * radius:
            height += 1
            _spread(high, obstacles, height)
        _spread(grown.T, high.T, shift)
    return grown


def _spread(target: Grid, source: Grid, shift: int) -> None:
    """Add to a grid what another one holds so many rows above or below."""
    if not shift:
        target |= source
    elif shift < len(source):
        target[shift:] |= source[:-shift]
        target[:-shift] |= source[shift:]


def _distances_down(obstacles: Grid) -> NDArray[np.float64]:
    """For each cell the distance to the nearest obstacle of its own column, or infinity."""
    rows = np.arange(obstacles.shape[0], dtype=np.float64)[:, np.newaxis]
    above = np.maximum.accumulate(np.where(obstacles, rows, -np.inf), axis=0)
    below = np.minimum.accumulate(np.where(obstacles, rows, np.inf)[::-1], axis=0)[::-1]
    return np.minimum(rows - above, below - rows)


def _whole_distances_down(obstacles: Grid) -> NDArray[np.int64]:
    """The same in whole numbers; more than any distance on the grid stands for infinity."""
    return np.minimum(_distances_down(obstacles), sum(obstacles.shape)).astype(np.int64)


def _lower_envelope(heights: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each place of each line the least of (place - other)² + height(other)², over all others.

    `heights` is (places, lines); all lines take their next place together.
    """
    envelope = _Envelope(heights)
    for place in range(heights.shape[0]):
        envelope.pop_hidden_by(place)
        envelope.push(place)
    nearest = envelope.lowest()
    steps = np.arange(heights.shape[0])[:, np.newaxis] - nearest
    return steps * steps + np.take_along_axis(envelope.squares, nearest, axis=0)


class _Envelope:
    """For each line a stack of the parabolas that are the lowest somewhere.

    `peaks` are the places of the parabolas, `begins` the first place where each is the lowest, both
    (depth, lines); `tops` is the depth of each line's last one, -1 for an empty stack.
    """

    def __init__(self, heights: NDArray[np.int64]) -> None:
        self.squares = heights * heights
        self._peaks = np.zeros(heights.shape, np.int64)
        self._begins = np.zeros(heights.shape, np.int64)
        self._lines = np.arange(heights.shape[1])
        self._tops = np.full(heights.shape[1], -1)

    def pop_hidden_by(self, place: int) -> None:
        """Take away the parabolas that this place's is below, from where each begins on."""
        lines = self._lines[self._tops >= 0]
        while lines.size:
            tops = self._tops[lines]
            begins, peaks = self._begins[tops, lines], self._peaks[tops, lines]
            old = (begins - peaks) ** 2 + self.squares[peaks, lines]
            new = (begins - place) ** 2 + self.squares[place, lines]
            lines = lines[old > new]
            self._tops[lines] -= 1
            lines = lines[self._tops[lines] >= 0]

    def push(self, place: int) -> None:
        """Add this place's parabola where it is the lowest before the line ends."""
        peaks = self._peaks[self._tops, self._lines]
        rise = self.squares[place] - self.squares[peaks, self._lines]
        apart = np.where(self._tops < 0, 1, place - peaks)
        begins = 1 + (rise + (place + peaks) * apart) // (2 * apart)
        begins[self._tops < 0] = 0
        lines = self._lines[begins < self.squares.shape[0]]
        self._tops[lines] += 1
        self._peaks[self._tops[lines], lines] = place
        self._begins[self._tops[lines], lines] = begins[lines]

    def lowest(self) -> NDArray[np.int64]:
        """For each place of each line the place whose parabola is the lowest there."""
        lowest = np.zeros(self._peaks.shape, np.int64)
        depths, lines = np.nonzero(np.arange(len(self._peaks))[:, np.newaxis] <= self._tops)
        lowest[self._begins[depths, lines], lines] = self._peaks[depths, lines]
        return np.maximum.accumulate(lowest, axis=0)
