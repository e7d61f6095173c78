"""Views of one agent (θ): results that are strings of primitives and transformations.

A view is checked like a method; what differs is its result. Each `return` has a *template*, a
string whose parameters are values of the row. Rows append their values to the output of a template.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from minerva_bus.grammar.symbols import Primitive, Transformation
from minerva_fast.compiled.form import (
    Append,
    Expression,
    Figure,
    Finish,
    Shown,
    Slot,
    Statement,
)
from minerva_fast.compiled.method import (
    CheckedMethod,
    kinds_of_attributes,
    parameters_of,
    program_of,
)
from minerva_fast.compiled.names import (
    AgentItself,
    EventItself,
    Known,
    LocalNames,
    Method,
    event_type_of,
)
from minerva_fast.compiled.origin import Origin
from minerva_fast.compiled.shared import with_shared
from minerva_fast.compiled.statements import Statements

_RESULTS = "return EMPTY, or primitives in transformations: TAt(self.x, self.y)(PSpot())"


def checked_views(cls: Any, methods: Mapping[str, Callable[..., Any]]) -> dict[str, CheckedMethod]:
    """The programs of a class's compiled views by event type. Raises NotCompilable."""
    types = {field.name: field.type for field in cls.kind.fields.all}
    return {
        event_type: _checked_view(cls, types, event_type, function)
        for event_type, function in sorted(methods.items())
    }


def _checked_view(
    cls: Any, types: Mapping[str, Any], event_type: str, function: Callable[..., Any]
) -> CheckedMethod:
    origin = Origin.of(function)
    kinds = kinds_of_attributes(cls, types)
    method = Method(cls, types, kinds, event_type_of(function, event_type))
    meanings = AgentItself(), EventItself(batch=False)
    scope = LocalNames(origin, parameters_of(origin, ("self", "event"), meanings))
    body = _ViewStatements(method, scope).function()
    program = with_shared(program_of(event_type, method, scope, body))
    return CheckedMethod(program, method.constants)


class _ViewStatements(Statements):
    """Checks the statements of a view."""

    def _return(self, node: ast.Return) -> list[Statement]:
        if isinstance(node.value, ast.IfExp):
            return self._return_choice(node, node.value)
        made, values, figures = list[Statement](), list[Expression](), list[Figure]()
        for part in _summands(node, node.value):
            if not self._is_epsilon(part):
                figures.append(self._figure(part, made, values))
        widths = {bool(figure.width) for figure in figures}
        if len(widths) > 1:
            raise self.problem(
                node, "a sum of figures with and without parameters", "give each a parameter"
            )
        if figures:
            slots = tuple(Slot(str(at), value.kind) for at, value in enumerate(values))
            output = self.method.shown(Shown(tuple(figures), slots))
            made.append(Append(output, tuple(values)))
        self.scope.assigned = None
        return [*made, Finish(True, ())]

    def _end(self, reached: bool) -> list[Statement]:
        if reached:
            raise self.problem(
                self.scope.origin.tree, "a path without a result", "return EMPTY to show nothing"
            )
        return []

    def _store_attribute(self, target: ast.Attribute, value: Expression) -> Statement:
        raise self.problem(target, "a view that changes attributes", "use a local variable")

    def _figure(self, node: ast.expr, made: list[Statement], values: list[Expression]) -> Figure:
        """A primitive, or a transformation with one figure in its scope."""
        if not isinstance(node, ast.Call):
            raise self.problem(node, "this result of a view", _RESULTS)
        if not isinstance(node.func, ast.Call):
            return self._primitive(node, made, values)
        symbol = self._symbol(node.func)
        if not isinstance(symbol, Transformation) or len(node.args) > 1 or node.keywords:
            raise self.problem(
                node, "this scope", "write one figure in it, and add further ones: a + b"
            )
        names = self._values(node.func, symbol, made, values)
        if not names:
            raise self.problem(
                node.func, f"{symbol.name} without parameters", "give it one, such as its default"
            )
        inside = [self._figure(each, made, values) for each in node.args]
        return Figure(symbol, names, tuple(inside))

    def _primitive(self, node: ast.Call, made: list[Statement], values: list[Expression]) -> Figure:
        symbol = self._symbol(node)
        if not isinstance(symbol, Primitive):
            raise self.problem(node, "this result of a view", _RESULTS)
        return Figure(symbol, self._values(node, symbol, made, values))

    def _symbol(self, node: ast.Call) -> Any:
        reference = self.reference(node.func)
        return reference.value if isinstance(reference, Known) else None

    def _values(
        self,
        node: ast.Call,
        symbol: Primitive | Transformation,
        made: list[Statement],
        values: list[Expression],
    ) -> tuple[str, ...]:
        """The names of the parameters that are given; their values are appended."""
        named = {str(keyword.arg): keyword.value for keyword in node.keywords}
        statements, known = self.given_values(node, symbol.name, symbol.fields, node.args, named)
        made += statements
        values += known.values()
        return tuple(known)


def _summands(node: ast.AST, value: ast.expr | None) -> Sequence[ast.expr]:
    """The parts of a result, from left to right; `return` alone is None."""
    if value is None:
        return [ast.copy_location(ast.Constant(None), node)]
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.Add):
        return [*_summands(node, value.left), *_summands(node, value.right)]
    return [value]
