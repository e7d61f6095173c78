"""Exact reduction of huge angles, with as many digits of 2/π as they need.

Method: M. Payne and R. Hanek, Radian reduction for trigonometric functions (1983).
"""

from __future__ import annotations

import math
from typing import Final

_DIGITS: Final = int(  # 2/π, times 2^1216
    "A2F9836E4E441529FC2757D1F534DDC0DB6295993C439041FE5163ABDEBBC561B7246E3A424D"
    "D2E006492EEA09D1921CFE1DEB1CB129A73EE88235F52EBB4484E99C7026B45F7E413991D639"
    "835339F49C845F8BBDF9283B1FF897FFDE05980FEF2F118B5A0A6D1F6D367ECF27CB09B74F46"
    "3F669E5FEA2D7527BAC7EBE5F17B3D0739F78A5292EA6BFB5FB11F8D5D0856033046FC7B6BAB",
    16,
)
_BITS: Final = 1216
_KEPT: Final = 180
"""Bits after the point; the float64 nearest to a multiple of π/2 costs 62 of them."""

_QUARTER: Final = 1.57079632679489655800e00  # π/2 as a sum of two
_QUARTER_LOW: Final = 6.12323399573676603587e-17


def far(x: float) -> tuple[int, float, float]:
    """The nearest number of quarter turns, modulo 4, and the rest as a sum of two numbers."""
    part, exponent = math.frexp(x)
    # Integers of any length make the product with 2/π exact.
    whole, exponent = int(math.ldexp(part, 53)), exponent - 53
    turned = whole * _DIGITS  # x in quarter turns, times 2^(_BITS - exponent)
    shift = _BITS - exponent - _KEPT
    quarters = turned >> shift
    half = 1 << (_KEPT - 1)
    number = (quarters + half) >> _KEPT
    rest = quarters - (number << _KEPT)
    # The upper 53 bits of the rest, and the next ones.
    upper = float(rest)
    lower = float(rest - int(upper))
    upper, lower = math.ldexp(upper, -_KEPT), math.ldexp(lower, -_KEPT)
    y, low = _times_quarter(upper, lower)
    return number & 3, y, low


def _times_quarter(upper: float, lower: float) -> tuple[float, float]:
    """(upper + lower) π/2 as a sum of two numbers."""
    y = upper * _QUARTER
    low = _lost(upper, _QUARTER, y) + (upper * _QUARTER_LOW + lower * _QUARTER)
    total = y + low
    return total, (y - total) + low


def _lost(a: float, b: float, product: float) -> float:
    """The rounding error of a product of two numbers; Dekker (1971)."""
    wide = a * 134217729.0
    a1 = wide - (wide - a)
    wide = b * 134217729.0
    b1 = wide - (wide - b)
    a2, b2 = a - a1, b - b1
    return ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2
