"""Mathematical functions and draws that generated kernels call, compiled by numba.

Faults are those of `library`, which has arithmetic. `portable` and the draws are compiled from
their own source.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from minerva_bus.portable import (
    distributions,
    exponentials,
    lengths,
    logarithms,
    trigonometry,
)
from minerva_fast.compiled.library import compiled
from minerva_fast.compiled.sources import PortableForms


def _of_math(function: Any) -> Any:
    """A function of `math`; a result or argument that is not finite is a fault."""

    @compiled
    def call(state: Any, number: float) -> float:
        # Outside its domain Python raises an error, where the C library returns nan or infinity.
        result = function(number) if math.isfinite(number) else math.nan
        if not math.isfinite(result):
            state[0] = 1.0
            return 0.0
        return result

    return call


@compiled
def math_sqrt(state: Any, number: float) -> float:
    """`math.sqrt(number)`."""
    if not 0.0 <= number < math.inf:
        state[0] = 1.0
        return 0.0
    return math.sqrt(number)


math_acos = _of_math(math.acos)


math_asin = _of_math(math.asin)


math_atan = _of_math(math.atan)


math_cos = _of_math(math.cos)


math_cosh = _of_math(math.cosh)


math_exp = _of_math(math.exp)


math_expm1 = _of_math(math.expm1)


math_log = _of_math(math.log)


math_log10 = _of_math(math.log10)


math_log1p = _of_math(math.log1p)


math_sin = _of_math(math.sin)


math_sinh = _of_math(math.sinh)


math_tan = _of_math(math.tan)


math_tanh = _of_math(math.tanh)


@compiled
def math_atan2(state: Any, y: float, x: float) -> float:
    """`math.atan2(y, x)`."""
    if not (math.isfinite(x) and math.isfinite(y)):
        state[0] = 1.0
        return 0.0
    return math.atan2(y, x)


@compiled
def math_fmod(state: Any, x: float, y: float) -> float:
    """`math.fmod(x, y)`."""
    if y == 0.0 or not (math.isfinite(x) and math.isfinite(y)):
        state[0] = 1.0
        return 0.0
    return np.fmod(x, y)


def _never(x: float) -> tuple[int, float, float]:
    """In place of the reduction of huge angles, which needs ints of any length."""
    return 0, x, x


_from_source = PortableForms(compiled, _never).of


def _portable(function: Any, least: float, most: float) -> Any:
    """A function of `portable` for arguments in an open interval; others are faults."""
    inner = _from_source(function)

    @compiled
    def call(state: Any, number: float) -> float:
        if not least < number < most:
            state[0] = 1.0
            return 0.0
        return inner(number)

    return call


_FAR = 1.6e6


_BIG = 1.7e308


_atan2 = _from_source(trigonometry.atan2_one)


_hypot = _from_source(lengths.hypot_one)


_power = _from_source(exponentials.power_one)


_ONE = math.nextafter(1.0, 2.0)


portable_acos = _portable(trigonometry.acos_one, -_ONE, _ONE)


portable_asin = _portable(trigonometry.asin_one, -_ONE, _ONE)


portable_atan = _portable(trigonometry.atan_one, -_BIG, _BIG)


portable_cos = _portable(trigonometry.cos_one, -_FAR, _FAR)


portable_exp = _portable(exponentials.exp_one, -740.0, 709.0)


portable_expm1 = _portable(exponentials.expm1_one, -740.0, 709.0)


portable_log = _portable(logarithms.log_one, 0.0, _BIG)


portable_log10 = _portable(logarithms.log10_one, 0.0, _BIG)


portable_log1p = _portable(logarithms.log1p_one, -1.0, _BIG)


portable_log2 = _portable(logarithms.log2_one, 0.0, _BIG)


portable_sin = _portable(trigonometry.sin_one, -_FAR, _FAR)


portable_tan = _portable(trigonometry.tan_one, -_FAR, _FAR)


portable_tanh = _portable(exponentials.tanh_one, -_BIG, _BIG)


@compiled
def portable_atan2(state: Any, y: float, x: float) -> float:
    """`portable.atan2(y, x)`."""
    if not (math.isfinite(x) and math.isfinite(y)):
        state[0] = 1.0
        return 0.0
    return _atan2(y, x)


@compiled
def portable_hypot(state: Any, x: float, y: float) -> float:
    """`portable.hypot(x, y)`."""
    if not (math.isfinite(x) and math.isfinite(y)):
        state[0] = 1.0
        return 0.0
    return _hypot(x, y)


@compiled
def portable_power(state: Any, base: float, exponent: float) -> float:
    """`portable.power(base, exponent)`, for positive bases and results of usual size."""
    if not (0.0 < base < math.inf and abs(exponent) * abs(math.log(base)) < 700.0):
        state[0] = 1.0
        return 0.0
    return _power(base, exponent)


draw_random = _from_source(distributions.draw_random)


draw_uniform = _from_source(distributions.draw_uniform)


draw_chance = _from_source(distributions.draw_chance)


draw_exponential = _from_source(distributions.draw_exponential)


draw_normal = _from_source(distributions.draw_normal)


_integers = _from_source(distributions.draw_integers)


@compiled
def draw_integers(state: Any, words: Any, i: int, low: int, high: int) -> int:
    """An int in [low, high)."""
    if high <= low:
        state[0] = 1.0
        return 0
    return _integers(words, i, low, high)
