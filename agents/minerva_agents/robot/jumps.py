"""Jump tables of a grid: distance to the next jump point per cell and direction.

Among equally short paths, only the one that goes diagonally as early as possible is followed, so a
search stops only where such a path may turn [Harabor, Grastien 2011, "Online Graph Pruning for
Pathfinding on Grid Maps"]. numpy computes the next jump point for all cells at once [Harabor,
Grastien 2014, "Improving Jump Point Search"].
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Mask

# A direction is an index into this ring, counter-clockwise; odd indices are diagonals.
_RING: Final = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_LINES_AT_ONCE: Final = 512

# Costs are integers so that equal lengths compare equal regardless of summation order. Two
# different lengths of n moves differ by at least about 1 / (3 n); 60 bits are far finer than that.
STRAIGHT: Final = 1 << 60
DIAGONAL: Final = math.isqrt(2 << 120)

LEAP: Final = 255
"""Marks a jump that does not fit in a byte: go `LEAP - 1` cells and look up again."""

Bytes: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Direction:
    """One of eight directions: index, flat cell offset, cost per move, and jump table.

    `jumps[cell]` is the number of cells to the next cell where a path may turn or end, 0 if a wall
    comes first, or LEAP.
    """

    number: int
    step: int
    cost: int
    jumps: bytes

    def jump(self, cell: int) -> int:
        """Number of cells to the next jump point, at any distance; 0 if a wall comes first."""
        moves = 0
        # Tables have one byte per cell, so a long jump consists of several entries.
        while self.jumps[cell] == LEAP:
            cell += (LEAP - 1) * self.step
            moves += LEAP - 1
        return moves + self.jumps[cell]


@dataclass(frozen=True, slots=True)
class Jumps:
    """A flattened grid with a blocked border, and the jump tables of all directions.

    `corners` holds, per cell, the walls that a straight path has just passed (see `_corners`).
    `ways[direction][corners[cell]]` are the directions in which a path may continue.
    """

    width: int
    targets: bytes
    corners: bytes
    directions: tuple[Direction, ...]
    ways: tuple[tuple[tuple[Direction, ...], ...], ...]

    def flat(self, cell: tuple[int, int]) -> int:
        """Flat index of a cell."""
        return (cell[0] + 1) * self.width + cell[1] + 1

    def cell(self, flat: int) -> tuple[int, int]:
        """Cell of a flat index."""
        row, column = divmod(flat, self.width)
        return row - 1, column - 1


def jumps_of(blocked: Mask, targets: Mask) -> Jumps:
    """Jump tables of a grid for paths that end in `targets`; both bool, of one shape.

    Needs about 12 bytes per cell, and 20 during construction.
    """
    width = blocked.shape[1] + 2
    steps = [row * width + column for row, column in _RING]
    free = np.pad(~blocked, 1).ravel()
    ends = np.pad(targets, 1).ravel()
    corners = _corners(free, steps)
    tables: list[Bytes] = [np.empty(0, np.uint8)] * 8
    # Straight tables first: a diagonal may turn wherever a straight move from it can.
    for number in (0, 2, 4, 6):
        turns = ends | (corners & (3 << number) != 0)
        tables[number] = _table(_open(free, steps, number), turns, steps[number], width)
    for number in (1, 3, 5, 7):
        turns = ends | (tables[number - 1] > 0) | (tables[(number + 1) % 8] > 0)
        tables[number] = _table(_open(free, steps, number), turns, steps[number], width)
    directions = tuple(
        [
            Direction(number, step, DIAGONAL if number & 1 else STRAIGHT, table.tobytes())
            for number, (step, table) in enumerate(zip(steps, tables, strict=True))
        ]
    )
    # The search reads single cells, which is much faster in bytes than in arrays.
    return Jumps(width, ends.tobytes(), corners.tobytes(), directions, _ways(directions))


def _ahead(flat: Mask, step: int) -> Mask:
    """Value of the cell one step ahead, for each cell.

    Values that wrap around land on border cells, which are blocked anyway.
    """
    return np.roll(flat, -step)


def _open(free: Mask, steps: Sequence[int], number: int) -> Mask:
    """Cells that permit a move in a direction; a diagonal needs both adjacent cells free."""
    is_open = free & _ahead(free, steps[number])
    if number & 1:
        is_open &= _ahead(free, steps[number - 1]) & _ahead(free, steps[(number + 1) % 8])
    return is_open


def _corners(free: Mask, steps: Sequence[int]) -> Bytes:
    """Corners that a straight move has just passed: free beside, blocked beside and behind.

    Bit d stands for direction d (0, 2, 4, 6) with the corner on its left, bit d + 1 for the corner
    on its right.
    """
    corners = np.zeros(free.shape, np.uint8)
    for number in (0, 2, 4, 6):
        passed = free & _ahead(free, -steps[number])
        for bit, side in ((number, (number + 2) % 8), (number + 1, (number - 2) % 8)):
            beside = _ahead(free, steps[side])
            corner = passed & beside & ~_ahead(beside, -steps[number])
            corners |= corner.astype(np.uint8) << bit
    return corners


def _ways(directions: Sequence[Direction]) -> tuple[tuple[tuple[Direction, ...], ...], ...]:
    """Directions in which an early-diagonal shortest path may continue, by arrival and corners."""
    return tuple(
        [
            tuple(
                [tuple([directions[way] for way in _ways_on(number, bits)]) for bits in range(256)]
            )
            for number in range(8)
        ]
    )


def _ways_on(number: int, corners: int) -> list[int]:
    """Continuations of a move: a diagonal continues straight on or to either side.

    A straight move continues, and turns around passed corners, where no shorter path exists.
    """
    left, right = (number + 1) % 8, (number - 1) % 8
    if number & 1:
        return [left, number, right]
    ways = [number]
    if corners >> number & 1:
        ways += [left, (number + 2) % 8]
    if corners >> number & 2:
        ways += [right, (number - 2) % 8]
    return ways


def _table(is_open: Mask, turns: Mask, step: int, width: int) -> Bytes:
    """Per flat cell, the number of cells to the next turn, 0 if a move before it is blocked."""
    opens, ends = _lines(is_open, step, width), _lines(turns, step, width)
    table = np.empty(opens.shape, np.uint8)
    for first in range(0, opens.shape[1], _LINES_AT_ONCE):
        lines = np.s_[:, first : first + _LINES_AT_ONCE]
        table[lines] = _along(opens[lines], ends[lines], step > 0)
    flat = (table.T if abs(step) == 1 else table).ravel()
    return flat[: is_open.size]


def _lines(flat: Mask, step: int, width: int) -> Mask:
    """The flat grid as (places, lines), with cells one step apart in consecutive places.

    For a step of 1 these are the grid's rows; otherwise the grid is folded into rows as long as the
    step, so diagonals become columns too.
    """
    fold = abs(step)
    if fold == 1:
        return flat.reshape(-1, width).T
    padded = np.zeros(-(-flat.size // fold) * fold, np.bool_)
    padded[: flat.size] = flat
    return padded.reshape(-1, fold)


def _along(is_open: Mask, turns: Mask, forward: bool) -> Bytes:
    """Jump distances along lines, (places, lines), in one direction.

    A stop is encoded as twice its place, plus one if it is not a turn.
    """
    if not forward:
        return _along(is_open[::-1], turns[::-1], True)[::-1]
    places = np.arange(0, 2 * len(is_open), 2, dtype=np.int32)[:, np.newaxis]
    beyond = np.int32(2 * len(is_open) + 1)
    stops = np.full((len(is_open) + 1, is_open.shape[1]), beyond)
    stops[:-1] = np.where(turns, places, np.where(is_open, beyond, places + np.int32(1)))
    ahead = np.minimum.accumulate(stops[::-1], axis=0)[::-1][1:]
    distances = np.minimum((ahead - places) >> 1, LEAP)
    return np.where(is_open & (ahead & 1 == 0), distances, 0).astype(np.uint8)
