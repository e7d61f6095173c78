"""Lengths: square roots of sums of squares.

IEEE 754 defines the square root to the last bit. Numbers whose squares would be too large or too
small are first scaled by a power of 2, which is exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from minerva_bus.portable.polynomials import Numbers, binary

_LARGE: Final = 2.0**510
_SMALL: Final = 2.0**-480
_DOWN: Final = 2.0**-600
_UP: Final = 2.0**600


def hypot_one(x: float, y: float) -> float:
    """The length of (x, y)."""
    x, y = abs(x), abs(y)
    most = y if y > x else x
    # The squares neither overflow nor lose digits by underflow.
    if _SMALL < most < _LARGE or x == y == 0.0:
        return math.sqrt(x * x + y * y)
    if x == math.inf or y == math.inf:
        return math.inf
    if most >= _LARGE:
        x, y = x * _DOWN, y * _DOWN
        return math.sqrt(x * x + y * y) * _UP
    x, y = x * _UP, y * _UP
    return math.sqrt(x * x + y * y) * _DOWN


def hypot_many(x: Numbers, y: Numbers) -> Numbers:
    """`hypot` of each."""
    x, y = np.abs(x), np.abs(y)
    most = np.maximum(x, y)
    made = np.sqrt(x * x + y * y)
    if (((most > _SMALL) | (most == 0.0)) & (most < _LARGE)).all():
        return made
    # As in `hypot_one`: only elements out of range are scaled.
    large, small = most >= _LARGE, most <= _SMALL
    up, down = np.where(small, _UP, np.where(large, _DOWN, 1.0)), np.where(small, _DOWN, 1.0)
    x, y = x * up, y * up
    made = np.sqrt(x * x + y * y) * np.where(large, _UP, down)
    return np.where((x == np.inf) | (y == np.inf), np.inf, made)


hypot = binary(hypot_one, hypot_many)


def dist(p: Sequence[float], q: Sequence[float]) -> float:
    """The distance of two points in the plane, (x, y) each."""
    (x, y), (to_x, to_y) = p, q
    return hypot_one(x - to_x, y - to_y)
