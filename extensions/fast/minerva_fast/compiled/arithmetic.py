"""Arithmetic in a compiled method: Python's results for numbers of two kinds, or a fault."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Final

from minerva_bus.world.accelerator import NotCompilable
from minerva_fast.compiled.form import (
    BinaryOperation,
    Call,
    Constant,
    Expression,
    Logic,
    UnaryOperation,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.names import STATE, joined
from minerva_fast.compiled.references import INT_BITS, References
from minerva_fast.compiled.refused import REAL_EVERYWHERE

_EXACT: Final = 2**53

_WITH_FAULTS: Final[dict[type[ast.operator], tuple[str, ValueKind]]] = {
    ast.Add: ("add", ValueKind.INT),
    ast.Sub: ("subtract", ValueKind.INT),
    ast.Mult: ("multiply", ValueKind.INT),
    ast.Div: ("divide_ints", ValueKind.REAL),
    ast.FloorDiv: ("floor_divide", ValueKind.INT),
    ast.Mod: ("modulo", ValueKind.INT),
    ast.Pow: ("power_of_ints", ValueKind.INT),
    ast.LShift: ("shift_left", ValueKind.INT),
    ast.RShift: ("shift_right", ValueKind.INT),
}
"""Operators of two ints: a function of `library`, and the kind of its result."""

_BITS: Final[dict[type[ast.operator], str]] = {ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
_PLAIN: Final[dict[type[ast.operator], str]] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
_OF_REALS: Final[dict[type[ast.operator], str]] = {
    ast.Div: "divide",
    ast.FloorDiv: "floor_divide_reals",
    ast.Mod: "modulo_reals",
    ast.Pow: "power",
}

_OF_MIXED: Final[dict[type[ast.operator], str]] = {
    ast.Add: "add_mixed",
    ast.Sub: "subtract_mixed",
    ast.Mult: "multiply_mixed",
    ast.FloorDiv: "floor_divide_mixed",
    ast.Mod: "modulo_mixed",
    ast.Pow: "power_mixed",
}
"""Operators of two numbers of which both may be ints and one may be a real."""


class Arithmetic(References):
    """Checks operators and conversions of numbers."""

    def truth(self, node: ast.expr) -> Expression:
        """An expression as a condition."""
        if isinstance(node, ast.BoolOp):
            operator = "and" if isinstance(node.op, ast.And) else "or"
            return Logic(operator, tuple(map(self.truth, node.values)))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return UnaryOperation(ValueKind.BOOL, "not", self.truth(node.operand))
        return self.as_truth(self.value(node))

    def as_truth(self, value: Expression) -> Expression:
        """Whether a value counts as true."""
        if value.kind is ValueKind.BOOL:
            return value
        empty = Constant(value.kind, 0 if value.kind is ValueKind.INT else 0.0)
        if value.kind is ValueKind.TEXT:
            empty = self.text("")
        return BinaryOperation(ValueKind.BOOL, "!=", value, empty)

    def fault(self, kind: ValueKind, function: str, *arguments: Expression) -> Expression:
        """A call of a function of `library` that marks the row if Python has no such result."""
        return Call(kind, function, (STATE, *arguments))

    def as_number(self, node: ast.AST, value: Expression) -> Expression:
        """A number; a bool counts as 0 or 1, as in Python."""
        if value.kind is ValueKind.BOOL:
            return Call(ValueKind.INT, "int", (value,))
        if value.kind is ValueKind.TEXT:
            raise self.problem(node, "arithmetic with a text", "compare texts with == or != only")
        return value

    def as_real(self, value: Expression) -> Expression:
        """A number as Python converts it to a real."""
        if value.kind is not ValueKind.INT:
            return value
        if isinstance(value, Constant):
            return Constant(ValueKind.REAL, float(value.value))
        return Call(ValueKind.REAL, "float", (value,))

    def as_mixed(self, value: Expression) -> Expression:
        """A number held as a real, of which an int has no other digits."""
        if value.kind is not ValueKind.INT:
            return value
        if isinstance(value, Constant) and abs(value.value) <= _EXACT:
            return Constant(ValueKind.MIXED, float(value.value))
        return self.fault(ValueKind.MIXED, "exact", value)

    def alike(
        self, node: ast.AST, values: Sequence[Expression]
    ) -> tuple[ValueKind, list[Expression]]:
        """Values converted to one kind."""
        kind: ValueKind | None = values[0].kind
        for value in values[1:]:
            kind = joined(kind, value.kind) if kind is not None else None
        if kind is None:
            kinds = " and ".join(sorted({value.kind.value for value in values}))
            raise self.problem(node, f"{kinds} in one place", "use one type")
        return kind, [self.as_mixed(each) if kind is ValueKind.MIXED else each for each in values]

    def _operation(self, node: ast.BinOp) -> Expression:
        return self.of_values(node, node.op, self.value(node.left), self.value(node.right))

    def of_values(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        """The result of an operator between two values."""
        both = left.kind is right.kind is ValueKind.BOOL
        if both and type(operator) in _BITS:  # a bool in Python, and an int here
            raise self.problem(node, "an operator on bits of bools", "write and, or, or !=")
        return self.operation(
            node, operator, self.as_number(node, left), self.as_number(node, right)
        )

    def operation(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        """The result of an operator between two numbers."""
        kinds = {left.kind, right.kind}
        if isinstance(operator, ast.MatMult):
            raise self.problem(node, "the operator @", "write the products")
        if kinds == {ValueKind.INT}:
            return self._of_ints(node, operator, left, right)
        if ValueKind.REAL not in kinds and not isinstance(operator, ast.Div):
            return self._of_mixed(node, operator, left, right)
        return self._of_reals(node, operator, left, right)

    def _of_mixed(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        """The result of an operator that is an int if both numbers are ints, and else a real."""
        function = _OF_MIXED.get(type(operator))
        if function is None:
            raise self.problem(node, "an operator on bits of a real", "convert with int(...)")
        # An int to the power of a negative int is a real.
        if isinstance(operator, ast.Pow) and not (isinstance(right, Constant) and right.value >= 0):
            raise self.mixed(node, left, right)
        return self.fault(ValueKind.MIXED, function, self.as_mixed(left), self.as_mixed(right))

    def mixed(self, node: ast.AST, *values: Expression) -> NotCompilable:
        """The error of arithmetic whose result depends on whether a number is an int."""
        lines = {**self.method.int_lines, **self.scope.int_lines}
        known = [
            f"{value.name[2:]} is set to an int in line {lines[value.name]}; "
            for value in values
            if isinstance(value, Variable) and value.name in lines
        ]
        return self.problem(
            node,
            "a number here is an int in one case and a real in another",
            "".join(known[:1]) + REAL_EVERYWHERE,
        )

    def _of_ints(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        if type(operator) in _BITS:
            return BinaryOperation(ValueKind.INT, _BITS[type(operator)], left, right)
        if isinstance(operator, ast.Pow) and not (isinstance(right, Constant) and right.value >= 0):
            raise self.problem(
                node,
                "a power of ints whose exponent is not a constant from 0 up",
                "make the base a real number: float(n) ** k",
            )
        function, kind = _WITH_FAULTS[type(operator)]
        return self.fault(kind, function, left, right)

    def _of_reals(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        # Python rounds an int to a real for + - * and //; a quotient of two ints is rounded once.
        quotient = isinstance(operator, ast.Div) and ValueKind.REAL not in (left.kind, right.kind)
        convert = self.as_mixed if quotient else self.as_real
        left, right = convert(left), convert(right)
        if type(operator) in _PLAIN:
            return BinaryOperation(ValueKind.REAL, _PLAIN[type(operator)], left, right)
        function = _OF_REALS.get(type(operator))
        if function is None:
            raise self.problem(node, "an operator on bits of a real", "convert with int(...)")
        return self.fault(ValueKind.REAL, function, left, right)

    def _unary(self, node: ast.UnaryOp) -> Expression:
        if isinstance(node.op, ast.Not):
            return self.truth(node)
        operand = self.as_number(node.operand, self.value(node.operand))
        if isinstance(node.op, ast.UAdd):
            return operand
        if isinstance(node.op, ast.Invert):
            if operand.kind is not ValueKind.INT:
                raise self.problem(node, "~ of a real", "convert with int(...)")
            return BinaryOperation(ValueKind.INT, "^", operand, Constant(ValueKind.INT, -1))
        return self.negative(node, operand)

    def negative(self, node: ast.AST, operand: Expression) -> Expression:
        """The negative of a number."""
        if isinstance(operand, Constant) and operand.value > -INT_BITS:
            return Constant(operand.kind, -operand.value)
        if operand.kind is ValueKind.MIXED:
            return self._of_mixed(node, ast.Mult(), operand, Constant(ValueKind.INT, -1))
        if operand.kind is ValueKind.INT:
            return self.fault(ValueKind.INT, "subtract", Constant(ValueKind.INT, 0), operand)
        return UnaryOperation(ValueKind.REAL, "-", operand)
