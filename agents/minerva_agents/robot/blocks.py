"""Sums over square blocks of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import Mask


def block_sums(mask: Mask, side: int) -> NDArray[np.int64]:
    """Number of True cells in each block of `side` x `side` cells; cut off at the far edges."""
    rows, columns = mask.shape
    padded = np.pad(mask, ((0, -rows % side), (0, -columns % side)))
    shape = padded.shape[0] // side, side, padded.shape[1] // side, side
    return padded.reshape(shape).sum(axis=(1, 3))


def box_sums(numbers: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
    """Per item, the sum of all items at most `reach` rows and columns away."""
    sums = np.pad(numbers, reach)
    for axis in (0, 1):
        before = np.insert(sums, 0, 0, axis=axis).cumsum(axis=axis)
        count = numbers.shape[axis]
        ends = np.arange(count) + 2 * reach + 1
        sums = before.take(ends, axis=axis) - before.take(np.arange(count), axis=axis)
    return sums
