"""The cells of a lattice and their neighbours; cell = y * width + x."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from minerva_fast.space.draws import Draws, integers
from minerva_fast.space.kernels import kernel


class CellGrid(NamedTuple):
    """Width and height in cells, and whether opposite edges are connected.

    `inner` is a cell with 8 neighbours beside it without a way across an edge, which saves `beside`
    the comparisons, or -1.
    """

    width: int
    height: int
    periodic: bool
    inner: int = -1


NO_CELL = "a cell is outside of the lattice, as -1 of `beside` or `random_free` is; test it before"


@kernel
def inside(lattice: CellGrid, cell: int) -> None:
    """Raise IndexError if there is no such cell."""
    if not 0 <= cell < lattice.width * lattice.height:
        raise IndexError(NO_CELL)


@kernel
def row_of(lattice: CellGrid, cell: int) -> int:
    """The row y of a cell."""
    # Division of 64-bit ints takes several times as long, and most time of a cellular automaton.
    return int(np.uint32(cell) // np.uint32(lattice.width))


@kernel
def surrounded(lattice: CellGrid, cell: int) -> bool:
    """Whether a cell, from 0, has 8 neighbours without a way across an edge."""
    if lattice.width < 3 or lattice.height < 3:
        return False
    row = row_of(lattice, cell)
    return 0 < row < lattice.height - 1 and 0 < cell - row * lattice.width < lattice.width - 1


@kernel
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


@kernel
def next_cell(lattice: CellGrid, cell: int, draws: Draws) -> int:
    """A random one of the (up to) 8 cells around a cell."""
    while True:
        place = integers(draws, 0, 8)
        place += place >= 4  # Without the middle of the 3 x 3 cells.
        other = beside(lattice, cell, place % 3 - 1, place // 3 - 1)
        if other >= 0:
            return other
