"""The exponential function, the hyperbolic tangent and powers.

An exponent is split into k ln 2 and a rest of at most half of ln 2. Method and coefficients: fdlibm
(Sun Microsystems, 1993), e_exp, s_expm1, s_tanh and e_pow.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from minerva_bus.portable.forms import F, Numbers, unary
from minerva_bus.portable.logarithms import LN2, LN2_LOW

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
