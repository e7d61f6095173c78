"""Functions of Python, `math` and `portable` in rules: Python's result, or a fault.

They are those of compiled methods (`library`, `function_library`), which mark a fault. Imports
numba, so only compiled rules import this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportOptionalCall=false, reportPrivateImportUsage=false
# pyright: reportCallIssue=false

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from numba.core import errors
from numba.extending import intrinsic, overload, types

from minerva_bus import portable
from minerva_fast.compiled import function_library, library
from minerva_fast.compiled.functions import OF_MATH, OF_PORTABLE
from minerva_fast.space.operators import leave_if_inexact, negative, state, whole


def _of_real(function: Any) -> Any:
    """A function of a real that may mark a fault."""
    return library.compiled(lambda x: function(state(), float(x)))


def _of_reals(function: Any) -> Any:
    """A function of two reals that may mark a fault."""
    return library.compiled(lambda x, y: function(state(), float(x), float(y)))


def _to_int(function: Any) -> Any:
    """A conversion of a real to an int; an int stays as it is."""

    def convert(number: Any) -> Any:
        raise NotImplementedError

    @overload(convert, strict=False)
    def _(number: Any) -> Any:
        if isinstance(number, types.Integer | types.Boolean):
            return lambda number: types.int64(number)
        if isinstance(number, types.Float):
            return lambda number: function(state(), number)
        return None

    return convert


def _absolute(number: Any) -> Any:
    raise NotImplementedError


@overload(_absolute, strict=False)
def _(number: Any) -> Any:
    if whole(number):
        return lambda number: negative(number) if number < 0 else types.int64(number)
    return lambda number: abs(number)


def _extreme(operator: str) -> Any:
    """`min` or `max` of two numbers: with nan, too, the one that Python chooses."""

    @intrinsic
    def extreme(_: Any, first: Any, second: Any) -> Any:
        both = whole(first) and whole(second)
        if not all(whole(each) or isinstance(each, types.Float) for each in (first, second)):
            raise errors.TypingError("min or max of values that are not numbers")
        kind = types.int64 if both else types.float64

        def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            for value, given in zip(arguments, signature.args, strict=True):
                if not both:
                    leave_if_inexact(target, builder, value, given)
            left, right = [
                target.cast(builder, value, given, kind)
                for value, given in zip(arguments, signature.args, strict=True)
            ]
            compare = builder.icmp_signed if both else builder.fcmp_ordered
            return builder.select(compare(operator, right, left), right, left)

        return kind(first, second), generate

    return extreme


MINIMUM: Final = _extreme("<")
MAXIMUM: Final = _extreme(">")

FUNCTIONS: Final[Mapping[Callable[..., Any], Any]] = {
    abs: _absolute,
    int: _to_int(library.truncate),
    max: MAXIMUM,
    min: MINIMUM,
    round: _to_int(library.round_real),
    math.ceil: _to_int(library.ceiling),
    math.floor: _to_int(library.floor),
    math.trunc: _to_int(library.truncate),
    math.atan2: _of_reals(function_library.math_atan2),
    math.copysign: library.compiled(lambda x, y: math.copysign(float(x), float(y))),
    math.fmod: _of_reals(function_library.math_fmod),
    portable.atan2: _of_reals(function_library.portable_atan2),
    portable.hypot: _of_reals(function_library.portable_hypot),
    portable.power: _of_reals(function_library.portable_power),
    **{
        getattr(math, name): _of_real(getattr(function_library, f"math_{name}")) for name in OF_MATH
    },
    **{
        getattr(portable, name): _of_real(getattr(function_library, f"portable_{name}"))
        for name in OF_PORTABLE
    },
}
"""What rules have in place of functions."""
