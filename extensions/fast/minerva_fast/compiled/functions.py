"""Functions that a compiled method may call: builtins, `math`, `portable`, and distributions.

Each entry makes the checked form of a call. Functions of `math` are those of the C library, as in
Python; those of `portable` are the project's own, compiled from the same source.
"""

from __future__ import annotations

import ast
import builtins
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from minerva_bus import portable
from minerva_fast.compiled.form import BinaryOperation, Call, Constant, Expression, ValueKind
from minerva_fast.compiled.origin import FUNCTIONS_INSTEAD, TEXT_AS_NUMBER

if TYPE_CHECKING:
    from minerva_fast.compiled.expressions import Expressions

Checked: TypeAlias = Callable[["Expressions", ast.Call, Sequence[Expression]], Expression]


@dataclass(frozen=True, slots=True)
class Distribution:
    """A method of `moment.chance`: its arguments, their defaults, and the kind of its results."""

    kind: ValueKind
    names: tuple[str, ...] = ()
    defaults: Mapping[str, float] = field(default_factory=dict[str, float])


DISTRIBUTIONS: Final = {
    "random": Distribution(ValueKind.REAL),
    "uniform": Distribution(ValueKind.REAL, ("low", "high"), {"low": 0.0, "high": 1.0}),
    "integers": Distribution(ValueKind.INT, ("low", "high")),
    "chance": Distribution(ValueKind.BOOL, ("probability",)),
    "exponential": Distribution(ValueKind.REAL, ("mean",), {"mean": 1.0}),
    "normal": Distribution(ValueKind.REAL, ("mean", "deviation"), {"mean": 0.0, "deviation": 1.0}),
}


def _numbers(
    check: Expressions, node: ast.Call, arguments: Sequence[Expression], least: int, most: int
) -> list[Expression]:
    if not least <= len(arguments) <= most:
        wanted = f"{least}" if least == most else f"{least} to {most}"
        raise check.problem(node, f"{len(arguments)} arguments; expected {wanted}")
    return [check.as_number(node, argument) for argument in arguments]


def _reals(count: int, function: str, *, faults: bool = True) -> Checked:
    """A function of reals in `library`."""

    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
        reals = map(check.as_real, _numbers(check, node, arguments, count, count))
        if faults:
            return check.fault(ValueKind.REAL, function, *reals)
        return Call(ValueKind.REAL, function, tuple(reals))

    return checked


def _times(factor: float) -> Checked:
    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
        (value,) = _numbers(check, node, arguments, 1, 1)
        return BinaryOperation(
            ValueKind.REAL, "*", check.as_real(value), Constant(ValueKind.REAL, factor)
        )

    return checked


def _whole(function: str) -> Checked:
    """A conversion of a real to an int; an int stays as it is."""

    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
        (value,) = _numbers(check, node, arguments, 1, 1)
        return value if value.kind is ValueKind.INT else check.fault(ValueKind.INT, function, value)

    return checked


def _round(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
    if len(arguments) != 1:
        raise check.problem(
            node, "round with a number of digits", "round(100 * x) / 100, if that is precise enough"
        )
    return _whole("round_real")(check, node, arguments)


def _real(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
    if any(value.kind is ValueKind.TEXT for value in arguments):
        raise check.problem(node, *TEXT_AS_NUMBER)
    (value,) = _numbers(check, node, arguments, 1, 1)
    if value.kind is ValueKind.MIXED:
        return Call(ValueKind.REAL, "float", (value,))
    return check.as_real(value)


def _bool(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
    if len(arguments) != 1:
        raise check.problem(node, f"{len(arguments)} arguments; expected 1")
    return check.as_truth(arguments[0])


def _absolute(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
    (value,) = _numbers(check, node, arguments, 1, 1)
    if value.kind is ValueKind.INT:
        return check.fault(ValueKind.INT, "absolute", value)
    return Call(value.kind, "absolute_real", (value,))


def _extreme(function: str) -> Checked:
    """`min` or `max` of several numbers; as in Python, the first one of equals or of nans."""

    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
        if len(arguments) < 2:
            raise check.problem(
                node, f"{function} of one value", "write a for loop, or name two values or more"
            )
        if any(argument.kind is ValueKind.BOOL for argument in arguments):
            raise check.problem(node, f"{function} of bools", "write `and` or `or`")
        kind, values = check.alike(node, _numbers(check, node, arguments, 2, 100))
        chosen = values[0]
        for value in values[1:]:
            chosen = Call(kind, f"{function}imum", (chosen, value))
        return chosen

    return checked


def _test(function: str) -> Checked:
    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Expression]) -> Expression:
        (value,) = _numbers(check, node, arguments, 1, 1)
        return Call(ValueKind.BOOL, function, (check.as_real(value),))

    return checked


OF_MATH: Final = (
    "acos",
    "asin",
    "atan",
    "cos",
    "cosh",
    "exp",
    "expm1",
    "log",
    "log10",
    "log1p",
    "sin",
    "sinh",
    "sqrt",
    "tan",
    "tanh",
)
"""Functions of `math` of one real, with a finite result for a finite argument or an error."""

OF_PORTABLE: Final = (
    "acos",
    "asin",
    "atan",
    "cos",
    "exp",
    "expm1",
    "log",
    "log10",
    "log1p",
    "log2",
    "sin",
    "tan",
    "tanh",
)

FUNCTIONS: Final[dict[Any, Checked]] = {
    abs: _absolute,
    bool: _bool,
    float: _real,
    int: _whole("truncate"),
    max: _extreme("max"),
    min: _extreme("min"),
    round: _round,
    math.atan2: _reals(2, "math_atan2"),
    math.ceil: _whole("ceiling"),
    math.copysign: _reals(2, "math.copysign", faults=False),
    math.degrees: _times(180.0 / math.pi),
    math.fabs: _reals(1, "math.fabs", faults=False),
    math.floor: _whole("floor"),
    math.fmod: _reals(2, "math_fmod"),
    math.isfinite: _test("math.isfinite"),
    math.isinf: _test("math.isinf"),
    math.isnan: _test("math.isnan"),
    math.radians: _times(math.pi / 180.0),
    math.trunc: _whole("truncate"),
    portable.atan2: _reals(2, "portable_atan2"),
    portable.hypot: _reals(2, "portable_hypot"),
    portable.power: _reals(2, "portable_power"),
    **{getattr(math, name): _reals(1, f"math_{name}") for name in OF_MATH},
    **{getattr(portable, name): _reals(1, f"portable_{name}") for name in OF_PORTABLE},
}


def instead_of(name: str) -> str:
    """What to write in place of a function that has no machine code."""
    last = name.rpartition(".")[2]
    if last in FUNCTIONS_INSTEAD:
        return FUNCTIONS_INSTEAD[last]
    for module in (portable, math, builtins):
        if getattr(module, last, None) in FUNCTIONS:
            owner = "" if module is builtins else f"{module.__name__.rpartition('.')[2]}."
            return f"use {owner}{last}"
    return "compute it with numbers and operators"
