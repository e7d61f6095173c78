"""Arithmetic, functions and draws that generated modules use, compiled by numba.

They raise an error, a fault, where Python raises one or has a result that machine code cannot hold.
`portable`, the draws and the functions of spaces are compiled from their
own source. Imports numba, so only generated modules import this one.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportMissingTypeStubs=false

from __future__ import annotations

import math
from functools import partial
from types import FunctionType
from typing import Any, Final, get_type_hints

import numpy as np
from numba import (  # (names of generated modules)
    boolean,
    float64,
    int16,
    int64,
    types,
    uint8,  # noqa: F401
    uint64,  # noqa: F401
)
from numba.core import cgutils
from numba.extending import intrinsic

from minerva_bus import portable
from minerva_bus.portable import distributions, trigonometry
from minerva_fast import draws, places
from minerva_fast.draws import EXACT
from minerva_fast.functions import OF_MATH, OF_PORTABLE
from minerva_fast.pipeline import Part, object_file
from minerva_fast.places import (
    CellGrid,  # noqa: F401
    Columns,
    Edges,  # noqa: F401
    FieldRows,  # noqa: F401
    Ints,
    LatticeRows,  # noqa: F401
    Links,
    Numbers,
)

compiled: Final = Part
inlined: Final = partial(Part, forceinline=True)

NAN: Final = math.nan
INFINITY: Final = math.inf
LEAST_INT: Final = -(2**63)
_TOP: Final = 9223372036854775808.0


def kernel(signature: Any) -> Any:
    """Compile a kernel for one signature; it becomes its object file."""
    return partial(object_file, signature=signature)


def read_only(item: Any) -> Any:
    """The type of an array of one dimension that the kernel only reads, of any layout."""
    return types.Array(item, 1, "A", readonly=True)


def cells(item: Any, dimensions: int = 1, only_read: bool = False) -> Any:
    """The type of an array of a space."""
    return types.Array(item, dimensions, "C", readonly=only_read)


_TYPES: Final[dict[Any, Any]] = {
    int: int64,
    float: float64,
    bool: boolean,
    type(None): types.void,
    Ints: cells(int64),
    Numbers: cells(float64),
    Links: cells(int64, 2),
    Columns: cells(float64, 2),
}


def typed(hint: Any, only_read: bool = False) -> Any:
    """The type of an annotation; `only_read`: no number of a table changes, or of its positions."""
    if hint in _TYPES:
        return _TYPES[hint]
    parts = {name: typed(part) for name, part in get_type_hints(hint).items()}
    for name in {"values", "x", "y"} & parts.keys() if only_read else ():
        parts[name] = parts[name].copy(readonly=True)
    return types.NamedTuple([*parts.values()], hint)


# --- indices and ints: an instruction and a branch, without a call ---


def _leave_if(context: Any, builder: Any, fault: Any, error: type[Exception]) -> None:
    with cgutils.if_unlikely(builder, fault):
        context.call_conv.return_user_exc(builder, error, ("no result in machine code",))


def _with_overflow(instruction: str) -> Any:
    @intrinsic
    def operate(_: Any, a: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            made = getattr(builder, instruction)(*arguments)
            _leave_if(context, builder, builder.extract_value(made, 1), OverflowError)
            return builder.extract_value(made, 0)

        return types.int64(types.int64, types.int64), generate

    return operate


add: Final = _with_overflow("sadd_with_overflow")
subtract: Final = _with_overflow("ssub_with_overflow")
multiply: Final = _with_overflow("smul_with_overflow")


@intrinsic
def _existing(_: Any, index: Any, length: Any) -> Any:
    """An index from 0 to `length` - 1, unsigned, so that it is not counted from the end."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        index, length = arguments
        _leave_if(context, builder, builder.icmp_unsigned(">=", index, length), IndexError)
        return index

    return types.uint64(types.int64, types.int64), generate


existing: Any = _existing


