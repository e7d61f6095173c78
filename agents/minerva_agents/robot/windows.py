"""Search windows of a grid, and a lower bound for paths that leave a window."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from minerva_agents.robot.grids import Cell

_MARGIN: Final = 48
"""Cells around the ends of a path in the first window."""
_GROWTH: Final = 4
"""Factor by which the margin grows from window to window."""


@dataclass(frozen=True, slots=True)
class Window:
    """The cells (row, column) with top <= row < bottom and left <= column < right of a grid."""

    top: int
    left: int
    bottom: int
    right: int
    shape: tuple[int, int]

    @property
    def is_all(self) -> bool:
        """True if the window covers the whole grid."""
        return (self.top, self.left, self.bottom, self.right) == (0, 0, *self.shape)

    @property
    def cut(self) -> tuple[slice, slice]:
        """Slices of the window."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def inside(self, cell: Cell) -> Cell:
        """A grid cell in the window's coordinates."""
        return cell[0] - self.top, cell[1] - self.left

    def way_out(self, ends: Sequence[Cell]) -> float:
        """Lower bound on the length of paths between the ends that leave the window.

        The shortest path via a line of cells just outside on an empty grid, infinite where the
        window ends at the grid's border. With one end: a path from it to that line.
        """
        return min(
            [_over(line, axis, ends) for axis, line in self._lines_outside()], default=math.inf
        )

    def _lines_outside(self) -> Iterator[tuple[int, int]]:
        for axis, (low, high) in enumerate(((self.top, self.bottom), (self.left, self.right))):
            if low > 0:
                yield axis, low - 1
            if high < self.shape[axis]:
                yield axis, high


def windows(shape: tuple[int, int], ends: Sequence[Cell]) -> Iterator[Window]:
    """Windows of growing size around the ends of a path; the last is the whole grid.

    Windows of half the grid or more are skipped, because the whole grid costs little more.
    """
    margin = _MARGIN
    while True:
        top, left = (max(0, min(end[axis] for end in ends) - margin) for axis in (0, 1))
        bottom, right = (
            min(shape[axis], max(end[axis] for end in ends) + margin + 1) for axis in (0, 1)
        )
        if 2 * (bottom - top) * (right - left) >= shape[0] * shape[1]:
            yield Window(0, 0, *shape, shape)
            return
        yield Window(top, left, bottom, right, shape)
        margin *= _GROWTH


def _over(line: int, axis: int, ends: Sequence[Cell]) -> float:
    """Octile length of a path from the first end via a line to the other end, if any.

    Computed by mirroring the other end at the line.
    """
    first, last = ends[0], ends[-1]
    if len(ends) == 1:
        return float(abs(line - first[axis]))
    across = abs(line - first[axis]) + abs(line - last[axis])
    along = abs(first[1 - axis] - last[1 - axis])
    return max(across, along) + (math.sqrt(2.0) - 1.0) * min(across, along)
