"""Arithmetic and names that generated kernels use, compiled by numba.

Functions with `state` set `state[0]` where Python raises an error or has a result that the kernel
cannot hold; the kernel then undoes the row, and the Python method runs for it. Imports numba, so
only generated modules import this one.
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

from minerva_fast.compiled.loading import ALLOCATING, NUMBA_OPTIONS

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
