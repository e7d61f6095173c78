"""Operators and functions of Python in rules: Python's result, or a fault.

Machine code differs from Python for ints beyond 64 bits, ints that are compared with reals,
arguments outside of a domain, and nan. The functions here leave the activation with an error in
each such case, so that Python runs it. What takes more than a comparison is that of compiled
methods (`library`). Imports numba, so only compiled rules import this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportOptionalCall=false, reportPrivateImportUsage=false
# pyright: reportCallIssue=false

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from typing import Any, Final

from numba.core import cgutils, errors, typing
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import (
    intrinsic,
    lower_builtin,
    models,
    overload,
    register_model,
    types,
)

from minerva_fast.compiled import library
from minerva_fast.space.guarded import FAULT

_EXACT: Final = 2**53
_BEYOND: Final = "an int of more than 64 bits"


# --- faults ---


class StateType(types.Type):
    """In place of the state of a compiled method: to mark a fault leaves the function."""

    def __init__(self) -> None:
        super().__init__(name="State")


register_model(StateType)(models.OpaqueModel)
_STATE: Final = StateType()


@intrinsic
def state(_: Any) -> Any:
    """The state that functions of `library` take."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.get_dummy_value()

    return _STATE(), generate


@infer_global(operator.setitem)
class _Mark(AbstractTemplate):
    def generic(self, args: Any, _: Any) -> Any:
        """The type of `state[0] = 1.0`."""
        return typing.signature(types.none, *args) if isinstance(args[0], StateType) else None


