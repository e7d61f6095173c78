"""Random numbers in rules: those of `moment.chance`, in the same order (`minerva_bus.world.rng`).

All rules of a frame continue one stream, that of (seed, id of the space, frame).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.space.kernels import kernel

Draws: TypeAlias = NDArray[np.uint64]
"""A random stream, shape (1,); the parameter of a rule with this annotation."""

# The constants of SplitMix64, as in `minerva_bus.world.rng`.
GAMMA = np.uint64(0x9E3779B97F4A7C15)
FIRST = np.uint64(0xBF58476D1CE4E5B9)
SECOND = np.uint64(0x94D049BB133111EB)
UNIT = 2.0**-53
R11, R27, R30, R31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


@kernel
def random(draws: Draws) -> float:
    """Uniform in [0, 1)."""
    draws[0] += GAMMA
    word = draws[0]
    word = (word ^ (word >> R30)) * FIRST
    word = (word ^ (word >> R27)) * SECOND
    word = word ^ (word >> R31)
    return float(word >> R11) * UNIT


@kernel
def integers(draws: Draws, low: int, high: int) -> int:
    """An int in [low, high)."""
    return low + int((high - low) * random(draws))


@kernel
def chance(draws: Draws, probability: float) -> bool:
    """True with this probability."""
    return random(draws) < probability


@kernel
def uniform(draws: Draws, low: float, high: float) -> float:
    """Uniform in [low, high)."""
    return low + (high - low) * random(draws)


@kernel
def shuffle(draws: Draws, rows: NDArray[np.int64]) -> None:
    """Put rows into a random order (Fisher and Yates)."""
    for last in range(len(rows) - 1, 0, -1):
        other = integers(draws, 0, last + 1)
        row = rows[last]
        rows[last] = rows[other]
        rows[other] = row
