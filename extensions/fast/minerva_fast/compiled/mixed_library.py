"""Arithmetic with numbers that are ints in one case and reals in another, held as reals.

Results are equal in both cases; where they would not be, `state[0]` marks the row, as in `library`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from minerva_fast.compiled.library import compiled, floor_divide_reals, modulo_reals, power



@compiled
def is_real(number: float) -> bool:
    """Whether a number that may be an int held as a real is certainly a real."""
    negative_zero = number == 0.0 and math.copysign(1.0, number) < 0.0
    return negative_zero or not abs(number) <= _EXACT or number != np.floor(number)


@compiled
def either(state: Any, result: float, a: float, b: float) -> float:
    """The result of an operator on `a` and `b`, which must be that of ints, too, if both may be.

    Ints have no -0.0, and further digits where reals are rounded.
    """
    negative_zero = result == 0.0 and math.copysign(1.0, result) < 0.0
    if (negative_zero or abs(result) >= _EXACT) and not (is_real(a) or is_real(b)):
        state[0] = 1.0
    return result


@compiled
def add_mixed(state: Any, a: float, b: float) -> float:
    """`a + b`."""
    return either(state, a + b, a, b)


@compiled
def subtract_mixed(state: Any, a: float, b: float) -> float:
    """`a - b`."""
    return either(state, a - b, a, b)


@compiled
def multiply_mixed(state: Any, a: float, b: float) -> float:
    """`a * b`."""
    return either(state, a * b, a, b)


@compiled
def floor_divide_mixed(state: Any, a: float, b: float) -> float:
    """`a // b`."""
    return either(state, floor_divide_reals(state, a, b), a, b)


@compiled
def modulo_mixed(state: Any, a: float, b: float) -> float:
    """`a % b`."""
    return either(state, modulo_reals(state, a, b), a, b)


@compiled
def power_mixed(state: Any, base: float, exponent: float) -> float:
    """`base ** exponent` with an exponent from 0 up; the C library has exact powers of ints."""
    return either(state, power(state, base, exponent), base, exponent)
