"""Sums over square blocks of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import Mask


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
