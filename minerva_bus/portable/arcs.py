"""Inverse trigonometric functions.

Method and coefficients: fdlibm (Sun Microsystems, 1993), s_atan, e_atan2, e_asin and e_acos.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from minerva_bus.portable.forms import F, Numbers, binary, head, unary

_HALF: Final = 1.57079632679489655800e00  # π/2 as a sum of two
_HALF_LOW: Final = 6.12323399573676603587e-17
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
    angle = _HALF if wide == 0.0 else atan_one(tall / wide)
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
        return math.copysign(_HALF, x)
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
        return 0.0 if x > 0.0 else 2.0 * _HALF
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
    large = np.where(size == 1.0, _HALF, _asin_large(z, np.sqrt(z)))
    large = np.copysign(large, x)
    # Both branches are computed for every element, and the right one is taken.
    return np.where(size < 0.5, _asin_small(x, x * x), large)


def acos_many(x: Numbers) -> Numbers:
    """`acos` of each."""
    size = np.abs(x)
    z = np.where(size < 0.5, 0.25, 0.5 * (1.0 - size))
    root = np.sqrt(z)
    large = np.where(x > 0.0, _acos_near(z, root), _acos_far(z, root))
    large = np.where(size == 1.0, np.where(x > 0.0, 0.0, 2.0 * _HALF), large)
    return np.where(size < 0.5, _acos_small(x, x * x), large)


def _turned(angle: F) -> F:
    """π - angle."""
    return 2.0 * _HALF - (angle - 2.0 * _HALF_LOW)


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
    quarter = 0.5 * _HALF
    p = 2.0 * root * _ratio(z) - (_HALF_LOW - 2.0 * lost)
    return quarter - (p - (quarter - 2.0 * upper))


def _acos_small(x: F, z: F) -> F:
    return _HALF - (x - (_HALF_LOW - x * _ratio(z)))


def _acos_near(z: F, root: F) -> F:
    """The arc cosine of 1 - 2 z."""
    upper = head(root)
    lost = (z - upper * upper) / (root + upper)
    return 2.0 * (upper + (_ratio(z) * root + lost))


def _acos_far(z: F, root: F) -> F:
    """The arc cosine of 2 z - 1."""
    return 2.0 * (_HALF - (root + (_ratio(z) * root - _HALF_LOW)))


asin = unary(asin_one, asin_many)
acos = unary(acos_one, acos_many)
atan = unary(atan_one, atan_many)
atan2 = binary(atan2_one, atan2_many)
