"""Windows of a grid: where a search looks first, and how short a path can be that leaves one."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from minerva_agents.robot.grids import Cell

_MARGIN: Final = 48
"""Cells around the ends of a path in the first window."""
_GROWTH: Final = 4
"""How many times wider the margin of each window is than that of the one before."""


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
        """Whether it is the whole grid."""
        return (self.top, self.left, self.bottom, self.right) == (0, 0, *self.shape)

    @property
    def cut(self) -> tuple[slice, slice]:
        """What it cuts out of the grid."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def inside(self, cell: Cell) -> Cell:
        """A cell of the grid as one of the window."""
        return cell[0] - self.top, cell[1] - self.left

    def way_out(self, ends: Sequence[Cell]) -> float:
        """No path between the first and the last of the ends that leaves the window is shorter.

        It is the length of the shortest path over a line of cells just outside if nothing were
        blocked, infinite where the grid ends too. With one end: of a path from it to that line.
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
    """Windows around the ends of a path, each larger than the one before; the last is the grid.

    One that would be half of the grid or more is left out, for the grid costs little more.
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
    """The octile length of a path from the first end to a line and, if there is another, to it.

    The other end is mirrored at the line.
    """
    first, last = ends[0], ends[-1]
    if len(ends) == 1:
        return float(abs(line - first[axis]))
    across = abs(line - first[axis]) + abs(line - last[axis])
    along = abs(first[1 - axis] - last[1 - axis])
    return max(across, along) + (math.sqrt(2.0) - 1.0) * min(across, along)
