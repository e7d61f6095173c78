"""Sums over square blocks of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import Mask


def block_sums(mask: Mask, side: int) -> NDArray[np.int64]:
    """Number of True cells in each block of `side` x `side` cells; cut off at the far edges."""
    rows, columns = mask.shape
    # `np.pad` and `np.insert` take longer than the sums of grids of this size.
    padded = np.zeros((rows + -rows % side, columns + -columns % side), np.bool_)
    padded[:rows, :columns] = mask
    shape = padded.shape[0] // side, side, padded.shape[1] // side, side
    return padded.reshape(shape).sum(axis=(1, 3))


def box_sums(numbers: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
    """Per item, the sum of all items at most `reach` rows and columns away."""
    (rows, columns), width = numbers.shape, 2 * reach + 1
    # Cumulative sums begin with 0, so there is one more item before than after.
    sums = np.zeros((rows + width, columns + width), numbers.dtype)
    sums[reach + 1 : reach + 1 + rows, reach + 1 : reach + 1 + columns] = numbers
    down = sums.cumsum(axis=0)
    across = (down[width:] - down[:rows]).cumsum(axis=1)
    return across[:, width:] - across[:, :columns]
