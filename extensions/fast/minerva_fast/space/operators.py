"""Guarded arrays, operators and functions of Python in machine code: Python's result, or a fault.

An index of a guarded array is compared once, as an unsigned number, so that negative ones are too
large: this takes less than numba's own checks of arrays, which first count negative indices from
the end.

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
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final

from numba.core import (
    cgutils,
    errors,
    imputils,
    typing,
)
from numba.core.typing.templates import (
    AbstractTemplate,
    infer_global,
)
from numba.extending import (
    intrinsic,
    lower_builtin,
    models,
    overload,
    register_model,
    types,
)

from minerva_bus import portable
from minerva_fast.compiled import library
from minerva_fast.compiled.functions import OF_MATH, OF_PORTABLE
from minerva_fast.space.kernels import ALL, FAULT, NO_INT, READ_ONLY, REAL_IN_CELLS, UNCHECKED

_OUTSIDE: Final = "an index of a rule is outside of its array"
_TOO_LARGE: Final = "a number is too large for a cell"


class GuardedType(types.Type):
    """An array of one dimension, and the item of `counts` that limits its indices."""

    def __init__(self, array: Any, counts: Any, slot: int) -> None:
        self.array = array
        self.counts = counts
        self.slot = slot
        super().__init__(name=f"Guarded({array}, {slot})")


@register_model(GuardedType)
class _Model(models.StructModel):
    def __init__(self, manager: Any, kind: GuardedType) -> None:
        members = [("values", kind.array), ("counts", kind.counts)]
        super().__init__(manager, kind, members)


@cache
def guard(slot: int) -> Any:
    """The function `(values, counts)` that makes a guarded array."""

    @intrinsic
    def guarded(_: Any, values: Any, counts: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            made = cgutils.create_struct_proxy(signature.return_type)(context, builder)
            made.values, made.counts = arguments
            return imputils.impl_ret_borrowed(
                context, builder, signature.return_type, made._getvalue()
            )

        return GuardedType(values, counts, slot)(values, counts), generate

    return guarded


@intrinsic
def unchecked(_: Any, array: Any) -> Any:
    """An array, guarded or not, as a guarded one whose indices are not compared."""
    guarded = isinstance(array, GuardedType)
    parts = (array.array, array.counts) if guarded else (array, array)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.return_type
        made = cgutils.create_struct_proxy(kind)(context, builder)
        if not guarded:
            made.values = made.counts = arguments[0]
        else:
            given = _struct(context, builder, array, arguments[0])
            made.values, made.counts = given.values, given.counts
        return imputils.impl_ret_borrowed(context, builder, kind, made._getvalue())

    return GuardedType(*parts, UNCHECKED)(array), generate


@infer_global(operator.getitem)
class _Read(AbstractTemplate):
    def generic(self, args: Any, _: Any) -> Any:
        """The type of `array[index]`."""
        array, index = args
        if not isinstance(array, GuardedType):
            return None
        _check_index(index)
        return typing.signature(array.array.dtype, array, index)


@infer_global(operator.setitem)
class _Write(AbstractTemplate):
    def generic(self, args: Any, _: Any) -> Any:
        """The type of `array[index] = value`."""
        array, index, number = args
        if not isinstance(array, GuardedType):
            return None
        _check_index(index)
        if not array.array.mutable:
            raise errors.TypingError(READ_ONLY)
        if self.context.can_convert(number, array.array.dtype) is None:
            return None
        if isinstance(number, types.Float) and isinstance(array.array.dtype, types.Integer):
            raise errors.TypingError(REAL_IN_CELLS)
        return typing.signature(types.none, array, index, number)


def _check_index(index: Any) -> None:
    """Raise TypingError for a type that is not an index."""
    if not isinstance(index, types.Integer):
        raise errors.TypingError(NO_INT)


@infer_global(len)
class _Length(AbstractTemplate):
    def generic(self, args: Any, _: Any) -> Any:
        """The type of `len(array)`."""
        if isinstance(args[0], GuardedType):
            return typing.signature(types.intp, *args)
        return None


@lower_builtin(operator.getitem, GuardedType, types.Integer)
def _read(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, index = signature.args
    place = _place(context, builder, kind, index, *arguments)
    return context.unpack_value(builder, kind.array.dtype, place)


@lower_builtin(operator.setitem, GuardedType, types.Integer, types.Any)
def _write(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, index, number = signature.args
    array, position, value = arguments
    place = _place(context, builder, kind, index, array, position)
    context.pack_value(builder, kind.array.dtype, _fitting(context, builder, kind, number, value),
                       place)  # fmt: skip
    return context.get_dummy_value()


@lower_builtin(len, GuardedType)
def _length(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    (kind,) = signature.args
    return _limit(context, builder, kind, _struct(context, builder, kind, arguments[0]))


def _place(
    context: Any, builder: Any, kind: GuardedType, index: Any, array: Any, position: Any
) -> Any:
    """The address of an item; leaves the function with an IndexError if it does not exist."""
    struct = _struct(context, builder, kind, array)
    position = context.cast(builder, position, index, types.intp)
    if kind.slot != UNCHECKED:
        outside = builder.icmp_unsigned(">=", position, _limit(context, builder, kind, struct))
        with cgutils.if_unlikely(builder, outside):
            context.call_conv.return_user_exc(builder, IndexError, (_OUTSIDE,))
    values = context.make_array(kind.array)(context, builder, struct.values)
    return cgutils.gep_inbounds(builder, values.data, position)


def _fitting(context: Any, builder: Any, kind: GuardedType, number: Any, value: Any) -> Any:
    """A number in the type of an array's items; leaves the function if it is too large for it."""
    item = kind.array.dtype
    if not isinstance(item, types.Integer) or item.bitwidth == 64:
        return context.cast(builder, value, number, item)
    whole = context.cast(builder, value, number, types.int64)
    short = context.cast(builder, whole, types.int64, item)
    lost = builder.icmp_signed("!=", context.cast(builder, short, item, types.int64), whole)
    with cgutils.if_unlikely(builder, lost):
        context.call_conv.return_user_exc(builder, OverflowError, (_TOO_LARGE,))
    return short


def _limit(context: Any, builder: Any, kind: GuardedType, struct: Any) -> Any:
    """The number of items that exist."""
    if kind.slot == ALL:
        values = context.make_array(kind.array)(context, builder, struct.values)
        return builder.extract_value(values.shape, 0)
    counts = context.make_array(kind.counts)(context, builder, struct.counts)
    return builder.load(cgutils.gep_inbounds(builder, counts.data, kind.slot))


def _struct(context: Any, builder: Any, kind: GuardedType, array: Any) -> Any:
    return cgutils.create_struct_proxy(kind)(context, builder, value=array)


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
    math.atan2: _of_reals(library.math_atan2),
    math.copysign: library.compiled(lambda x, y: math.copysign(float(x), float(y))),
    math.fmod: _of_reals(library.math_fmod),
    portable.atan2: _of_reals(library.portable_atan2),
    portable.hypot: _of_reals(library.portable_hypot),
    portable.power: _of_reals(library.portable_power),
    **{getattr(math, name): _of_real(getattr(library, f"math_{name}")) for name in OF_MATH},
    **{
        getattr(portable, name): _of_real(getattr(library, f"portable_{name}"))
        for name in OF_PORTABLE
    },
}
"""What rules have in place of functions."""
