"""Functions that compiled code may call: builtins, `math`, `portable`, draws, and those of spaces.

Each entry prints a call. Functions of `math` are those of the C library, as in Python; those of
`portable` and of spaces are the project's own, compiled from the same source.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from minerva_bus import portable
from minerva_bus.errors import nearest
from minerva_fast import draws, places
from minerva_fast.origin import CHOICES, FUNCTIONS_INSTEAD
from minerva_fast.values import Given, RuleGrid, RuleTable, Value, ValueKind, constant

if TYPE_CHECKING:
    from minerva_fast.expressions import Expressions

Checked: TypeAlias = Callable[["Expressions", ast.Call, Sequence[Value]], Value]
Called: TypeAlias = tuple[ValueKind | None, str]
"""A call: the kind of its result, None if it has none, and its text."""


# --- draws ---


DISTRIBUTIONS: Final[Mapping[str, FunctionType]] = {
    name: getattr(draws, name)
    for name in ("random", "uniform", "integers", "chance", "exponential", "normal")
}
"""The methods of `moment.chance`, as functions of a stream for rules."""
_KINDS: Final[Mapping[str, ValueKind | None]] = {
    "int": ValueKind.INT, "float": ValueKind.REAL, "bool": ValueKind.BOOL, "None": None
}  # fmt: skip


def bound(
    check: Expressions,
    node: ast.Call,
    name: str,
    signature: inspect.Signature,
    given: Sequence[Any],
    named: Mapping[str, Any],
) -> dict[str, Any]:
    """The arguments of a call by parameter, in the order in which Python evaluates them."""
    try:
        arguments = signature.bind(*given, **named).arguments
    except TypeError as error:
        shown = f"{name}({', '.join(signature.parameters)})"
        raise check.problem(node, f"this call: {error}", f"write {shown}") from None
    return {each: arguments[each] for each in [*list(arguments)[: len(given)], *named]}


def draw(check: Expressions, node: ast.Call, name: str, given: Sequence[ast.expr]) -> Called:
    """A call of `moment.chance`, or of the same as a function for rules."""
    function = DISTRIBUTIONS.get(name)
    if function is None:
        hint = nearest(name, list(DISTRIBUTIONS))
        raise check.problem(node, f"moment.chance has no {name}{hint}", CHOICES.get(name, ""))
    signature = inspect.signature(function)
    kind, (stream, *names) = _KINDS[str(signature.return_annotation)], signature.parameters
    named = {str(keyword.arg): keyword.value for keyword in node.keywords}
    written = bound(check, node, name, signature, [stream, *given], named)
    if list(written) != [each for each in signature.parameters if each in written]:
        instead = f"write them as {', '.join(names)}"
        raise check.problem(node, "named arguments in another order", instead)
    check.method.draws = True
    values = {
        each: check.as_number(written[each], check.value(written[each]))
        for each in names
        if each in written
    }
    if kind is ValueKind.INT:
        if any(value.kind is not ValueKind.INT for value in values.values()):
            raise check.problem(node, "bounds that are not ints", "convert with int(...)")
        bounds = [*values.values()]
        ends = bounds if len(bounds) == 2 else [constant(ValueKind.INT, 0), *bounds]
        # A real holds them, as in Python.
        texts = [f"int64({check.as_exact(each).text})" for each in ends]
    else:
        for each in names:
            if each not in values:
                values[each] = constant(ValueKind.REAL, signature.parameters[each].default)
        if name == "exponential":
            # As in Python: the negative of an int 0 is 0, which a conversion before would change.
            values["mean"] = check.negative(check.definite(node, values["mean"]))
        texts = [check.as_exact(values[each]).text for each in names]
    return kind, f"draw_{name}({', '.join(['words', 'i', *texts])})"


# --- functions of numbers ---


def _numbers(
    check: Expressions, node: ast.Call, arguments: Sequence[Value], least: int, most: int
) -> list[Value]:
    if not least <= len(arguments) <= most:
        wanted = f"{least}" if least == most else f"{least} to {most}"
        raise check.problem(node, f"{len(arguments)} arguments; expected {wanted}")
    return [check.as_number(node, argument) for argument in arguments]


def _reals(count: int, function: str, kind: ValueKind = ValueKind.REAL) -> Checked:
    """A function of reals."""

    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Value]) -> Value:
        reals = map(check.as_real, _numbers(check, node, arguments, count, count))
        return Value(kind, f"{function}({', '.join([each.text for each in reals])})")

    return checked


def _whole(function: str) -> Checked:
    """A conversion of a real to an int; an int stays as it is."""

    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Value]) -> Value:
        (value,) = _numbers(check, node, arguments, 1, 1)
        return (
            value
            if value.kind is ValueKind.INT
            else Value(ValueKind.INT, f"{function}({value.text})")
        )

    return checked


def _round(check: Expressions, node: ast.Call, arguments: Sequence[Value]) -> Value:
    if len(arguments) != 1:
        instead = "round(100 * x) / 100, if that is precise enough"
        raise check.problem(node, "round with a number of digits", instead)
    return _whole("round_real")(check, node, arguments)


def _real(check: Expressions, node: ast.Call, arguments: Sequence[Value]) -> Value:
    (value,) = _numbers(check, node, arguments, 1, 1)
    return Value(ValueKind.REAL, f"float64({value.text})")


def _bool(check: Expressions, node: ast.Call, arguments: Sequence[Value]) -> Value:
    if len(arguments) != 1:
        raise check.problem(node, f"{len(arguments)} arguments; expected 1")
    return check.as_truth(arguments[0])


def _absolute(check: Expressions, node: ast.Call, arguments: Sequence[Value]) -> Value:
    (value,) = _numbers(check, node, arguments, 1, 1)
    function = "absolute" if value.kind is ValueKind.INT else "math.fabs"
    return Value(value.kind, f"{function}({value.text})")


def _extreme(function: str) -> Checked:
    """`min` or `max` of several numbers; as in Python, the first one of equals or of nans."""

    def checked(check: Expressions, node: ast.Call, arguments: Sequence[Value]) -> Value:
        if len(arguments) < 2:
            instead = "write a for loop, or name two values or more"
            raise check.problem(node, f"{function} of one value", instead)
        if any(argument.kind is ValueKind.BOOL for argument in arguments):
            raise check.problem(node, f"{function} of bools", "write `and` or `or`")
        kind, values = check.alike(node, _numbers(check, node, arguments, 2, 100))
        chosen = values[0].text
        for value in values[1:]:
            chosen = f"{function}imum({chosen}, {value.text})"
        return Value(kind, chosen)

    return checked


OF_MATH: Final = (
    "acos", "asin", "atan", "cos", "cosh", "exp", "expm1", "log", "log10", "log1p", "sin", "sinh",
    "sqrt", "tan", "tanh",
)  # fmt: skip
"""Functions of `math` of one real, with a finite result for a finite argument or an error."""

_ONE: Final = math.nextafter(1.0, 2.0)
_BIG: Final = 1.7e308
_FAR: Final = 1.6e6
OF_PORTABLE: Final[Mapping[str, tuple[float, float]]] = {
    "acos": (-_ONE, _ONE), "asin": (-_ONE, _ONE), "atan": (-_BIG, _BIG), "cos": (-_FAR, _FAR),
    "exp": (-740.0, 709.0), "expm1": (-740.0, 709.0), "log": (0.0, _BIG), "log10": (0.0, _BIG),
    "log1p": (-1.0, _BIG), "log2": (0.0, _BIG), "sin": (-_FAR, _FAR), "tan": (-_FAR, _FAR),
    "tanh": (-_BIG, _BIG),
}  # fmt: skip
"""Functions of `portable` of one real, with the open interval of arguments that are no fault."""

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
    math.copysign: _reals(2, "math.copysign"),
    math.degrees: _reals(1, "math.degrees"),
    math.fabs: _reals(1, "math.fabs"),
    math.floor: _whole("floor"),
    math.fmod: _reals(2, "math_fmod"),
    math.isfinite: _reals(1, "math.isfinite", ValueKind.BOOL),
    math.isinf: _reals(1, "math.isinf", ValueKind.BOOL),
    math.isnan: _reals(1, "math.isnan", ValueKind.BOOL),
    math.radians: _reals(1, "math.radians"),
    math.trunc: _whole("truncate"),
    portable.atan2: _reals(2, "portable_atan2"),
    portable.hypot: _reals(2, "portable_hypot"),
    portable.power: _reals(2, "portable_power"),
    **{getattr(math, name): _reals(1, f"math_{name}") for name in OF_MATH},
    **{getattr(portable, name): _reals(1, f"portable_{name}") for name in OF_PORTABLE},
}


# --- functions of spaces ---

OfRules: TypeAlias = Callable[["Expressions", ast.Call], Called]
_SHAPES: Final = {"CellGrid": "the shape of a lattice", "Edges": "a graph"}


def _draws(name: str) -> OfRules:
    """A draw as a function, whose first argument is the stream."""

    def checked(check: Expressions, node: ast.Call) -> Called:
        if not node.args or check.reference(node.args[0]) is not Given.CHANCE:
            instead = f"write {name}(draws, ...)"
            raise check.problem(node, f"{name} without the parameter of type Draws", instead)
        return draw(check, node, name, node.args[1:])

    return checked


def _shuffle(check: Expressions, node: ast.Call) -> Called:
    items = check.items(node.args[1]) if len(node.args) == 2 else None
    if items is None or items.owner or items.kind is not ValueKind.INT:
        raise check.problem(node, "these arguments of shuffle", "write shuffle(draws, rows)")
    check.use(items.text)
    check.method.draws = True
    check.method.called[draws.shuffle] = None
    return None, f"shuffle(words, {items.text})"


def _of_space(function: FunctionType) -> OfRules:
    """A function of `places`, with arguments as its annotations say."""
    signature = inspect.signature(function)

    def checked(check: Expressions, node: ast.Call) -> Called:
        named = {str(word.arg): word.value for word in node.keywords}
        given = bound(check, node, function.__name__, signature, node.args, named)
        table = _table(check, given["table"]) if "table" in given else None
        own, texts = False, list[str]()
        for name in given:
            wanted = str(signature.parameters[name].annotation)
            if name == "table" and table is not None:
                text = f"t_{table.name}"
            elif name == "i" and table is not None:
                value = _number(check, given[name], wanted)
                own = value.text == "v_own"
                text = _row(check, table, value)
            else:
                text = _argument(check, given[name], wanted)
            texts.append(f"{name}={text}" if name in named else text)
        if table is not None:
            _note(check, node, function, table, own=own)
        check.method.called[function] = None
        result = _KINDS[str(signature.return_annotation)]
        return result, f"{function.__name__}({', '.join(texts)})"

    return checked


def _table(check: Expressions, argument: ast.expr) -> RuleTable:
    table = check.reference(argument) if isinstance(argument, ast.Name) else None
    if not isinstance(table, RuleTable):
        raise check.problem(argument, "this argument", "name the parameter that is a table")
    check.use(f"t_{table.name}")
    return table


def _row(check: Expressions, table: RuleTable, value: Value) -> str:
    """A row of a table, which must exist."""
    if value.text == "v_own":
        return value.text
    check.use(f"n_{table.name}")
    return f"int64(existing({value.text}, n_{table.name}[{places.ROWS}]))"


def _number(check: Expressions, argument: ast.expr, wanted: str) -> Value:
    value = check.as_number(argument, check.value(argument))
    if wanted == "float":
        return check.as_real(value)
    if value.kind is not ValueKind.INT:
        raise check.problem(argument, f"{value.kind.value} here", "write int(...)")
    return value


def _argument(check: Expressions, argument: ast.expr, wanted: str) -> str:
    if wanted == "Draws":
        if check.reference(argument) is not Given.CHANCE:
            raise check.problem(argument, "this argument", "name the parameter of type Draws")
        check.method.draws = True
        return "words"
    if wanted in _SHAPES:
        shape = check.reference(argument)
        if not isinstance(shape, RuleGrid) or shape.type.__name__ != wanted:
            what = f"this argument, in place of {_SHAPES[wanted]}"
            raise check.problem(argument, what, f"name a parameter of type {wanted}")
        return check.use(shape.text).text
    return _number(check, argument, wanted).text


def _note(
    check: Expressions, node: ast.AST, function: FunctionType, table: RuleTable, *, own: bool
) -> None:
    """Note what a function does with the positions of a table."""
    writes = function in places.CHANGES
    if writes and table.name == "before":
        instead = "change the subject of the rule: before is the state before it"
        raise check.problem(node, f"{function.__name__} of `before`", instead)
    for column in ("cell", "x", "y"):
        check.note(node, table.name, column, own=own, writes=writes)
    if writes and not own:
        # The row may have been activated before, or may be activated later.
        check.note(node, table.name, ANY, own=False)


ANY: Final = "*"
"""In place of a column: all of them."""
FUNCTIONS_OF_RULES: Final[dict[Any, OfRules]] = {
    draws.shuffle: _shuffle,
    **{function: _draws(name) for name, function in DISTRIBUTIONS.items()},
    **{function: _of_space(function) for function in places.FUNCTIONS},
}


def instead_of(name: str, rule: bool, function: Any = None) -> str:
    """What to write in place of a function that has no machine code."""
    last = name.rpartition(".")[2]
    if _is_random(function):
        if rule:
            return "draw from the parameter of type Draws: random(draws), integers(draws, 6)"
        own = f"write moment.chance.{last if last in DISTRIBUTIONS else 'random'}(...)"
        return CHOICES.get(last, own)
    if last in FUNCTIONS_INSTEAD:
        return FUNCTIONS_INSTEAD[last]
    if last in ("power", "float_power"):
        return "write portable.power(x, y)"
    if getattr(function, "__module__", "") == "time":
        return FUNCTIONS_INSTEAD["time"]
    if isinstance(function, type) and issubclass(function, np.generic):
        return "write int(...) or float(...)"
    if function in (np.zeros, np.ones, np.full, np.empty, np.array):
        return "make a list and assign it to a variable: values = [0.0] * 4"
    renamed = f"a{last[3:]}" if last.startswith("arc") else last
    for module in (portable, math, builtins):
        if getattr(module, renamed, None) in FUNCTIONS:
            owner = "" if module is builtins else f"{module.__name__.rpartition('.')[2]}."
            return f"use {owner}{renamed}"
    return "compute it with numbers and operators"


def _is_random(function: Any) -> bool:
    owner: object = getattr(function, "__self__", None)
    modules = str(getattr(function, "__module__", "")), type(owner).__module__
    return any(each.startswith(("random", "numpy.random", "secrets")) for each in modules)