@lower_builtin(operator.setitem, StateType, types.Integer, types.Float)
def _mark(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    _leave_if(context, builder, cgutils.true_bit)
    return context.get_dummy_value()


@infer_global(operator.getitem)
class _Marked(AbstractTemplate):
    def generic(self, args: Any, _: Any) -> Any:
        """The type of `state[0]`."""
        return typing.signature(types.float64, *args) if isinstance(args[0], StateType) else None


@lower_builtin(operator.getitem, StateType, types.Integer)
def _marked(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return context.get_constant(types.float64, 0.0)  # as what is marked does not go on


def _leave_if(context: Any, builder: Any, fault: Any) -> None:
    with cgutils.if_unlikely(builder, fault):
        context.call_conv.return_user_exc(builder, ArithmeticError, (FAULT,))


# --- operators ---


def whole(kind: Any) -> bool:
    """Whether values of a type are ints or bools. Raises TypingError beyond 64 bits."""
    if isinstance(kind, types.Integer) and not kind.signed and kind.bitwidth == 64:
        raise errors.TypingError(_BEYOND)
    return isinstance(kind, types.Boolean) or (isinstance(kind, types.Integer) and kind.signed)


def _number(kind: Any) -> bool:
    return isinstance(kind, types.Float) or whole(kind)


def _plain(context: Any, function: Any, *args: Any) -> tuple[Any, Any]:
    """The signature of an operator of numba, and what makes its code."""
    kind = context.resolve_value_type(function)
    resolved = context.resolve_function_type(kind, args, {})

    def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given = [
            target.cast(builder, value, *types_)
            for value, *types_ in zip(arguments, args, resolved.args, strict=True)
        ]
        return target.get_function(kind, resolved)(builder, given)

    return resolved.return_type(*args), generate


def _with_overflow(function: Any, instruction: str) -> Any:
    """An operator of two ints with an instruction of LLVM that tells overflows."""

    @intrinsic
    def guarded(context: Any, left: Any, right: Any) -> Any:
        if not (whole(left) and whole(right)):
            return _plain(context, function, left, right)

        def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            made = getattr(builder, instruction)(*_longs(target, builder, signature, arguments))
            _leave_if(target, builder, builder.extract_value(made, 1))
            return builder.extract_value(made, 0)

        return types.int64(left, right), generate

    return guarded


def _longs(target: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
    return [
        target.cast(builder, value, kind, types.int64)
        for value, kind in zip(arguments, signature.args, strict=True)
    ]


def _exact(function: Any, *, ints: bool) -> Any:
    """An operator that numba applies to reals; ints must be those that a real holds exactly.

    `ints`: also if both operands are ints. Otherwise these have an operator of their own.
    """

    @intrinsic
    def guarded(context: Any, left: Any, right: Any) -> Any:
        signature, plain = _plain(context, function, left, right)
        both = whole(left) and whole(right)
        checked = both if ints else whole(left) != whole(right)

        def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            for value, kind in zip(arguments, signature.args, strict=True):
                if checked:
                    leave_if_inexact(target, builder, value, kind)
            return plain(target, builder, signature, arguments)

        return signature, generate

    return guarded


def leave_if_inexact(target: Any, builder: Any, value: Any, kind: Any) -> None:
    """Leave the function if a value is an int that a real does not hold exactly."""
    if whole(kind) and getattr(kind, "bitwidth", 1) == 64:
        # Checks the range from -2^53 to 2^53 with one unsigned comparison.
        moved = builder.add(value, value.type(_EXACT))
        _leave_if(target, builder, builder.icmp_unsigned(">", moved, value.type(2 * _EXACT)))


@intrinsic
def negative(context: Any, value: Any) -> Any:
    """`-value`."""
    if not whole(value):
        return _plain(context, operator.neg, value)

    def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        (number,) = _longs(target, builder, signature, arguments)
        made = builder.ssub_with_overflow(number.type(0), number)
        _leave_if(target, builder, builder.extract_value(made, 1))
        return builder.extract_value(made, 0)

    return types.int64(value), generate


@intrinsic
def inverted(context: Any, value: Any) -> Any:
    """`~value`."""
    if not whole(value):
        return _plain(context, operator.invert, value)

    def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        (number,) = _longs(target, builder, signature, arguments)
        return builder.not_(number)

    return types.int64(value), generate


def _by_library(function: Any, of_ints: Any, of_reals: Any) -> Any:
    """An operator with functions of `library` for two ints, and for a real; others are numba's."""

    def guarded(left: Any, right: Any) -> Any:
        raise NotImplementedError

    @overload(guarded, strict=False)
    def _(left: Any, right: Any) -> Any:
        if whole(left) and whole(right):
            return lambda left, right: of_ints(state(), int(left), int(right))
        if of_reals is not None and _number(left) and _number(right):
            return lambda left, right: of_reals(state(), float(left), float(right))
        return lambda left, right: function(left, right)

    return guarded


@library.compiled
def _power(state: Any, base: float, exponent: float) -> float:
    # The product is 0, which the compiler does not know: it would replace x ** 2.0 by x * x, which
    # may differ in the last bit. Without its bits, infinity and nan are faults.
    result = math.pow(base, exponent + base * 0.0)
    if not math.isfinite(result) or (base == 0.0 and exponent < 0.0):
        state[0] = 1.0
        return 0.0
    return result


OPERATORS: Final[Mapping[Any, Any]] = {
    operator.add: _with_overflow(operator.add, "sadd_with_overflow"),
    operator.sub: _with_overflow(operator.sub, "ssub_with_overflow"),
    operator.mul: _with_overflow(operator.mul, "smul_with_overflow"),
    operator.iadd: _with_overflow(operator.iadd, "sadd_with_overflow"),
    operator.isub: _with_overflow(operator.isub, "ssub_with_overflow"),
    operator.imul: _with_overflow(operator.imul, "smul_with_overflow"),
    operator.truediv: _exact(operator.truediv, ints=True),
    operator.itruediv: _exact(operator.itruediv, ints=True),
    operator.neg: negative,
    operator.invert: inverted,
    **{
        each: _exact(each, ints=False)
        for each in (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne)
    },
    **dict.fromkeys(
        (operator.floordiv, operator.ifloordiv),
        _by_library(operator.floordiv, library.floor_divide, library.floor_divide_reals),
    ),
    **dict.fromkeys(
        (operator.mod, operator.imod),
        _by_library(operator.mod, library.modulo, library.modulo_reals),
    ),
    **dict.fromkeys(
        (operator.pow, operator.ipow),
        _by_library(operator.pow, library.power_of_ints, _power),
    ),
    **dict.fromkeys(
        (operator.lshift, operator.ilshift), _by_library(operator.lshift, library.shift_left, None)
    ),
    **dict.fromkeys(
        (operator.rshift, operator.irshift), _by_library(operator.rshift, library.shift_right, None)
    ),
}
"""What rules have in place of operators."""
