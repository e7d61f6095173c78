"""A matrix of truths as few rectangles."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Rectangle: TypeAlias = tuple[int, int, int, int]


def rectangles(cells: NDArray[np.bool_]) -> list[Rectangle]:
    """Rectangles that cover what is true in a matrix, and do not cover one another.

    Each is the row and the column from which, and those up to which (not included) it goes. A run
    of columns goes on from row to row as long as the next row has the very same run. They are in
    the order in which they end.
    """
    found: list[Rectangle] = []
    growing: dict[tuple[int, int], int] = {}
    for row in range(len(cells) + 1):
        runs = _runs(cells[row]) if row < len(cells) else []
        for run in sorted(growing.keys() - set(runs)):
            found.append((growing.pop(run), run[0], row, run[1]))
        growing.update((run, row) for run in runs if run not in growing)
    return found


def _runs(line: NDArray[Any]) -> list[tuple[int, int]]:
    """Where what is true begins and ends."""
    padded = np.concatenate(([False], line, [False]))
    ends = np.flatnonzero(padded[1:] != padded[:-1]).tolist()
    return list(zip(ends[::2], ends[1::2], strict=True))
