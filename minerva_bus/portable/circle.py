"""Sine, cosine and tangent.

The angle is reduced to at most π/4 and a quadrant, by parts of π/2 whose products are exact, and
held as a sum of two numbers, which polynomials evaluate. Method and coefficients: fdlibm (Sun
Microsystems, 1993), k_sin, k_cos, k_tan and e_rem_pio2.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from minerva_bus.portable.far import far
from minerva_bus.portable.forms import Bits, F, Numbers, head, twofold, unary

_PER_QUARTER: Final = 6.36619772367581382433e-01  # 2/π
_PART_1: Final = 1.57079632673412561417e00  # π/2 in three parts of 33 bits and the rest
_PART_2: Final = 6.07710050630396597660e-11
_PART_3: Final = 2.02226624871116645580e-21
_REST: Final = 8.47842766036889956997e-32
_NEAR: Final = 1.6e6
"""Below this angle, the number of quarter turns has at most 20 bits."""

_QUARTER: Final = 7.85398163397448278999e-01  # π/4 as a sum of two
_QUARTER_LOW: Final = 3.06161699786838301793e-17
_STEEP: Final = 0.67434


def sin_one(x: float) -> float:
    """The sine of an angle in radians."""
    quarter, y, low = _reduced(x)
    # Odd quarter turns exchange sine and cosine; two of them change the sign.
    value = cos_kernel(y, low) if quarter & 1 else sin_kernel(y, low)
    return -value if quarter & 2 else value


def cos_one(x: float) -> float:
    """The cosine of an angle in radians."""
    quarter, y, low = _reduced(x)
    value = sin_kernel(y, low) if quarter & 1 else cos_kernel(y, low)
    return -value if (quarter + 1) & 2 else value


def cos_sin_one(x: float) -> tuple[float, float]:
    """The cosine and the sine of an angle in radians."""
    quarter, y, low = _reduced(x)
    cos, sin = cos_kernel(y, low), sin_kernel(y, low)
    if quarter & 1:
        cos, sin = sin, cos
    return -cos if (quarter + 1) & 2 else cos, -sin if quarter & 2 else sin


def tan_one(x: float) -> float:
    """The tangent of an angle in radians."""
    quarter, y, low = _reduced(x)
    # The sign of -0.0 remains.
    if y == 0.0:
        return y
    if abs(y) >= _STEEP:
        return _steep_tan(y, low, -1.0 if y < 0.0 else 1.0, 1.0 - 2.0 * (quarter & 1))
    rest = _tan_rest(y, low)
    return _minus_inverse(y, rest) if quarter & 1 else y + rest


def cos_turns_one(turns: float) -> float:
    """The cosine of an angle in whole turns, from 0 to 1."""
    quarter = round(4.0 * turns)
    # The difference is exact, so the reduction needs no parts of π/2.
    y = (turns - 0.25 * quarter) * math.tau
    value = sin_kernel(y, 0.0) if quarter & 1 else cos_kernel(y, 0.0)
    return -value if (quarter + 1) & 2 else value


def _reduced(x: float) -> tuple[int, float, float]:
    if not -_NEAR < x < _NEAR:
        if math.isinf(x):
            raise ValueError("math domain error")
        return (0, x, 0.0) if x != x else far(x)
    quarter = round(x * _PER_QUARTER)
    y, low = _less(x, float(quarter))
    return quarter, y, low


def sin_many(x: Numbers) -> Numbers:
    """`sin` of each."""
    quarters, y, low = _all_reduced(x)
    return _by_quarter(quarters, sin_kernel(y, low), cos_kernel(y, low))


def cos_many(x: Numbers) -> Numbers:
    """`cos` of each."""
    quarters, y, low = _all_reduced(x)
    return _by_quarter(quarters + 1, sin_kernel(y, low), cos_kernel(y, low))


def cos_sin_many(x: Numbers) -> tuple[Numbers, Numbers]:
    """`cos_sin` of each."""
    quarters, y, low = _all_reduced(x)
    cos, sin = cos_kernel(y, low), sin_kernel(y, low)
    return _by_quarter(quarters + 1, sin, cos), _by_quarter(quarters, sin, cos)


def tan_many(x: Numbers) -> Numbers:
    """`tan` of each."""
    quarters, y, low = _all_reduced(x)
    odd = quarters & 1
    rest = _tan_rest(y, low)
    # y itself where it is 0, because y + rest would lose the sign of -0.0.
    value = np.where(odd, _minus_inverse(y, rest), np.where(y == 0.0, y, y + rest))
    steep = np.abs(y) >= _STEEP
    if steep.any():
        side = np.where(y < 0.0, -1.0, 1.0)
        value = np.where(steep, _steep_tan(y, low, side, np.where(odd, -1.0, 1.0)), value)
    return value


def cos_turns_many(turns: Numbers) -> Numbers:
    """`cos_turns` of each."""
    quarters = np.rint(4.0 * turns)
    y = (turns - 0.25 * quarters) * math.tau
    low = np.zeros(1)
    return _by_quarter(quarters.astype(np.int64) + 1, sin_kernel(y, low), cos_kernel(y, low))


def _by_quarter(quarters: Bits, sin: Numbers, cos: Numbers) -> Numbers:
    return np.where(quarters & 1, cos, sin) * np.where(quarters & 2, -1.0, 1.0)


def _all_reduced(x: Numbers) -> tuple[Bits, Numbers, Numbers]:
    near = np.abs(x) < _NEAR
    if near.all():
        return _all_near(x)
    quarters, y, low = _all_near(np.where(near, x, 0.0))
    # One by one: angles of more than a million radians are rare.
    for place in np.flatnonzero(~near).tolist():
        angle = x[place].item()
        finite = math.isfinite(angle)
        quarters[place], y[place], low[place] = far(angle) if finite else (0, math.nan, 0.0)
    return quarters, y, low


def _all_near(x: Numbers) -> tuple[Bits, Numbers, Numbers]:
    quarters = np.rint(x * _PER_QUARTER) + 0.0  # turns -0.0 into 0.0, which keeps the sign of x
    y, low = _less(x, quarters)
    return quarters.astype(np.int64), y, low


def _less(x: F, quarters: F) -> tuple[F, F]:
    """An angle minus some quarter turns, as a sum of two numbers."""
    # fdlibm uses the further parts only after cancellation. Here they are always used, so that
    # numbers and arrays take the same steps.
    first = x - quarters * _PART_1
    part = quarters * _PART_2
    second = first - part
    lost = (first - second) - part
    part = quarters * _PART_3
    third = second - part
    rest = (quarters * _REST - ((second - third) - part)) - lost
    y = third - rest
    return y, (third - y) - rest


def sin_kernel(x: F, low: F) -> F:
    """The sine of x + low, at most π/4."""
    z = x * x
    r = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z
        * (
            2.75573137070700676789e-06
            + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
        )
    )
    v = z * x
    return x - ((z * (0.5 * low - v * r) - low) - v * -1.66666666666666324348e-01)


def cos_kernel(x: F, low: F) -> F:
    """The cosine of x + low, at most π/4."""
    z = x * x
    w = z * z
    r = z * (
        4.16666666666666019037e-02
        + z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05)
    ) + w * w * (
        -2.75573143513906633035e-07
        + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    )
    half = 0.5 * z
    w = 1.0 - half
    return w + (((1.0 - w) - half) + (z * r - x * low))


def _tan_rest(x: F, low: F) -> F:
    """The tangent of x + low, less x."""
    z = x * x
    w = z * z
    r = 1.33333333333201242699e-01 + w * (
        2.18694882948595424599e-02
        + w
        * (
            3.59207910759131235356e-03
            + w
            * (
                5.88041240820264096874e-04
                + w * (7.81794442939557092300e-05 + w * -1.85586374855275456654e-05)
            )
        )
    )
    v = z * (
        5.39682539762260521377e-02
        + w
        * (
            8.86323982359930005737e-03
            + w
            * (
                1.45620945432529025516e-03
                + w
                * (
                    2.46463134818469906812e-04
                    + w * (7.14072491382608190305e-05 + w * 2.59073051863633712884e-05)
                )
            )
        )
    )
    s = z * x
    return low + z * (s * (r + v) + low) + s * 3.33333333333334091986e-01


def _steep_tan(x: F, low: F, side: F, sign: F) -> F:
    """The tangent near π/4 on a side (1 or -1); `sign` -1: its negative inverse."""
    y = (_QUARTER - side * x) + (_QUARTER_LOW - side * low)
    rest = _tan_rest(y, y - y)
    w = y + rest
    return side * (sign - 2.0 * (y + (rest - w * w / (w + sign))))


def _minus_inverse(x: F, rest: F) -> F:
    w = x + rest
    upper = head(w)
    lower = rest - (upper - x)
    a = -1.0 / w
    b = head(a)
    return b + a * (1.0 + b * upper + b * lower)


sin = unary(sin_one, sin_many)
cos = unary(cos_one, cos_many)
cos_sin = twofold(cos_sin_one, cos_sin_many)
tan = unary(tan_one, tan_many)
