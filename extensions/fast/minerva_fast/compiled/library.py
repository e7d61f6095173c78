"""Arithmetic, functions and draws that generated kernels use, compiled by numba.

Functions with `state` set `state[0]` where Python raises an error or has a result that the kernel
cannot hold; the kernel then undoes the row, and the Python method runs for it. A number that is an
int in one case and a real in another is held as a real: results are equal in both cases, or a
fault. `portable` and the draws are compiled from their own source. Imports numba, so only generated
modules import this one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import (  # pyright: ignore[reportMissingTypeStubs]
    boolean,
    float64,
    int64,
    njit,  # pyright: ignore[reportUnknownVariableType]
    types,
    uint8,  # noqa: F401  # pyright: ignore[reportUnusedImport]
    uint64,  # noqa: F401  # pyright: ignore[reportUnusedImport]
)

from minerva_bus.portable import (
    distributions,
    exponentials,
    lengths,
    logarithms,
    trigonometry,
)
from minerva_fast.compiled.machine_code import ALLOCATING, NUMBA_OPTIONS, PortableForms

compiled: Any = njit(**NUMBA_OPTIONS)

_LEAST = -(2**63)
_EXACT = 2**53
_TOP = 9223372036854775808.0
_HALF = 2**31


# --- ints ---


@compiled
def exact(state: Any, number: int) -> float:
    """An int as a real of the same value."""
    if not -_EXACT <= number <= _EXACT:
        state[0] = 1.0
    return float(number)


@compiled
def bound(state: Any, number: int) -> int:
    """An int below 2^53, as bounds of draws are."""
    if not -_EXACT <= number <= _EXACT:
        state[0] = 1.0
        return 0
    return number


@compiled
def add(state: Any, a: int, b: int) -> int:
    """`a + b` within 64 bits."""
    total = a + b
    if ((a ^ total) & (b ^ total)) < 0:
        state[0] = 1.0
    return total


@compiled
def subtract(state: Any, a: int, b: int) -> int:
    """`a - b` within 64 bits."""
    rest = a - b
    if ((a ^ b) & (a ^ rest)) < 0:
        state[0] = 1.0
    return rest


@compiled
def multiply(state: Any, a: int, b: int) -> int:
    """`a * b` within 64 bits."""
    small = -_HALF <= a < _HALF and -_HALF <= b < _HALF
    # The rounded product tells overflows apart, except near the limits, which count as faults.
    if not small and abs(float(a) * float(b)) > 9.2e18:
        state[0] = 1.0
        return 0
    return a * b


@compiled
def divide_ints(state: Any, a: int, b: int) -> float:
    """`a / b` of ints that a real holds exactly, so that the quotient is rounded once."""
    if b == 0 or not (-_EXACT <= a <= _EXACT and -_EXACT <= b <= _EXACT):
        state[0] = 1.0
        return 0.0
    return float(a) / float(b)


@compiled
def floor_divide(state: Any, a: int, b: int) -> int:
    """`a // b`."""
    if b == 0 or (b == -1 and a == _LEAST):
        state[0] = 1.0
        return 0
    return a // b


@compiled
def modulo(state: Any, a: int, b: int) -> int:
    """`a % b`."""
    if b == 0 or b == -1:
        if b == 0:
            state[0] = 1.0
        return 0
    return a % b


@compiled
def power_of_ints(state: Any, base: int, exponent: int) -> int:
    """`base ** exponent` with an exponent from 0 up, within 64 bits."""
    result = 1
    for _ in range(min(exponent, 64) if -1 <= base <= 1 else exponent):
        result = multiply(state, result, base)
        if state[0] != 0.0:
            return 0
    if exponent > 64 and base == -1 and exponent % 2 == 1:
        return -1
    return result


@compiled
def shift_left(state: Any, number: int, bits: int) -> int:
    """`number << bits` within 64 bits."""
    if not (0 <= bits < 62 and -(1 << (62 - bits)) <= number < (1 << (62 - bits))):
        state[0] = 1.0
        return 0
    return number << bits


@compiled
def shift_right(state: Any, number: int, bits: int) -> int:
    """`number >> bits`."""
    if bits < 0:
        state[0] = 1.0
        return 0
    return number >> min(bits, 63)


@compiled
def absolute(state: Any, number: int) -> int:
    """`abs(number)`."""
    if number == _LEAST:
        state[0] = 1.0
        return 0
    return abs(number)


@compiled
def place(state: Any, index: int, length: int) -> int:
    """An index of a sequence, counted from its start."""
    if not -length <= index < length:
        state[0] = 1.0
        return 0
    return index + length if index < 0 else index


# --- reals ---


@compiled
def divide(state: Any, a: float, b: float) -> float:
    """`a / b`."""
    if b == 0.0:
        state[0] = 1.0
        return 0.0
    return a / b


@compiled
def floor_divide_reals(state: Any, a: float, b: float) -> float:
    """`a // b`, by the steps of CPython's `float_divmod`."""
    if b == 0.0 or not (math.isfinite(a) and math.isfinite(b)):
        state[0] = 1.0
        return 0.0
    rest = np.fmod(a, b)
    quotient = (a - rest) / b
    if rest != 0.0 and (b < 0.0) != (rest < 0.0):
        quotient -= 1.0
    if quotient == 0.0:
        return math.copysign(0.0, a / b)
    whole = np.floor(quotient)
    return whole + 1.0 if quotient - whole > 0.5 else whole


