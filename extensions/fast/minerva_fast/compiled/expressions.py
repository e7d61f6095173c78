"""Expressions of a compiled method: their kinds, with Python's results or a fault."""

from __future__ import annotations

import ast
from collections.abc import Callable
from types import FunctionType
from typing import Any, Final

from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import EventType
from minerva_fast.compiled.draw_calls import draw
from minerva_fast.compiled.form import (
    BinaryOperation,
    Call,
    Choice,
    Constant,
    Expression,
    Item,
    Logic,
    UnaryOperation,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.functions import FUNCTIONS, instead_of
from minerva_fast.compiled.names import (
    AgentItself,
    BoundMethod,
    Chance,
    EventItself,
    Known,
    LocalNames,
    Method,
    Moment,
    Reference,
)
from minerva_fast.compiled.refused import EXPRESSIONS
from minerva_fast.compiled.sequences import Sequences

_COMPARISONS: Final[dict[type[ast.cmpop], str]] = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}


class Expressions(Sequences):
    """Checks the expressions of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        super().__init__(method, scope)
        self._checks: dict[type[ast.AST], Callable[[Any], Expression]] = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._attribute,
            ast.BinOp: self._operation,
            ast.UnaryOp: self._unary,
            ast.BoolOp: self._logic,
            ast.Compare: self._comparison,
            ast.IfExp: self._choice,
            ast.Call: self._call,
            ast.Subscript: self._item,
        }

    def value(self, node: ast.expr) -> Expression:
        """The checked form of an expression. Raises NotCompilable."""
        check = self._checks.get(type(node))
        if check is None:
            raise self.problem(node, *EXPRESSIONS.get(type(node), ("this expression", "")))
        return check(node)

    # --- conditions ---

    def _logic(self, node: ast.BoolOp) -> Expression:
        values = [self.value(value) for value in node.values]
        if any(value.kind is not ValueKind.BOOL for value in values):
            raise self.problem(
                node,
                "`and` or `or` of values that are not bools, as a value",
                "compare them, or write `a if a else b`",
            )
        return Logic("and" if isinstance(node.op, ast.And) else "or", tuple(values))

    def _choice(self, node: ast.IfExp) -> Expression:
        test, yes, no = self.truth(node.test), self.value(node.body), self.value(node.orelse)
        kind, (yes, no) = self.alike(node, [yes, no])
        return Choice(kind, test, yes, no)

    def _comparison(self, node: ast.Compare) -> Expression:
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.In | ast.NotIn):
            return self._membership(node)
        nodes = [node.left, *node.comparators]
        values = [self.value(each) for each in nodes]
        # A middle value is used twice, so it must not draw a number.
        if not all(isinstance(value, Constant | Variable | Item) for value in values[1:-1]):
            raise self.problem(
                node,
                "a chain of comparisons with a computed value in the middle",
                "assign that value to a variable first",
            )
        parts = [
            self.compared(node, operator, left, right)
            for operator, left, right in zip(node.ops, values, values[1:], strict=False)
        ]
        return parts[0] if len(parts) == 1 else Logic("and", tuple(parts))

    def compared(
        self, node: ast.AST, operator: ast.cmpop, left: Expression, right: Expression
    ) -> Expression:
        """The comparison of two values."""
        sign = _COMPARISONS.get(type(operator))
        if sign is None:
            raise self.problem(node, "`is`", "compare with ==, or use a bool attribute")
        texts = (left.kind is ValueKind.TEXT) + (right.kind is ValueKind.TEXT)
        if texts == 1:
            raise self.problem(node, "a text compared with a number", "compare equal types")
        if texts:
            if sign not in ("==", "!="):
                raise self.problem(node, "the order of texts", "compare texts with == or != only")
            return BinaryOperation(ValueKind.BOOL, sign, left, right)
        left, right = (
            Call(ValueKind.INT, "int", (each,)) if each.kind is ValueKind.BOOL else each
            for each in (left, right)
        )
        # Python compares an int with a real exactly, without rounding it.
        if left.kind is not right.kind:
            left, right = self.as_mixed(left), self.as_mixed(right)
        return BinaryOperation(ValueKind.BOOL, sign, left, right)

    def _membership(self, node: ast.Compare) -> Expression:
        value, members = self.value(node.left), self.members(node)
        if not isinstance(value, Constant | Variable | Item):
            raise self.problem(
                node, "`in` of a computed value", "assign that value to a variable first"
            )
        parts = [self.compared(node, ast.Eq(), value, each) for each in members]
        either = parts[0] if len(parts) == 1 else Logic("or", tuple(parts))
        return (
            UnaryOperation(ValueKind.BOOL, "not", either)
            if isinstance(node.ops[0], ast.NotIn)
            else either
        )

    # --- calls ---

    def _call(self, node: ast.Call) -> Expression:
        if isinstance(node.func, ast.Attribute):
            base = self.reference(node.func.value)
            if isinstance(base, Chance):
                return draw(self, node, node.func.attr)
            if isinstance(base, Moment):
                raise self.problem(
                    node, f"moment.{node.func.attr}(...) here", "write it as a statement of its own"
                )
        reference = self.reference(node.func)
        if isinstance(reference, BoundMethod):
            return self.helper(node, reference.function, (AgentItself(),))
        if isinstance(reference, Known):
            return self._call_known(node, reference.value)
        if isinstance(node.func, ast.Attribute):
            # A more precise error, if the value itself is the problem.
            owner = isinstance(self.reference(node.func.value), AgentItself)
            self.value(node.func if owner else node.func.value)
            raise self.problem(
                node, f"the method {node.func.attr} of a value", "use numbers and operators"
            )
        raise self.problem(node, "a call of this value", "call a function of the module")

    def _call_known(self, node: ast.Call, function: Any) -> Expression:
        if function is len:
            return self._length(node)
        known = FUNCTIONS.get(_key(function))
        if known is not None:
            if node.keywords:
                raise self.problem(node, "named arguments of this function", "write them in order")
            arguments = [self.value(argument) for argument in node.args]
            return known(self, node, arguments)
        if isinstance(function, FunctionType):
            return self.helper(node, function, ())
        if isinstance(function, EventType):
            raise self.problem(node, "an event as a value", "write moment.emit(...) around it")
        name = ast.unparse(node.func)
        raise self.problem(node, f"the function {name}", instead_of(name))

    def _length(self, node: ast.Call) -> Expression:
        if len(node.args) == 1 and not node.keywords:
            if isinstance(self.reference(node.args[0]), EventItself):
                return self.count_of_events(node)
            constant = self._constant_tuple(node.args[0])
            if constant is not None:
                return Constant(ValueKind.INT, len(constant))
            sequence = self.sequence(node.args[0])
            if sequence is not None:
                return Constant(ValueKind.INT, sequence[2])
        raise self.problem(node, "the length of this value", "use a constant tuple or a list")

    def count_of_events(self, node: ast.AST) -> Expression:
        """The number of events in a batch."""
        event = next(r for r in self.scope.references.values() if isinstance(r, EventItself))
        if not event.batch:
            raise self.problem(node, "the length of an event", "an event has data only")
        return BinaryOperation(
            ValueKind.INT, "-", Variable(ValueKind.INT, "e_end"), Variable(ValueKind.INT, "e_begin")
        )

    def helper(
        self, node: ast.Call, function: FunctionType, bound: tuple[Reference, ...]
    ) -> Expression:
        """A call of a function of the module, or of a method of the class."""
        raise NotImplementedError


def _key(function: Any) -> Any:
    """The object by which a known function is looked up; None if it cannot be a key."""
    try:
        hash(function)
    except TypeError:
        return None
    return function


def is_empty(value: Any) -> bool:
    """Whether an object of the module is the empty string ε."""
    return isinstance(value, Scene) and not value.pieces
