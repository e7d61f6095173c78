"""Calls of `moment.chance` in compiled methods."""

from __future__ import annotations

import ast
from functools import partial
from typing import TYPE_CHECKING

from minerva_bus.errors import nearest
from minerva_fast.compiled.form import Call, Constant, Expression, ValueKind
from minerva_fast.compiled.functions import DISTRIBUTIONS, Distribution
from minerva_fast.compiled.names import ROW, WORDS
from minerva_fast.compiled.refused import CHOICES

if TYPE_CHECKING:
    from minerva_fast.compiled.expressions import Expressions


def draw(check: Expressions, node: ast.Call, name: str) -> Expression:
    """A call of `moment.chance`."""
    distribution = DISTRIBUTIONS.get(name)
    if distribution is None:
        near = nearest(name, list(DISTRIBUTIONS))
        raise check.problem(node, f"moment.chance has no {name}{near}", CHOICES.get(name, ""))
    arguments = _arguments(check, node, distribution)
    check.method.draws = True
    if name == "exponential":
        # As in Python: the negative of an int 0 is 0, which a conversion before would change.
        arguments = [check.negative(node, arguments[0])]
    convert = partial(_bound, check) if name == "integers" else check.as_mixed
    given = [convert(argument) for argument in arguments]
    if name == "integers":
        return check.fault(distribution.kind, "draw_integers", WORDS, ROW, *given)
    return Call(distribution.kind, f"draw_{name}", (WORDS, ROW, *given))


def _bound(check: Expressions, value: Expression) -> Expression:
    return check.fault(ValueKind.INT, "bound", value)


def _arguments(check: Expressions, node: ast.Call, distribution: Distribution) -> list[Expression]:
    left = distribution.names[len(node.args) :]
    names = [str(keyword.arg) for keyword in node.keywords]
    if len(node.args) > len(distribution.names) or not {*names} <= {*left}:
        raise check.problem(node, f"these arguments; expected {', '.join(distribution.names)}")
    # Arguments may draw, and Python evaluates them in the order in which they are written.
    if names != sorted(names, key=left.index):
        raise check.problem(
            node, "named arguments in another order", f"write them as {', '.join(left)}"
        )
    given: dict[str, ast.expr] = dict(zip(distribution.names, node.args, strict=False))
    given |= {str(keyword.arg): keyword.value for keyword in node.keywords}
    values = {
        name: check.as_number(argument, check.value(argument)) for name, argument in given.items()
    }
    if distribution.kind is ValueKind.INT:
        if any(value.kind is not ValueKind.INT for value in values.values()):
            raise check.problem(node, "bounds that are not ints", "convert with int(...)")
        if "high" not in values and "low" in values:
            values = {"low": Constant(ValueKind.INT, 0), "high": values["low"]}
    for name, default in distribution.defaults.items():
        values.setdefault(name, Constant(ValueKind.REAL, default))
    missing = [name for name in distribution.names if name not in values]
    if missing:
        raise check.problem(node, f"the argument {missing[0]} is missing")
    return [values[name] for name in distribution.names]
