"""Logarithms.

A number is 2^k (1 + f) with 1 + f near 1; a polynomial in f / (2 + f) gives its logarithm. Method
and coefficients: fdlibm (Sun Microsystems, 1993), e_log, s_log1p and, for other bases, k_log of
FreeBSD's msun.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from minerva_bus.portable.polynomials import F, Numbers, head, unary

LN2: Final = 6.93147180369123816490e-01  # ln 2 as a sum of two; its products with k are exact
LN2_LOW: Final = 1.90821492927058770002e-10
_LEAST: Final = float.fromhex("0x1.6a09ep-1")  # about √½; 1 + f is from here to twice this
_LEAST_BITS: Final = int(np.float64(_LEAST).view(np.int64))
_MANTISSA: Final = (1 << 52) - 1
_NORMAL: Final = 2.0**-1022
_UP: Final = 2.0**54

_PER_LN2: Final = 1.44269504072144627571e00  # 1/ln 2 as a sum of two
_PER_LN2_LOW: Final = 1.67517131648865118353e-10
_PER_LN10: Final = 4.34294481878168880939e-01  # 1/ln 10
_PER_LN10_LOW: Final = 2.50829467116452752298e-11
_LOG10_2: Final = 3.01029995663611771306e-01
_LOG10_2_LOW: Final = 3.69423907715893078616e-13


def log_one(x: float) -> float:
    """The natural logarithm of a number above 0."""
    if not 0.0 < x < math.inf:
        return _unusual(x)
    return log_kernel(*parts(x))


def log2_one(x: float) -> float:
    """The logarithm to base 2 of a number above 0."""
    if not 0.0 < x < math.inf:
        return _unusual(x)
    return _log2_kernel(*parts(x))


def log10_one(x: float) -> float:
    """The logarithm to base 10 of a number above 0."""
    if not 0.0 < x < math.inf:
        return _unusual(x)
    return _log10_kernel(*parts(x))


def log1p_one(x: float) -> float:
    """The natural logarithm of 1 + x, accurate also for small x."""
    if not -1.0 < x < math.inf:
        return _unusual(1.0 + x)
    if x == 0.0:
        return x
    u = 1.0 + x
    k, f = parts(u)
    # x itself, because f of 1 + x has lost digits of a small x.
    if k == 0.0:
        return _log1p_kernel(0.0, x, 0.0)
    # What rounding 1 + x has lost, as a correction of the logarithm.
    lost = 1.0 - (u - x) if k > 1.0 else x - (u - 1.0)
    return _log1p_kernel(k, f, lost / u)


def _unusual(x: float) -> float:
    if x <= 0.0:
        raise ValueError("math domain error")
    return x  # infinity and nan


def parts(x: float) -> tuple[float, float]:
    """The k and f of 2^k (1 + f), for a number above 0."""
    # frexp gives a part from ½ to 1; below √½ it is doubled, so that 1 + f is near 1.
    part, k = math.frexp(x)
    if part < _LEAST:
        return k - 1.0, 2.0 * part - 1.0
    return float(k), part - 1.0


def all_parts(x: Numbers) -> tuple[Numbers, Numbers]:
    """The k and f of each normal number above 0."""
    bits = x.view(np.int64)
    # As an integer, the bits less those of √½: the exponent is k, and the mantissa, added to the
    # bits of √½ again, gives 1 + f.
    over = bits - _LEAST_BITS
    f = ((over & _MANTISSA) + _LEAST_BITS).view(np.float64) - 1.0
    return (over >> 52).astype(np.float64), f


def log_many(x: Numbers) -> Numbers:
    """`log` of each."""
    return _usual(x, log_kernel)


def log2_many(x: Numbers) -> Numbers:
    """`log2` of each."""
    return _usual(x, _log2_kernel)


def log10_many(x: Numbers) -> Numbers:
    """`log10` of each."""
    return _usual(x, _log10_kernel)


def log1p_many(x: Numbers) -> Numbers:
    """`log1p` of each."""
    fine = (x > -1.0) & (x < np.inf)
    if fine.all():
        return _all_log1p(x)
    return np.where(fine, _all_log1p(np.where(fine, x, 0.0)), _unusual_many(1.0 + x))


def _all_log1p(x: Numbers) -> Numbers:
    u = 1.0 + x
    k, f = all_parts(u)
    lost = np.where(k > 1.0, 1.0 - (u - x), x - (u - 1.0))
    small = k == 0.0
    made = _log1p_kernel(k, np.where(small, x, f), np.where(small, 0.0, lost / u))
    return np.where(x == 0.0, x, made)


def _usual(x: Numbers, kernel: Callable[[Numbers, Numbers], Numbers]) -> Numbers:
    """A kernel applied to numbers above 0; -inf for 0, and nan for numbers below it."""
    fine = (x >= _NORMAL) & (x < np.inf)
    if fine.all():
        return kernel(*all_parts(x))
    small = (x > 0.0) & (x < _NORMAL)
    # Denormal numbers are scaled to normal ones, which is exact; others are replaced by any valid
    # one.
    k, f = all_parts(np.where(fine, x, np.where(small, x * _UP, 1.0)))
    made = kernel(np.where(small, k - 54.0, k), f)
    return np.where(fine | small, made, _unusual_many(x))


def _unusual_many(x: Numbers) -> Numbers:
    """The logarithms of 0, infinity, nan and numbers below 0."""
    return np.where(x == 0.0, -np.inf, np.where(x < 0.0, np.nan, x))


def series(f: F) -> F:
    """The logarithm of 1 + f, minus f - f²/2."""
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (
        3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01)
    )
    odd = z * (
        6.666666666666735130e-01
        + w
        * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    return s * (0.5 * f * f + (odd + even))


def log_kernel(k: F, f: F) -> F:
    """The natural logarithm of 2^k (1 + f)."""
    return series(f) + k * LN2_LOW - 0.5 * f * f + f + k * LN2


def _log1p_kernel(k: F, f: F, lost: F) -> F:
    return series(f) + (k * LN2_LOW + lost) - 0.5 * f * f + f + k * LN2


def _halves(f: F) -> tuple[F, F]:
    """The logarithm of 1 + f as a sum of two numbers, the first with 21 bits."""
    half = 0.5 * f * f
    upper = head(f - half)
    return upper, (f - upper) - half + series(f)


def _log2_kernel(k: F, f: F) -> F:
    upper, lower = _halves(f)
    value = upper * _PER_LN2
    low = (lower + upper) * _PER_LN2_LOW + lower * _PER_LN2
    total = k + value
    return (low + ((k - total) + value)) + total


def _log10_kernel(k: F, f: F) -> F:
    upper, lower = _halves(f)
    value = upper * _PER_LN10
    whole = k * _LOG10_2
    low = k * _LOG10_2_LOW + (lower + upper) * _PER_LN10_LOW + lower * _PER_LN10
    total = whole + value
    return (low + ((whole - total) + value)) + total


log = unary(log_one, log_many)
log2 = unary(log2_one, log2_many)
log10 = unary(log10_one, log10_many)
log1p = unary(log1p_one, log1p_many)
