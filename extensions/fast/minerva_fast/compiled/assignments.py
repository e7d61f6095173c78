"""Assignments of a compiled method: to variables, attributes, and lists of fixed length."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Final, cast

from minerva_bus.grammar.types import Type
from minerva_fast.compiled.form import (
    Assign,
    Constant,
    Expression,
    Item,
    ListSlot,
    SetItem,
    Statement,
    ValueKind,
)
from minerva_fast.compiled.names import (
    AgentItself,
    joined,
)
from minerva_fast.compiled.outputs import Outputs
from minerva_fast.compiled.sequences import Column

MAX_ITEMS: Final = 1_000
"""Maximum length of a local list."""


class Assignments(Outputs):
    """Checks the assignments of one function."""

    def _assign(self, node: ast.Assign) -> list[Statement]:
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            name = node.targets[0]
            if isinstance(node.value, ast.List | ast.BinOp) and self._is_list(node.value):
                return self._new_list(name, node.value)
            if self._is_litter(node.value):
                return self._collect(name, node.value)
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Tuple | ast.List):
            return self._unpack(node, node.targets[0])
        value = self.value(node.value)
        if len(node.targets) == 1:
            return self.store(node.targets[0], value)
        held, statement = self._held(value)
        return [statement, *(s for target in node.targets for s in self.store(target, held))]

    def _unpack(self, node: ast.Assign, target: ast.Tuple | ast.List) -> list[Statement]:
        targets = target.elts
        if isinstance(node.value, ast.Subscript):
            columns = self.columns(node.value.value, target)
            if columns is not None:
                return self._unpack_item(node.value, columns)
        if not isinstance(node.value, ast.Tuple) or len(node.value.elts) != len(targets):
            raise self.problem(
                node, "an assignment to several names", "write as many values: a, b = b, a"
            )
        held = [self._held(self.value(each)) for each in node.value.elts]
        made = [statement for _, statement in held]
        for each, (value, _) in zip(targets, held, strict=True):
            made += self.store(each, value)
        return made

    def _unpack_item(self, item: ast.Subscript, columns: Sequence[Column]) -> list[Statement]:
        """Assign the values of one tuple of a constant tuple of tuples."""
        index, statement = self._held(self.index(item, columns[0][3]))
        made = [statement]
        for target, sequence, kind, length in columns:
            made += self.store(target, Item(kind, sequence, length, index))
        return made

    def _annotated(self, node: ast.AnnAssign) -> list[Statement]:
        if node.value is None:
            return []
        return self._assign(ast.copy_location(ast.Assign([node.target], node.value), node))

    def _augmented(self, node: ast.AugAssign) -> list[Statement]:
        target = node.target
        if isinstance(target, ast.Name) and target.id in self.scope.litters:
            whole = ast.BinOp(ast.Name(target.id, ast.Load()), node.op, node.value)
            return self._collect(target, ast.copy_location(whole, node))
        if isinstance(target, ast.Subscript):
            return self._augmented_item(node, target)
        return self.store(target, self._sum(node, self.value(_loaded(target))))

    def _sum(self, node: ast.AugAssign, old: Expression) -> Expression:
        """The new value of `target += value`, or with another operator."""
        return self.of_values(node, node.op, old, self.value(node.value))

    def _augmented_item(self, node: ast.AugAssign, target: ast.Subscript) -> list[Statement]:
        known = self._own_list(target)
        # Held, because the index is used twice and may draw a number.
        index, statement = self._held(self.index(target, known.length))
        old = Item(known.kind, f"l_{known.name}", known.length, index)
        return [statement, self._set_item(target, known, index, self._sum(node, old))]

    def store(self, target: ast.expr, value: Expression) -> list[Statement]:
        """Assign a value to a variable, an attribute, or an item of a list."""
        if isinstance(target, ast.Name):
            return [self.assign(target, value)]
        if isinstance(target, ast.Attribute):
            return [self._store_attribute(target, value)]
        if isinstance(target, ast.Subscript):
            return [self._store_item(target, value)]
        raise self.problem(target, "an assignment to this", "assign to a variable or an attribute")

    def assign(self, target: ast.Name, value: Expression) -> Statement:
        """Assign to a local variable; its kind is that of all its values."""
        name, scope = target.id, self.scope
        if name in scope.references or name in scope.lists or name in scope.litters:
            raise self.problem(target, f"another value for {name}", "use another variable")
        scope.lines.setdefault((name, value.kind), target.lineno)
        kind = joined(scope.kinds.get(name, value.kind), value.kind)
        if kind is None:
            old = scope.kinds[name]
            line = scope.lines.get((name, old), target.lineno)
            raise self.problem(
                target,
                f"{name} is {value.kind.value} here and {old.value} in line {line}",
                "use two variables",
            )
        scope.kinds[name] = kind
        if scope.assigned is not None:
            scope.assigned.add(name)
        return Assign(f"v_{name}", self.as_mixed(value) if kind is ValueKind.MIXED else value)

    def _store_attribute(self, target: ast.Attribute, value: Expression) -> Statement:
        name, method = target.attr, self.method
        if not isinstance(self.reference(target.value), AgentItself):
            raise self.problem(target, "an assignment to this", "change attributes of self only")
        if self.scope.helper:
            raise self.problem(
                target, "a method that changes attributes", "return the value and assign it there"
            )
        if name not in method.types:
            if name.startswith("_"):
                raise self.problem(target, "a temporary attribute", "use a local variable")
            self.value(target)
            raise self.problem(target, f"an assignment to self.{name}", "declare the attribute")
        method.writes[name] = None
        method.reads[name] = None
        return Assign(f"a_{name}", self._fitting(target, name, method.types[name], value))

    def _fitting(self, node: ast.AST, name: str, declared: Type, value: Expression) -> Expression:
        """A value of an attribute's kind; the attribute is MIXED once it is set to an int."""
        kind = self.method.kinds[name]
        if kind.number and declared.kind == "real" and value.kind.number:
            if value.kind is not ValueKind.REAL:
                # Python keeps the int until the end of the frame.
                self.method.kinds[name] = ValueKind.MIXED
                line: int = getattr(node, "lineno", 0)
                self.method.int_lines.setdefault(f"a_{name}", line)
            return self.as_mixed(value)
        return self.declared(node, name, declared, value)

    def _own_list(self, target: ast.Subscript) -> ListSlot:
        node = target.value
        if not isinstance(node, ast.Name) or node.id not in self.scope.lists:
            raise self.problem(
                target, "an assignment to an item of this", "make a list: values = [0.0] * 4"
            )
        return self.scope.lists[node.id]

    def _store_item(self, target: ast.Subscript, value: Expression) -> Statement:
        known = self._own_list(target)
        return self._set_item(target, known, self.index(target, known.length), value)

    def _set_item(
        self, target: ast.Subscript, known: ListSlot, index: Expression, value: Expression
    ) -> Statement:
        if value.kind is not known.kind:
            raise self.problem(
                target,
                f"{known.name} holds items of one type, {known.kind.value}; this is"
                f" {value.kind.value}",
                "use one type, such as 0.0 and float(...)",
            )
        return SetItem(f"l_{known.name}", known.length, index, value)

    # --- lists of fixed length ---

    def _is_list(self, node: ast.expr) -> bool:
        return isinstance(node, ast.List) or (
            isinstance(node, ast.BinOp)
            and isinstance(node.op, ast.Mult)
            and isinstance(node.left, ast.List)
        )

    def _new_list(self, target: ast.Name, node: ast.List | ast.BinOp) -> list[Statement]:
        items, times = node, 1
        if isinstance(node, ast.BinOp):
            count = self.value(node.right)
            if (
                not isinstance(count, Constant)
                or count.kind is not ValueKind.INT
                or count.value < 1
            ):
                raise self.problem(
                    node.right, "a list whose length is not a constant", "use a constant length"
                )
            items, times = node.left, int(count.value)
        elements = cast("ast.List", items).elts
        if self.scope.helper:
            raise self.problem(node, "a list within a helper", "make the list in the method")
        if not 1 <= len(elements) * times <= MAX_ITEMS:
            raise self.problem(
                node, f"a list of {len(elements) * times} items", f"use 1 to {MAX_ITEMS} items"
            )
        kind, values = self.alike(node, [self.value(each) for each in elements])
        if kind is ValueKind.MIXED:
            raise self.mixed(node)
        name, length = target.id, len(elements) * times
        slot = ListSlot(name, kind, length)
        if self.scope.lists.setdefault(name, slot) != slot or name in self.scope.kinds:
            raise self.problem(target, f"another value for {name}", "use another variable")
        held = [self._held(value) for value in values]
        made = [statement for _, statement in held]
        for index in range(length):
            value = held[index % len(held)][0]
            made.append(SetItem(f"l_{name}", length, Constant(ValueKind.INT, index), value))
        return made


def _loaded(target: ast.expr) -> ast.expr:
    """The expression that reads what an assignment writes."""
    text = ast.unparse(target)
    read = ast.parse(text, mode="eval").body
    for node in ast.walk(read):
        ast.copy_location(node, target)
    return read
