"""Normally distributed numbers from uniform ones; G. Box and M. Muller (1958)."""

from __future__ import annotations

import math

import numpy as np

from minerva_bus.portable.circle import cos_turns_many, cos_turns_one
from minerva_bus.portable.forms import Numbers, binary
from minerva_bus.portable.logarithms import log_many, log_one


def standard_normal_one(first: float, second: float) -> float:
    """A standard normal number from two uniform ones in [0, 1)."""
    # 1 - u is in (0, 1], so the logarithm is finite.
    return math.sqrt(-2.0 * log_one(1.0 - first)) * cos_turns_one(second)


def standard_normal_many(first: Numbers, second: Numbers) -> Numbers:
    """`standard_normal` of each pair."""
    return np.sqrt(-2.0 * log_many(1.0 - first)) * cos_turns_many(second)


standard_normal = binary(standard_normal_one, standard_normal_many)


def normal(random: np.random.Generator, deviation: float = 1.0) -> float:
    """A normal number with mean 0, from two uniform draws.

    The `normal` of a Generator uses the logarithm of the C library.
    """
    first, second = random.random(2).tolist()
    return deviation * standard_normal_one(first, second)


def normals(random: np.random.Generator, count: int, deviation: float = 1.0) -> Numbers:
    """Normal numbers with mean 0, (count,), from two uniform draws each.

    They differ from those of repeated calls of `normal`, because the first numbers of all pairs are
    drawn before the second ones.
    """
    first, second = random.random((2, count))
    return deviation * standard_normal_many(first, second)