@intrinsic
def sure(_: Any, index: Any) -> Any:
    """An index that is known to exist."""
    return types.uint64(types.int64), lambda context, builder, signature, arguments: arguments[0]


@inlined
def place(index: int, length: int) -> Any:
    """An index of a list, counted from its start."""
    return existing(index + length if index < 0 else index, length)


@inlined
def short(number: int) -> Any:
    """An int that fits into a cell."""
    made = int16(number)
    if made != number:
        raise OverflowError
    return made


@inlined
def exact(number: int) -> float:
    """An int as a real of the same value."""
    if not -EXACT <= number <= EXACT:
        raise OverflowError
    return float(number)


@inlined
def minimum(a: Any, b: Any) -> Any:
    """`min(a, b)`: also with nan the argument that Python chooses."""
    return b if b < a else a


@inlined
def maximum(a: Any, b: Any) -> Any:
    """`max(a, b)`."""
    return b if b > a else a


@inlined
def turns(progress: Any, count: float) -> None:
    """Count the turns of a loop."""
    if count > 0:
        progress[draws.TURNS] += int64(minimum(count, 1e18))
        if progress[draws.TURNS] > draws.MOST_TURNS:
            raise RuntimeError


@compiled
def floor_divide(a: int, b: int) -> int:
    """`a // b`."""
    if b == 0 or (b == -1 and a == LEAST_INT):
        raise ZeroDivisionError
    return a // b


@compiled
def modulo(a: int, b: int) -> int:
    """`a % b`."""
    if b == 0:
        raise ZeroDivisionError
    return a % b if b != -1 else 0


@compiled
def power_of_ints(base: int, exponent: int) -> int:
    """`base ** exponent` with an exponent from 0 up, within 64 bits."""
    result = 1
    for _ in range(min(exponent, 64 + exponent % 2) if -1 <= base <= 1 else exponent):
        result = multiply(result, base)
    return result


@inlined
def absolute(number: int) -> int:
    """`abs(number)`."""
    return subtract(0, number) if number < 0 else number


# --- reals ---


@compiled
def floor_divide_reals(a: float, b: float) -> float:
    """`a // b`."""
    if b == 0.0 or not (math.isfinite(a) and math.isfinite(b)):
        raise ZeroDivisionError
    return a // b


@compiled
def modulo_reals(a: float, b: float) -> float:
    """`a % b`."""
    if b == 0.0 or not (math.isfinite(a) and math.isfinite(b)):
        raise ZeroDivisionError
    return a % b


@compiled
def power(base: float, exponent: float) -> float:
    """`base ** exponent` by the C library."""
    # The product is 0, which the compiler does not know: it would replace x ** 2.0 by x * x, which
    # may differ in the last bit. Without its bits, infinity and nan are faults.
    result = math.pow(base, exponent + base * 0.0)
    if not math.isfinite(result) or (base == 0.0 and exponent < 0.0):
        raise OverflowError
    return result


@inlined
def whole_number(number: float) -> float:
    """A real that an int of 64 bits can hold, without its fraction."""
    if not -_TOP < number < _TOP:
        raise OverflowError
    return number


@inlined
def truncate(number: float) -> int:
    """`int(number)`."""
    return int(whole_number(number))


@inlined
def floor(number: float) -> int:
    """`math.floor(number)`."""
    return int(np.floor(whole_number(number)))


@inlined
def ceiling(number: float) -> int:
    """`math.ceil(number)`."""
    return int(np.ceil(whole_number(number)))


@inlined
def round_real(number: float) -> int:
    """`round(number)`: to the nearest int, and of two to the even one."""
    return int(np.rint(whole_number(number)))


@inlined
def within(number: float, least: float, most: float) -> bool:
    """Whether a number may be stored: finite and in the range of its type."""
    return math.isfinite(number) and least <= number <= most


# --- functions of `math` and `portable` ---


# Outside its domain Python raises an error, where the C library returns nan or infinity.


