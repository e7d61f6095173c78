"""Random numbers in rules: the methods of `moment.chance` as functions, with the same numbers.

All rules of a frame continue one stream, that of (seed, id of the space, frame).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.portable.distributions import (
    draw_chance,
    draw_exponential,
    draw_integers,
    draw_normal,
    draw_random,
    draw_uniform,
)
from minerva_fast.space.kernels import kernel

Draws: TypeAlias = NDArray[np.uint64]
"""A random stream, shape (1,); the parameter of a rule with this annotation."""


@kernel
def random(draws: Draws) -> float:
    """Uniform in [0, 1)."""
    return draw_random(draws, 0)


@kernel
def uniform(draws: Draws, low: float = 0.0, high: float = 1.0) -> float:
    """Uniform in [low, high)."""
    return draw_uniform(draws, 0, low, high)


@kernel
def integers(draws: Draws, low: int, high: int | None = None) -> int:
    """An int in [low, high), or in [0, low) without `high`. Raises ValueError if there is none."""
    if high is None:
        least, below = 0, low
    else:
        least, below = low, high
    # The difference is what is drawn, so it must not be too large.
    if below - least <= 0:
        raise ValueError(EMPTY_RANGE)
    return draw_integers(draws, 0, least, below)


@kernel
def chance(draws: Draws, probability: float) -> bool:
    """True with this probability."""
    return draw_chance(draws, 0, probability)


@kernel
def exponential(draws: Draws, mean: float = 1.0) -> float:
    """Exponentially distributed, with this mean."""
    return draw_exponential(draws, 0, -mean)


@kernel
def normal(draws: Draws, mean: float = 0.0, deviation: float = 1.0) -> float:
    """Normally distributed; takes two draws."""
    return draw_normal(draws, 0, mean, deviation)


@kernel
def shuffle(draws: Draws, rows: NDArray[np.int64]) -> None:
    """Put rows into a random order (Fisher and Yates)."""
    for last in range(len(rows) - 1, 0, -1):
        other = integers(draws, 0, last + 1)
        row = rows[last]
        rows[last] = rows[other]
        rows[other] = row


EMPTY_RANGE = "integers: no int is in this range; expected low < high"
