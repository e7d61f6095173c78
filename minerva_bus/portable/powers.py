"""Powers of a real number.

Computes the logarithm to base 2 of x as a sum of two numbers, its product with y, and 2 to the
power of the product. Method and coefficients: fdlibm (Sun Microsystems, 1993), e_pow. The cases of
0, infinity and nan (C standard, annex F) are exact in every library, so Python and numpy do them.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from minerva_bus.portable.exponentials import exp_series
from minerva_bus.portable.forms import F, Numbers, binary, head

_LN2: Final = 6.93147180559945286227e-01
_LN2_UPPER: Final = 6.93147182464599609375e-01
_LN2_LOWER: Final = -1.90465429995776804525e-09
_SCALE: Final = 9.61796693925975554329e-01  # 2 / (3 ln 2)
_SCALE_UPPER: Final = 9.61796700954437255859e-01
_SCALE_LOWER: Final = -7.02846165095275826516e-09
_LOG2_UPPER: Final = 5.84962487220764160156e-01  # the logarithm of 1.5 to base 2
_LOG2_LOWER: Final = 1.35003920212974897128e-08
_ROOT_1: Final = float.fromhex("0x1.3988ep0")  # about √(3/2)
_ROOT_2: Final = float.fromhex("0x1.bb67ap0")  # about √3
_LARGE: Final = 2.0**66
"""Larger exponents give no other results: all powers are 0 or infinite."""


def power_one(x: float, y: float) -> float:
    """The power of x with the exponent y."""
    size = abs(x)
    if not (0.0 < size < math.inf and -math.inf < y < math.inf) or y == 0.0 or size == 1.0:
        return math.pow(x, y)
    if x < 0.0 and y != math.floor(y):
        raise ValueError("math domain error")
    part, k = math.frexp(size)
    upper, lower = _log2(*_near(part, k))
    # Clipped, so that the product with a huge exponent does not overflow.
    z, low = _product(upper, lower, max(-_LARGE, min(y, _LARGE)))
    value = _power_of_2(z, low)
    return -value if x < 0.0 and y % 2.0 != 0.0 else value


def _near(part: float, k: int) -> tuple[float, float, float]:
    """X / 2^k, which is near 1 or 1.5; the nearer of these; and k."""
    x = 2.0 * part
    if x < _ROOT_1:
        return x, 1.0, k - 1.0
    if x < _ROOT_2:
        return x, 1.5, k - 1.0
    return part, 1.0, float(k)


def _power_of_2(z: float, low: float) -> float:
    total = z + low
    if total >= 1024.5:
        raise OverflowError("math range error")
    if total < -1080.0:
        return 0.0
    k = round(total)
    return math.ldexp(_power_kernel(z - k, low), k)


def power_many(x: Numbers, y: Numbers) -> Numbers:
    """`power` of each."""
    size = np.abs(x)
    usual = (size > 0.0) & (size < np.inf) & np.isfinite(y) & (y != 0.0) & (size != 1.0)
    # Other elements are replaced by 2 to the power of 1, and left to numpy below.
    value = _all_powers(np.where(usual, size, 2.0), np.where(usual, y, 1.0))
    # A negative base has the sign of an odd exponent; with a fraction there is no real power.
    value = np.where((x < 0.0) & (y % 2.0 != 0.0), -value, value)
    value = np.where((x < 0.0) & (y != np.floor(y)), np.nan, value)
    if usual.all():
        return value
    return np.where(usual, value, np.power(np.where(usual, 1.0, x), np.where(usual, 1.0, y)))


def _all_powers(size: Numbers, y: Numbers) -> Numbers:
    part, k = np.frexp(size)
    x = 2.0 * part
    beyond = x >= _ROOT_2
    base = np.where((x >= _ROOT_1) & ~beyond, 1.5, 1.0)
    upper, lower = _log2(np.where(beyond, part, x), base, np.where(beyond, k, k - 1.0))
    z, low = _product(upper, lower, np.clip(y, -_LARGE, _LARGE))
    total = z + low
    near = np.clip(np.rint(total), -1081.0, 1025.0)
    value = np.ldexp(_power_kernel(z - near, low), near.astype(np.int32))
    return np.where(total >= 1024.5, np.inf, np.where(total < -1080.0, 0.0, value))


def _log2(x: F, base: F, k: F) -> tuple[F, F]:
    """The logarithm to base 2 of 2^k x, x being near a base of 1 or 1.5, as a sum of two."""
    u = x - base
    v = 1.0 / (x + base)
    s = u * v
    # s is u/(x + base) as a sum of two: the heads have exact products.
    s_upper = head(s)
    t_upper = head(x + base)
    t_lower = x - (t_upper - base)
    s_lower = v * ((u - s_upper * t_upper) - s_upper * t_lower)
    square = s * s
    r = square * square * (
        5.99999999999994648725e-01
        + square
        * (
            4.28571428578550184252e-01
            + square
            * (
                3.33333329818377432918e-01
                + square
                * (
                    2.72728123808534006489e-01
                    + square * (2.30660745775561754067e-01 + square * 2.06975017800338417784e-01)
                )
            )
        )
    ) + s_lower * (s_upper + s)
    # From here on 3 + s² + r, whose upper part is exact, times s.
    square = s_upper * s_upper
    t_upper = head(3.0 + square + r)
    t_lower = r - ((t_upper - 3.0) - square)
    u = s_upper * t_upper
    v = s_lower * t_upper + t_lower * s
    upper = head(u + v)
    lower = v - (upper - u)
    z_upper = _SCALE_UPPER * upper
    which = 2.0 * (base - 1.0)
    z_lower = _SCALE_LOWER * upper + lower * _SCALE + which * _LOG2_LOWER
    base_log = which * _LOG2_UPPER
    total = head(((z_upper + z_lower) + base_log) + k)
    return total, z_lower - (((total - k) - base_log) - z_upper)


def _product(upper: F, lower: F, y: F) -> tuple[F, F]:
    # The product of the two heads is exact.
    y_upper = head(y)
    return y_upper * upper, (y - y_upper) * upper + y * lower


def _power_kernel(z: F, low: F) -> F:
    """2 to the power of z + low, which is at most about 0.5."""
    t = head(low + z)
    u = t * _LN2_UPPER
    v = (low - (t - z)) * _LN2 + t * _LN2_LOWER
    z = u + v
    w = v - (z - u)
    c = exp_series(z)
    r = (z * c) / (c - 2.0) - (w + z * w)
    return 1.0 - (r - z)


power = binary(power_one, power_many)