def _of_one(function: Any) -> Any:
    """A function of a real; a result or argument that is not finite is a fault."""

    @compiled
    def call(number: float) -> float:
        result = function(number) if math.isfinite(number) else math.nan
        if not math.isfinite(result):
            raise ValueError
        return result

    return call


def _of_two(function: Any) -> Any:
    """A function of two reals; a result or argument that is not finite is a fault."""

    @compiled
    def call(x: float, y: float) -> float:
        result = function(x, y) if math.isfinite(x) and math.isfinite(y) else math.nan
        if not math.isfinite(result):
            raise ValueError
        return result

    return call


globals().update({f"math_{name}": _of_one(getattr(math, name)) for name in OF_MATH})
math_atan2: Final = _of_two(math.atan2)
math_fmod: Final = _of_two(np.fmod)


@compiled
def _too_far(x: float) -> tuple[int, float, float]:
    """In place of the reduction of huge angles, which needs ints of any length."""
    raise ValueError


_OURS: Final = (portable.__name__, places.__name__, draws.__name__)
_BUILTINS: Final = {"int": int64, "min": minimum, "max": maximum}
"""In functions of spaces, with numbers of 64 bits: numba's own are functions, compiled for each."""
_forms: dict[Any, Any] = {trigonometry.far: _too_far, places.sure: sure}


def form(function: Any) -> Any:
    """A function of this project, and those of it that it calls, compiled for one number."""
    scalar: FunctionType = getattr(function, "one", function)
    if scalar not in _forms:
        # Calls of functions of spaces would pass each array of a table as seven numbers.
        compile_ = compiled if scalar.__module__.startswith(portable.__name__) else inlined
        _forms[scalar] = compile_(_calling_forms(scalar))
    return _forms[scalar]


def _calling_forms(function: FunctionType) -> FunctionType:
    """A function that calls the forms of functions."""
    scope = dict(function.__globals__)
    if not function.__module__.startswith(portable.__name__):
        scope |= _BUILTINS
    for name in function.__code__.co_names:
        value = scope.get(name)
        if isinstance(value, FunctionType) and value.__module__.startswith(_OURS):
            scope[name] = form(value)
    return FunctionType(function.__code__, scope, function.__name__, function.__defaults__)


def of_space(name: str) -> Any:
    """The form of a function for rules."""
    return form(getattr(places, name, None) or getattr(draws, name))


def loop(name: str) -> Any:
    """A loop over the rows of a table, as part of a kernel, and its signature."""
    function = getattr(places, name)
    hints = get_type_hints(function)
    return form(function), typed(hints.pop("return"))(*map(typed, hints.values()))


def _within(function: Any, least: float, most: float) -> Any:
    """A function of `portable` for arguments in an open interval; others are faults."""
    inner = form(function)

    @compiled
    def call(number: float) -> float:
        if not least < number < most:
            raise ValueError
        return inner(number)

    return call


globals().update(
    {
        f"portable_{name}": _within(getattr(portable, name), *ends)
        for name, ends in OF_PORTABLE.items()
    }
)
portable_atan2: Final = _of_two(form(portable.atan2))
portable_hypot: Final = _of_two(form(portable.hypot))
_power: Final = form(portable.power)


@compiled
def portable_power(base: float, exponent: float) -> float:
    """`portable.power(base, exponent)`, for positive bases and results of usual size."""
    if not (0.0 < base < math.inf and abs(exponent) * abs(math.log(base)) < 700.0):
        raise ValueError
    return _power(base, exponent)


# --- draws: the next number of word `i` of a stream ---

draw_random: Final = form(distributions.draw_random)
draw_uniform: Final = form(distributions.draw_uniform)
draw_chance: Final = form(distributions.draw_chance)
draw_exponential: Final = form(distributions.draw_exponential)
draw_normal: Final = form(distributions.draw_normal)
_integers: Final = form(distributions.draw_integers)


@inlined
def draw_integers(words: Any, i: int, low: int, high: int) -> int:
    """An int in [low, high)."""
    if high <= low:
        raise ValueError
    return _integers(words, i, low, high)
