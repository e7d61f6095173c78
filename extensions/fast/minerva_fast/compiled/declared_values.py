"""Values of the fields of newborns and emitted events, checked against their declared types."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence

from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.types import Type
from minerva_fast.compiled.expressions import Expressions
from minerva_fast.compiled.form import (
    Assign,
    BinaryOperation,
    Call,
    Constant,
    Expression,
    If,
    Jump,
    Logic,
    Statement,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.names import kind_of, limit_of


class DeclaredValues(Expressions):
    """Checks the values that a method gives for declared fields."""

    def _held(self, value: Expression) -> tuple[Variable, Statement]:
        """A value in a variable of the generated function."""
        name = self.scope.temporary()
        return Variable(value.kind, name), Assign(name, value)

    def declared(self, node: ast.AST, name: str, declared: Type, value: Expression) -> Expression:
        """A value converted to a declared type, as where a string is made."""
        kind = kind_of(declared)
        if kind is ValueKind.REAL and value.kind.number:
            return self.as_real(value)
        if kind is not value.kind:
            instead = (
                "write int(...)" if kind is ValueKind.INT and value.kind.number else "convert it"
            )
            if kind is ValueKind.BOOL:
                instead = "compare: x != 0"
            raise self.problem(
                node, f"{name} is declared as {declared}, and this is {value.kind.value}", instead
            )
        if declared.words and isinstance(value, Constant):
            texts = list(self.method.texts)
            if texts[int(value.value)] not in declared.words:
                raise self.problem(
                    node,
                    f"{name} must not be {texts[int(value.value)]!r}",
                    f"use one of {', '.join(declared.words)}",
                )
        return value

    def _bound_values(
        self, node: ast.Call, owner: str, fields: Fields, named: Mapping[str, ast.expr]
    ) -> tuple[list[Statement], list[Expression]]:
        """The values of all fields in order, held in variables, and checked against their types."""
        positional = node.args if owner[:1] == "e" else node.args[1:]
        made, values = self.given_values(node, owner, fields, positional, named)
        return made, [
            values[each.name] if each.name in values else self._default(node, owner, each)
            for each in fields.all
        ]

    def given_values(
        self,
        node: ast.Call,
        owner: str,
        fields: Fields,
        positional: Sequence[ast.expr],
        named: Mapping[str, ast.expr],
    ) -> tuple[list[Statement], dict[str, Expression]]:
        """The values of the fields that a call gives, held in variables, and checked."""
        if any(isinstance(argument, ast.Starred) for argument in node.args) or "None" in named:
            raise self.problem(node, "arguments with *", "write each argument")
        if len(positional) > len(fields.names):
            raise self.problem(node, f"{owner} takes {len(fields.names)} values")
        given = dict(zip(fields.names, positional, strict=False))
        for name in given.keys() & named.keys():
            raise self.problem(node, f"two values of {name} for {owner}", "leave out one of them")
        given |= named
        for name in given:
            if name not in fields.names:
                listed = ", ".join(fields.names) or "none"
                raise self.problem(node, f"{owner} has no {name}", f"it has {listed}")
        made, values = list[Statement](), dict[str, Expression]()
        types = {each.name: each for each in fields.all}
        for name, argument in given.items():  # in the order in which Python evaluates them
            held, statement = self._held(
                self.declared(argument, name, types[name].type, self.value(argument))
            )
            values[name] = held
            made += [statement, *self._check_fit(types[name].type, held)]
        return made, values

    def _default(self, node: ast.AST, owner: str, field: Field) -> Expression:
        constant = None if field.default is None else self.constant_of(field.default)
        if constant is None:
            raise self.problem(node, f"{owner} needs a value for {field.name} ({field.type})")
        return constant

    def _check_fit(self, declared: Type, value: Variable) -> list[Statement]:
        """A fault if a value is not of its type: not finite, out of range or another word."""
        test = self.fits(declared, value)
        return [] if test is None else [If(test, (), (Jump.FAULT,))]

    def fits(self, declared: Type, value: Variable) -> Expression | None:
        """Whether a value fits its declared type; None if every value does."""
        if declared.words:
            words = [
                BinaryOperation(ValueKind.BOOL, "==", value, self.text(word))
                for word in declared.words
            ]
            return words[0] if len(words) == 1 else Logic("or", tuple(words))
        limit = limit_of(declared)
        if declared.kind == "real":
            ends = (Constant(ValueKind.REAL, limit.least), Constant(ValueKind.REAL, limit.most))
            return Call(ValueKind.BOOL, "within", (value, *ends))
        if declared.range is not None:
            ends = (Constant(ValueKind.REAL, limit.least), Constant(ValueKind.REAL, limit.most))
            real = self.fault(ValueKind.MIXED, "exact", value)
            return Call(ValueKind.BOOL, "within", (real, *ends))
        return None
