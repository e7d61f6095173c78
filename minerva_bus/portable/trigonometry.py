"""Sine, cosine, tangent, their inverses, and lengths: square roots of sums of squares.

The angle is reduced to at most π/4 and a quadrant, by parts of π/2 whose products are exact, and
held as a sum of two numbers, which polynomials evaluate. Method and coefficients: fdlibm (Sun
Microsystems, 1993), k_sin, k_cos, k_tan, e_rem_pio2, s_atan, e_atan2, e_asin and e_acos. Huge
angles are reduced exactly, with as many digits of 2/π as they need: M. Payne and R. Hanek, Radian
reduction for trigonometric functions (1983).

IEEE 754 defines the square root to the last bit. Numbers whose squares would be too large or too
small are first scaled by a power of 2, which is exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from minerva_bus.portable.polynomials import Bits, F, Numbers, binary, head, twofold, unary

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

_RIGHT_ANGLE: Final = 1.57079632679489655800e00  # π/2 as a sum of two
_RIGHT_ANGLE_LOW: Final = 6.12323399573676603587e-17


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
    y = upper * _RIGHT_ANGLE
    low = _lost(upper, _RIGHT_ANGLE, y) + (upper * _RIGHT_ANGLE_LOW + lower * _RIGHT_ANGLE)
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


_HUGE: Final = 2.0**66  # from here on, the arc tangent rounds to π/2

_BORDERS: Final = (0.4375, 0.6875, 1.1875, 2.4375)
_FRACTIONS: Final = (  # arctan x = upper + lower + arctan((a x - b) / (c + d x)), up to each border
    (1.0, 0.0, 1.0, 0.0, 0.0, 0.0),
    (2.0, 1.0, 2.0, 1.0, 4.63647609000806093515e-01, 2.26987774529616870924e-17),
    (1.0, 1.0, 1.0, 1.0, 7.85398163397448278999e-01, 3.06161699786838301793e-17),
    (1.0, 1.5, 1.0, 1.5, 9.82793723247329054082e-01, 1.39033110312309984516e-17),
    (0.0, 1.0, 0.0, 1.0, 1.57079632679489655800e00, 6.12323399573676603587e-17),
)
_TABLE: Final = np.array(_FRACTIONS).T.copy()


def atan_one(x: float) -> float:
    """The arc tangent in radians, from -π/2 to π/2."""
    # Bounded, because 0 times infinity below would be nan; nan itself stays nan.
    size = min(abs(x), _HUGE) if x == x else x
    place = 0
    for border in _BORDERS:
        if size >= border:
            place += 1
    a, b, c, d, upper, lower = _FRACTIONS[place]
    return math.copysign(_atan_kernel((a * size - b) / (c + d * size), upper, lower), x)


def atan2_one(y: float, x: float) -> float:
    """The direction of (x, y) in radians, from -π to π."""
    if x != x or y != y:
        return x + y
    tall, wide = abs(y), abs(x)
    # A diagonal, as the C standard prescribes; the quotient would be nan.
    if tall == math.inf and wide == math.inf:
        tall = wide = 1.0
    # The angle is 0 or π, as the C standard prescribes, and depends on the signs only.
    if tall == 0.0 and wide == 0.0:
        wide = 1.0
    angle = _RIGHT_ANGLE if wide == 0.0 else atan_one(tall / wide)
    # -0.0 counts as negative.
    if math.copysign(1.0, x) < 0.0:
        angle = _turned(angle)
    return math.copysign(angle, y)


def asin_one(x: float) -> float:
    """The arc sine in radians, from -π/2 to π/2."""
    size = abs(x)
    if size > 1.0:
        raise ValueError("math domain error")
    if size < 0.5:
        return _asin_small(x, x * x)
    if size == 1.0:
        return math.copysign(_RIGHT_ANGLE, x)
    z = 0.5 * (1.0 - size)
    return math.copysign(_asin_large(z, math.sqrt(z)), x)


def acos_one(x: float) -> float:
    """The arc cosine in radians, from 0 to π."""
    size = abs(x)
    if size > 1.0:
        raise ValueError("math domain error")
    if size < 0.5:
        return _acos_small(x, x * x)
    if size == 1.0:
        return 0.0 if x > 0.0 else 2.0 * _RIGHT_ANGLE
    z = 0.5 * (1.0 - size)
    root = math.sqrt(z)
    return _acos_near(z, root) if x > 0.0 else _acos_far(z, root)


def atan_many(x: Numbers) -> Numbers:
    """`atan` of each."""
    size = np.minimum(np.abs(x), _HUGE)
    # nan sorts behind all borders and is limited to the last row.
    place = np.searchsorted(_BORDERS, size, "right")
    a, b, c, d, upper, lower = _TABLE[:, np.minimum(place, 4)]
    made = _atan_kernel((a * size - b) / (c + d * size), upper, lower)
    return np.copysign(made, x)


def atan2_many(y: Numbers, x: Numbers) -> Numbers:
    """`atan2` of each."""
    tall, wide = np.abs(y), np.abs(x)
    # The two special cases of `atan2_one`.
    same = (tall == wide) & ((tall == 0.0) | (tall == np.inf))
    if same.any():
        tall, wide = np.where(same, tall == np.inf, tall), np.where(same, 1.0, wide)
    angle = atan_many(tall / wide)
    angle = np.where(np.copysign(1.0, x) < 0.0, _turned(angle), angle)
    return np.where(np.isnan(x), x, np.copysign(angle, y))


def asin_many(x: Numbers) -> Numbers:
    """`asin` of each."""
    size = np.abs(x)
    z = np.where(size < 0.5, 0.0, 0.5 * (1.0 - size))
    large = np.where(size == 1.0, _RIGHT_ANGLE, _asin_large(z, np.sqrt(z)))
    large = np.copysign(large, x)
    # Both branches are computed for every element, and the right one is taken.
    return np.where(size < 0.5, _asin_small(x, x * x), large)


def acos_many(x: Numbers) -> Numbers:
    """`acos` of each."""
    size = np.abs(x)
    z = np.where(size < 0.5, 0.25, 0.5 * (1.0 - size))
    root = np.sqrt(z)
    large = np.where(x > 0.0, _acos_near(z, root), _acos_far(z, root))
    large = np.where(size == 1.0, np.where(x > 0.0, 0.0, 2.0 * _RIGHT_ANGLE), large)
    return np.where(size < 0.5, _acos_small(x, x * x), large)


def _turned(angle: F) -> F:
    """π - angle."""
    return 2.0 * _RIGHT_ANGLE - (angle - 2.0 * _RIGHT_ANGLE_LOW)


def _atan_kernel(x: F, upper: F, lower: F) -> F:
    z = x * x
    w = z * z
    # Even and odd terms apart, as in fdlibm: another order would round differently.
    even = z * (
        3.33333333333329318027e-01
        + w
        * (
            1.42857142725034663711e-01
            + w
            * (
                9.09088713343650656196e-02
                + w
                * (
                    6.66107313738753120669e-02
                    + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)
                )
            )
        )
    )
    odd = w * (
        -1.99999999998764832476e-01
        + w
        * (
            -1.11111104054623557880e-01
            + w
            * (
                -7.69187620504482999495e-02
                + w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02)
            )
        )
    )
    return upper - ((x * (even + odd) - lower) - x)


def _ratio(z: F) -> F:
    """(arcsin √z - √z) / √z."""
    p = z * (
        1.66666666666666657415e-01
        + z
        * (
            -3.25565818622400915405e-01
            + z
            * (
                2.01212532134862925881e-01
                + z
                * (
                    -4.00555345006794114027e-02
                    + z * (7.91534994289814532176e-04 + z * 3.47933107596021167570e-05)
                )
            )
        )
    )
    q = 1.0 + z * (
        -2.40339491173441421878e00
        + z
        * (
            2.02094576023350569471e00
            + z * (-6.88283971605453293030e-01 + z * 7.70381505559019352791e-02)
        )
    )
    return p / q


def _asin_small(x: F, z: F) -> F:
    return x + x * _ratio(z)


def _asin_large(z: F, root: F) -> F:
    """The arc sine of 1 - 2 z."""
    # The square of `upper` is exact, so `lost` is the rest of the root to full precision.
    upper = head(root)
    lost = (z - upper * upper) / (root + upper)
    quarter = 0.5 * _RIGHT_ANGLE
    p = 2.0 * root * _ratio(z) - (_RIGHT_ANGLE_LOW - 2.0 * lost)
    return quarter - (p - (quarter - 2.0 * upper))


def _acos_small(x: F, z: F) -> F:
    return _RIGHT_ANGLE - (x - (_RIGHT_ANGLE_LOW - x * _ratio(z)))


def _acos_near(z: F, root: F) -> F:
    """The arc cosine of 1 - 2 z."""
    upper = head(root)
    lost = (z - upper * upper) / (root + upper)
    return 2.0 * (upper + (_ratio(z) * root + lost))


def _acos_far(z: F, root: F) -> F:
    """The arc cosine of 2 z - 1."""
    return 2.0 * (_RIGHT_ANGLE - (root + (_ratio(z) * root - _RIGHT_ANGLE_LOW)))


asin = unary(asin_one, asin_many)
acos = unary(acos_one, acos_many)
atan = unary(atan_one, atan_many)
atan2 = binary(atan2_one, atan2_many)


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