@compiled
def modulo_reals(state: Any, a: float, b: float) -> float:
    """`a % b`, by the steps of CPython's `float_rem`."""
    if b == 0.0 or not (math.isfinite(a) and math.isfinite(b)):
        state[0] = 1.0
        return 0.0
    rest = np.fmod(a, b)
    if rest == 0.0:
        return math.copysign(0.0, b)
    return rest + b if (b < 0.0) != (rest < 0.0) else rest


@compiled
def power(state: Any, base: float, exponent: float) -> float:
    """`base ** exponent` by the C library."""
    # `state[1]` is 0, which the compiler does not know: it would replace x ** 2.0 by x * x, which
    # may differ in the last bit.
    result = math.pow(base, exponent + state[1])
    if not math.isfinite(result) or (base == 0.0 and exponent < 0.0):
        state[0] = 1.0
        return 0.0
    return result


@compiled
def truncate(state: Any, number: float) -> int:
    """`int(number)`."""
    if not -_TOP < number < _TOP:
        state[0] = 1.0
        return 0
    return int(number)


@compiled
def floor(state: Any, number: float) -> int:
    """`math.floor(number)`."""
    if not -_TOP < number < _TOP:
        state[0] = 1.0
        return 0
    return math.floor(number)


@compiled
def ceiling(state: Any, number: float) -> int:
    """`math.ceil(number)`."""
    if not -_TOP < number < _TOP:
        state[0] = 1.0
        return 0
    return math.ceil(number)


@compiled
def round_real(state: Any, number: float) -> int:
    """`round(number)`: to the nearest int, and of two to the even one."""
    if not -_TOP < number < _TOP:
        state[0] = 1.0
        return 0
    whole = np.floor(number)
    rest = number - whole
    if rest > 0.5 or (rest == 0.5 and whole % 2.0 != 0.0):
        whole += 1.0
    return int(whole)


@compiled
def absolute_real(number: float) -> float:
    """`abs(number)`."""
    return math.fabs(number)


@compiled
def minimum(a: Any, b: Any) -> Any:
    """`min(a, b)`: also with nan the argument that Python chooses."""
    return b if b < a else a


@compiled
def maximum(a: Any, b: Any) -> Any:
    """`max(a, b)`."""
    return b if b > a else a


@compiled
def within(number: float, least: float, most: float) -> bool:
    """Whether a number may be stored: finite and in the range of its type."""
    return math.isfinite(number) and least <= number <= most


# --- names of generated modules ---

inlined: Any = njit(**NUMBA_OPTIONS, forceinline=True)
NAN = math.nan
INFINITY = math.inf
LEAST_INT = _LEAST
READ_INT = types.Array(int64, 1, "A", readonly=True)
READ_REAL = types.Array(float64, 1, "A", readonly=True)
READ_BOOL = types.Array(boolean, 1, "A", readonly=True)


def kernel(signature: Any) -> Any:
    """Compile a kernel for one signature, and keep the machine code beside its module."""
    return njit(signature, cache=True, **NUMBA_OPTIONS)


def kernel_with_lists(signature: Any) -> Any:
    """As `kernel`, for a kernel that creates arrays for local lists."""
    return njit(signature, cache=True, **ALLOCATING)


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
