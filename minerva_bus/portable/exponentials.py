"""The exponential function, the hyperbolic tangent and powers.

An exponent is split into k ln 2 and a rest of at most half of ln 2. A power is the logarithm to
base 2 of x as a sum of two numbers, its product with y, and 2 to the power of the product. Method
and coefficients: fdlibm (Sun Microsystems, 1993), e_exp, s_expm1, s_tanh and e_pow. Powers of 0,
infinity and nan (C standard, annex F) are exact in every library, so Python and numpy do them.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from minerva_bus.portable.logarithms import LN2, LN2_LOW
from minerva_bus.portable.polynomials import F, Numbers, binary, head, unary

_PER_LN2: Final = 1.44269504088896338700e00
_MOST: Final = 709.782712893384  # above, the result overflows
_LEAST: Final = -745.1332191019412  # below, it is less than half of the smallest number
_NOTHING: Final = -40.0  # e to the power of this, minus 1, rounds to -1
_ONE: Final = 22.0  # from here on the hyperbolic tangent is 1


def exp_one(x: float) -> float:
    """The exponential function, e to the power of x."""
    if not _LEAST <= x <= _MOST:
        return _far(x)
    k = round(x * _PER_LN2)
    return math.ldexp(_exp_kernel(x, float(k)), k)


def expm1_one(x: float) -> float:
    """The exponential of x, minus 1; accurate for small x, too."""
    if not _NOTHING <= x <= _MOST:
        return -1.0 if x < 0.0 else _far(x)
    k = round(x * _PER_LN2)
    rest, less = _expm1_rest(x, float(k))
    if k == 0:
        return rest - less
    if k == 1:
        return 1.0 + 2.0 * (rest - less) if rest >= -0.25 else -2.0 * (less - (rest + 0.5))
    if k == -1:
        return 0.5 * (rest - less) - 0.5
    return _scaled(rest, less, k)


def tanh_one(x: float) -> float:
    """The hyperbolic tangent."""
    size = abs(x)
    if size >= _ONE:
        return math.copysign(1.0, x)
    if size > 0.5493061443340549:
        value = 1.0 - 2.0 / (expm1_one(2.0 * size) + 2.0)
    elif size > 0.25541281188299536:
        power = expm1_one(2.0 * size)
        value = power / (power + 2.0)
    else:
        power = expm1_one(-2.0 * size)
        value = -power / (power + 2.0)
    return math.copysign(value, x)


def _far(x: float) -> float:
    if x < 0.0:
        return 0.0
    if x < math.inf:
        raise OverflowError("math range error")
    return x  # infinity and nan


def _scaled(rest: float, less: float, k: int) -> float:
    """(1 + rest - less) 2^k - 1."""
    if k < -1 or k > 56:
        # In two factors, because 2^1024 alone would overflow.
        return 2.0 * math.ldexp(1.0 - (less - rest), k - 1) - 1.0
    tiny = math.ldexp(1.0, -k)
    if k < 20:
        return math.ldexp((1.0 - tiny) - (less - rest), k)
    return math.ldexp((rest - (less + tiny)) + 1.0, k)


def exp_many(x: Numbers) -> Numbers:
    """`exp` of each."""
    near = np.clip(x, _LEAST, _MOST)
    k = np.rint(near * _PER_LN2)
    made = _raised(_exp_kernel(near, k), k)
    if (near == x).all():
        return made
    return np.where(x > _MOST, np.inf, np.where(x < _LEAST, 0.0, np.where(x == x, made, x)))


def expm1_many(x: Numbers) -> Numbers:
    """`expm1` of each."""
    near = np.clip(x, _NOTHING, _MOST)
    k = np.rint(near * _PER_LN2) + 0.0  # turns -0.0 into 0.0, which keeps the sign of x
    rest, less = _expm1_rest(near, k)
    tiny = _raised(np.ones(len(k)), -np.clip(k, 0.0, 1000.0))
    far = 2.0 * _raised(1.0 - (less - rest), k - 1.0) - 1.0
    medium = _raised((1.0 - tiny) - (less - rest), k)
    large = _raised((rest - (less + tiny)) + 1.0, k)
    made = np.where((k < -1.0) | (k > 56.0), far, np.where(k < 20.0, medium, large))
    above, below = 1.0 + 2.0 * (rest - less), -2.0 * (less - (rest + 0.5))
    made = np.where(k == 1.0, np.where(rest >= -0.25, above, below), made)
    made = np.where(k == -1.0, 0.5 * (rest - less) - 0.5, made)
    made = np.where(k == 0.0, rest - less, made)
    made = np.where(x > _MOST, np.inf, made)
    return np.where(x < _NOTHING, -1.0, np.where(x == x, made, x))


def tanh_many(x: Numbers) -> Numbers:
    """`tanh` of each."""
    # Bounded, because e to the power of large arguments is infinite.
    size = np.minimum(np.abs(x), _ONE)
    large = size > 0.25541281188299536
    power = expm1_many(np.where(large, 2.0, -2.0) * size)
    ratio = power / (power + 2.0)
    value = np.where(large, ratio, -ratio)
    value = np.where(size > 0.5493061443340549, 1.0 - 2.0 / (power + 2.0), value)
    return np.copysign(np.where(size >= _ONE, 1.0, value), x)


def _raised(x: Numbers, k: Numbers) -> Numbers:
    """X 2^k, for whole k."""
    return np.ldexp(x, k.astype(np.int32))


def _reduced(x: F, k: F) -> tuple[F, F]:
    return x - k * LN2, k * LN2_LOW


def _exp_kernel(x: F, k: F) -> F:
    """E to the power of x, divided by 2^k."""
    upper, lower = _reduced(x, k)
    r = upper - lower
    c = exp_series(r)
    return 1.0 + (r * c / (2.0 - c) - lower + upper)


def exp_series(r: F) -> F:
    """C = r - r² P(r²), so that e to the power of r is 1 + r + r c / (2 - c); fdlibm's e_exp."""
    t = r * r
    return r - t * (
        1.66666666666666019037e-01
        + t
        * (
            -2.77777777770155933842e-03
            + t
            * (
                6.61375632143793436117e-05
                + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08)
            )
        )
    )


def _expm1_rest(x: F, k: F) -> tuple[F, F]:
    """Two numbers whose difference is e to the power of x, divided by 2^k, minus 1."""
    upper, lower = _reduced(x, k)
    r = upper - lower
    # The rounding error of r.
    lost = (upper - r) - lower
    half = 0.5 * r
    square = r * half
    p = 1.0 + square * (
        -3.33333333333331316428e-02
        + square
        * (
            1.58730158725481460165e-03
            + square
            * (
                -7.93650757867487942473e-05
                + square * (4.00821782732936239552e-06 + square * -2.01099218183624371326e-07)
            )
        )
    )
    t = 3.0 - p * half
    e = square * ((p - t) / (6.0 - r * t))
    return r, (r * (e - lost) - lost) - square


exp = unary(exp_one, exp_many)
expm1 = unary(expm1_one, expm1_many)
tanh = unary(tanh_one, tanh_many)


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
