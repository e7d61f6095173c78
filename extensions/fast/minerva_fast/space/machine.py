"""The guarded arrays of `minerva_fast.space.guarded` as a type of numba.

An index is compared once, as an unsigned number, so that negative ones are too large: this takes
less than numba's own checks of arrays, which first count negative indices from the end. Imports
numba, so only compiled rules import this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportOptionalCall=false, reportPrivateImportUsage=false

from __future__ import annotations

import operator
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
    register_model,
    types,
)

from minerva_fast.space.guarded import ALL, NO_INT, READ_ONLY, REAL_IN_CELLS, UNCHECKED

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
