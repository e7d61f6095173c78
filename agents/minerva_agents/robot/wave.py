"""Distances from one cell to others, computed ring by ring and only as far as needed.

A ring is the set of cells that the next step reaches. Odd steps go to the four sides, even steps
also to the diagonals, so rings are octagons: n steps are n cells straight on and 1.06 n at 45
degrees, at most 1.12 n. That is accurate enough to compare paths, and numpy processes a whole ring
at a time.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Mask
from minerva_agents.robot.motion import Cell

STEP: Final = 1.06
"""Mean length of a step in cells."""

Flats = NDArray[np.intp]


class Wave:
    """A breadth-first wave from a start cell on a grid (bool, rows x columns) of passable cells.

    `steps` is the number of steps to each cell, -1 where the wave has not arrived; (rows, columns)
    int32.
    """

    def __init__(self, passable: Mask, start: Cell) -> None:
        # With a blocked border, steps to neighbours need no checks of bounds.
        rows, self._width = passable.shape[0] + 2, passable.shape[1] + 2
        padded = np.zeros((rows, self._width), np.bool_)
        padded[1:-1, 1:-1] = passable
        self._free = padded.ravel()
        self._fresh = self._free.copy()
        width = self._width
        self._sides = np.array([[width], [-width], [1], [-1]], np.intp)
        self._diagonals = np.array([[down + across] for down, across in self._corners], np.intp)
        self._may_cut = _may_cut(padded)
        self._owner = np.empty(self._free.size, np.int32)
        self._steps = np.full(self._free.size, -1, np.int32)
        origin = (start[0] + 1) * self._width + start[1] + 1
        self._ring: Flats = np.array([origin], np.intp)
        self._fresh[origin] = False
        self._steps[origin] = 0
        self._count = 0
        self._reached: list[Flats] = [self._ring]

    @property
    def steps(self) -> NDArray[np.int32]:
        """Steps to each cell so far, -1 where not reached."""
        return self._steps.reshape(-1, self._width)[1:-1, 1:-1]

    @property
    def is_over(self) -> bool:
        """True once every reachable cell has been reached."""
        return not self._ring.size

    def grow(self, limit: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Advance to at most `limit` steps; rows and columns of all reached cells, in order."""
        while self._ring.size and self._count < limit:
            self._count += 1
            self._ring = self._next_ring()
            self._steps[self._ring] = self._count
            self._reached.append(self._ring)
        rows, columns = np.divmod(np.concatenate(self._reached), self._width)
        return rows - 1, columns - 1

    def path_to(self, cell: Cell) -> list[Cell]:
        """Cells from the start to a reached cell, each adjacent to the previous."""
        flat, path = (cell[0] + 1) * self._width + cell[1] + 1, list[int]()
        while True:
            path.append(flat)
            count = int(self._steps[flat])
            if not count:
                break
            flat = self._before(flat, count)
        return [(index // self._width - 1, index % self._width - 1) for index in reversed(path)]

    def _next_ring(self) -> Flats:
        ring = self._ring
        cells = (ring + self._sides).ravel()
        # Diagonals on every second ring only: the wave grows as an octagon, close to a circle.
        if self._count % 2 == 0:
            diagonals = (ring + self._diagonals)[self._may_cut[:, ring]]
            cells = np.concatenate((cells, diagonals))
        cells = cells[self._fresh[cells]]
        self._fresh[cells] = False
        # A cell that several neighbours reach keeps the last number written, so exactly one of
        # its copies remains; much faster than np.unique.
        numbers = np.arange(cells.size, dtype=np.int32)
        self._owner[cells] = numbers
        return cells[self._owner[cells] == numbers]

    @property
    def _corners(self) -> tuple[tuple[int, int], ...]:
        width = self._width
        return (width, 1), (width, -1), (-width, 1), (-width, -1)

    def _before(self, flat: int, count: int) -> int:
        """A predecessor of a cell on the previous ring, chosen deterministically."""
        width = self._width
        for step in (width, -width, 1, -1):
            if self._steps[flat + step] == count - 1:
                return flat + step
        for down, across in self._corners:
            is_free = self._free[flat + down] and self._free[flat + across]
            if is_free and self._steps[flat + down + across] == count - 1:
                return flat + down + across
        raise AssertionError(f"no cell of ring {count - 1} is beside cell {flat} of ring {count}")


def _may_cut(free: Mask) -> NDArray[np.bool_]:
    """Of each cell, which of its four diagonals cut no corner of a blocked cell; (4, cells).

    The diagonals have the order of `Wave._corners`; those of the border are False.
    """
    below, above = free[2:, 1:-1], free[:-2, 1:-1]
    right, left = free[1:-1, 2:], free[1:-1, :-2]
    both = below & right, below & left, above & right, above & left
    result = np.zeros((len(both), *free.shape), np.bool_)
    result[:, 1:-1, 1:-1] = both
    return result.reshape(len(both), -1)
