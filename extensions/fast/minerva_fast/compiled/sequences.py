"""Sequences of fixed length in a compiled method: local lists, and tuples of constants."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any, Final, TypeAlias, cast

from minerva_fast.compiled.arithmetic import Arithmetic
from minerva_fast.compiled.form import Constant, Expression, Item, ValueKind
from minerva_fast.compiled.names import Known

_TABLE: Final = 10_000

Nested: TypeAlias = "Constant | tuple[Nested, ...]"
"""A constant, or a tuple of constants, or of such tuples."""

Column: TypeAlias = tuple[ast.expr, str, ValueKind, int]
"""A name that takes the items of a sequence in turn: the sequence, its kind and its length."""


class Sequences(Arithmetic):
    """Checks items of sequences, and values that are looked for in them."""

    def _item(self, node: ast.Subscript) -> Expression:
        sequence = self.sequence(node.value)
        if sequence is None:
            raise self.problem(
                node, "an item of this value", "index a constant tuple or a local list of numbers"
            )
        name, kind, length = sequence
        return Item(kind, name, length, self.index(node, length))

    def index(self, node: ast.Subscript, length: int) -> Expression:
        """An index, counted from the start."""
        if isinstance(node.slice, ast.Slice | ast.Tuple):
            raise self.problem(node, "a slice", "write a for loop over the index")
        index = self.value(node.slice)
        if index.kind is not ValueKind.INT:
            raise self.problem(node.slice, f"{index.kind.value} as an index", "use an int")
        return self.fault(ValueKind.INT, "place", index, Constant(ValueKind.INT, length))

    def sequence(self, node: ast.expr) -> tuple[str, ValueKind, int] | None:
        """The variable, kind of items and length of a local list or a constant tuple."""
        if isinstance(node, ast.Name) and node.id in self.scope.lists:
            known = self.scope.lists[node.id]
            return f"l_{known.name}", known.kind, known.length
        constant = self._constant_tuple(node)
        return None if constant is None else self._table(node, self._nested(node, constant))

    def columns(self, node: ast.expr, target: ast.expr) -> list[Column] | None:
        """The names of a loop with the sequences that they go over; None if there are none."""
        if isinstance(target, ast.Name):
            sequence = self.sequence(node)
            if sequence is not None:
                return [(target, *sequence)]
        if not isinstance(node, ast.Tuple | ast.List) and self._constant_tuple(node) is None:
            return None
        return self._columns(node, target, cast("tuple[Nested, ...]", self._constants(node)))

    def _columns(self, node: ast.expr, target: ast.expr, items: Sequence[Nested]) -> list[Column]:
        if not isinstance(target, ast.Tuple | ast.List):
            return [(target, *self._table(node, items))]
        names = target.elts
        if not items or any(isinstance(i, Constant) or len(i) != len(names) for i in items):
            raise self.problem(
                target,
                f"{len(names)} names for items that are not tuples of {len(names)} constants",
                "write as many values in each: for dx, dy in ((0, 1), (1, 0))",
            )
        rows = cast("Sequence[tuple[Nested, ...]]", items)
        parts = zip(names, zip(*rows, strict=True), strict=True)
        return [column for name, part in parts for column in self._columns(node, name, part)]

    def _constant_tuple(self, node: ast.expr) -> tuple[Any, ...] | None:
        """The tuple that a name of the module or class refers to."""
        reference = self.reference(node) if isinstance(node, ast.Name | ast.Attribute) else None
        constant: Any = reference.value if isinstance(reference, Known) else None
        return cast("tuple[Any, ...]", constant) if type(constant) is tuple else None

    def _constants(self, node: ast.expr) -> Nested:
        """A tuple that is written here, or a constant."""
        if isinstance(node, ast.Tuple | ast.List):
            return tuple(map(self._constants, node.elts))
        constant = self._constant_tuple(node)
        if constant is not None:
            return self._nested(node, constant)
        value = self.value(node)
        if not isinstance(value, Constant):
            raise self.problem(
                node,
                "a computed value in a tuple of a loop",
                "make a list and loop over it: values = [self.x, self.y]",
            )
        return value

    def _nested(self, node: ast.expr, values: tuple[Any, ...]) -> tuple[Nested, ...]:
        """A tuple of the module or class."""
        items: list[Nested] = []
        for value in values:
            inner = type(value) is tuple
            item = (
                self._nested(node, cast("tuple[Any, ...]", value))
                if inner
                else self.constant_of(value)
            )
            if item is None:
                raise self._no_table(node)
            items.append(item)
        return tuple(items)

    def _no_table(self, node: ast.expr) -> Exception:
        return self.problem(
            node, f"the tuple {ast.unparse(node)}", f"use 1 to {_TABLE:,} numbers, bools or texts"
        )

    def _table(self, node: ast.expr, items: Sequence[Nested]) -> tuple[str, ValueKind, int]:
        constants = [item for item in items if isinstance(item, Constant)]
        if len(constants) != len(items):
            raise self.problem(
                node,
                f"a tuple in the tuple {ast.unparse(node)} as a value",
                "name its values: for dx, dy in ((0, 1), (1, 0))",
            )
        if not 1 <= len(items) <= _TABLE:
            raise self._no_table(node)
        kind, converted = self.alike(node, constants)
        numbers = tuple(cast("Constant", item).value for item in converted)
        key = (kind, *map(repr, numbers))
        name, kind = self.method.tables.setdefault(
            (key, numbers), (f"TABLE_{len(self.method.tables)}", kind)
        )
        return name, kind, len(numbers)

    def members(self, node: ast.Compare) -> list[Expression]:
        """The values of a tuple, which is written here or a constant of the module or class."""
        given = node.comparators[0]
        if isinstance(given, ast.Tuple | ast.List | ast.Set) and given.elts:
            return [self.value(each) for each in given.elts]
        values = self._constant_tuple(given)
        if values:
            members = [self.constant_of(each) for each in values]
            if None not in members:
                return [each for each in members if each is not None]
        raise self.problem(
            node, "`in` of something else than a tuple", 'write the values: x in ("a", "b")'
        )
