"""Loops of a compiled method."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TypeAlias

from minerva_fast.compiled.form import (
    Constant,
    Count,
    Expression,
    Item,
    Jump,
    Statement,
    ValueKind,
    Variable,
    While,
)
from minerva_fast.compiled.helper_calls import HelperCalls
from minerva_fast.compiled.names import EventItself, Known, LocalNames, Method

_ZERO = Constant(ValueKind.INT, 0)

Taken: TypeAlias = tuple[ast.expr, Expression]
"""A name of a loop, and the value that it takes in each turn."""


class Loops(HelperCalls):
    """Checks the loops of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        super().__init__(method, scope)
        self._breaks: list[set[str] | None] = []
        """Of each loop around a statement, the variables that have a value at its breaks."""

    def block(self, nodes: Sequence[ast.stmt]) -> list[Statement]:
        """The checked form of statements."""
        raise NotImplementedError

    def _jump(self, node: ast.AST, jump: Jump) -> list[Statement]:
        if jump is Jump.BREAK:
            left = self._breaks[-1]
            self._breaks[-1] = both(left, self.scope.assigned)
        self.scope.assigned = None
        return [jump]

    def _body(self, body: Sequence[ast.stmt]) -> tuple[list[Statement], set[str] | None]:
        """The body of a loop, and the variables that have a value at its breaks."""
        self._breaks.append(None)
        self.scope.loops += 1
        checked = self.block(body)
        self.scope.loops -= 1
        return checked, self._breaks.pop()

    def _else(
        self, node: ast.While | ast.For, ended: set[str] | None, left: set[str] | None
    ) -> list[Statement]:
        """The `else` of a loop, with the variables that have a value at its end and its breaks."""
        self.scope.assigned = ended
        checked = self.block(node.orelse)
        self.scope.assigned = both(self.scope.assigned, left)
        return checked

    def _while(self, node: ast.While) -> list[Statement]:
        endless = isinstance(node.test, ast.Constant) and bool(node.test.value)
        test, before = self.truth(node.test), set(self.scope.assigned or ())
        body, left = self._body(node.body)
        return [While(test, body, self._else(node, None if endless else before, left))]

    def _for(self, node: ast.For) -> list[Statement]:
        if self._called(node.iter) is range:
            return self._for_range(node, node.iter)
        if isinstance(self.reference(node.iter), EventItself):
            return self._for_events(node)
        counter = self.scope.temporary()
        taken, length = self._taken(node.target, node.iter, Variable(ValueKind.INT, counter))
        return self._counted(node, counter, _ZERO, Constant(ValueKind.INT, length), 1, taken)

    def _called(self, node: ast.expr) -> object:
        """The known function that an expression calls."""
        function = self.reference(node.func) if isinstance(node, ast.Call) else None
        return function.value if isinstance(function, Known) else None

    # --- loops over sequences ---

    def _taken(self, target: ast.expr, node: ast.expr, place: Variable) -> tuple[list[Taken], int]:
        """The names of a loop with their values, and the number of turns."""
        if isinstance(node, ast.Call) and self._called(node) is enumerate:
            return self._numbered(target, node, place)
        if isinstance(node, ast.Call) and self._called(node) is zip:
            return self._zipped(target, node, place)
        columns = self.columns(node, target)
        if columns is None:
            raise self._no_loop(node)
        taken: list[Taken] = [
            (name, Item(kind, sequence, length, place)) for name, sequence, kind, length in columns
        ]
        return taken, columns[0][3]

    def _numbered(
        self, target: ast.expr, call: ast.Call, place: Variable
    ) -> tuple[list[Taken], int]:
        named = [word.value for word in call.keywords if word.arg == "start"]
        given = [*call.args, *named]
        first = self.value(given[1]) if len(given) == 2 else _ZERO
        known = isinstance(first, Constant) and first.kind is ValueKind.INT
        if not known or len(given) not in (1, 2) or len(named) != len(call.keywords):
            raise self.problem(
                call, "these arguments of enumerate", "write enumerate(TABLE, 1), with a constant"
            )
        number, item = self._names(target, 2)
        taken, length = self._taken(item, call.args[0], place)
        return [(number, self.operation(call, ast.Add(), place, first)), *taken], length

    def _zipped(self, target: ast.expr, call: ast.Call, place: Variable) -> tuple[list[Taken], int]:
        if call.keywords or not call.args:
            raise self.problem(call, "these arguments of zip", "write zip(FIRST, SECOND)")
        names = self._names(target, len(call.args))
        parts = [
            self._taken(name, part, place) for name, part in zip(names, call.args, strict=True)
        ]
        return [each for taken, _ in parts for each in taken], min(length for _, length in parts)

    def _names(self, target: ast.expr, count: int) -> list[ast.expr]:
        if not isinstance(target, ast.Tuple | ast.List) or len(target.elts) != count:
            raise self.problem(
                target, f"a loop over {count} values in a turn", f"use {count} names: for a, b in"
            )
        return target.elts

    def _no_loop(self, node: ast.expr) -> Exception:
        if isinstance(node, ast.Call):
            self.value(node)
        return self.problem(
            node,
            "a loop over this",
            "loop over range(...), a constant tuple, a local list or a batch of events",
        )

    # --- loops that count ---

    def _for_range(self, node: ast.For, call: ast.expr) -> list[Statement]:
        assert isinstance(call, ast.Call)
        if call.keywords or not 1 <= len(call.args) <= 3:
            raise self.problem(call, "these arguments of range", "write range(start, stop, step)")
        values = [self.value(argument) for argument in call.args]
        if any(value.kind is not ValueKind.INT for value in values):
            raise self.problem(call, "a range of numbers that are not ints", "write int(...)")
        step = values[2] if len(values) == 3 else Constant(ValueKind.INT, 1)
        if not isinstance(step, Constant) or step.value == 0:
            raise self.problem(call, "a step that is not a constant", "write a number, such as 2")
        start, stop = (_ZERO, values[0]) if len(values) == 1 else values[:2]
        counter = self.scope.temporary()
        taken: list[Taken] = [(node.target, Variable(ValueKind.INT, counter))]
        return self._counted(node, counter, start, stop, int(step.value), taken)

    def _counted(
        self,
        node: ast.For,
        counter: str,
        start: Expression,
        stop: Expression,
        step: int,
        taken: Sequence[Taken],
    ) -> list[Statement]:
        # The loop may run zero times; then its names have no value.
        before = set(self.scope.assigned or ())
        first = [self.assign(self._name_of(target), value) for target, value in taken]
        body, left = self._body(node.body)
        return [Count(counter, start, stop, step, [*first, *body], self._else(node, before, left))]

    def _name_of(self, target: ast.expr) -> ast.Name:
        if not isinstance(target, ast.Name):
            raise self.problem(target, "a loop over this", "use a name for each value")
        return target

    def _for_events(self, node: ast.For) -> list[Statement]:
        """A loop over the events of a batch: the variable stands for one event."""
        event = self.reference(node.iter)
        target = self._name_of(node.target)
        if not isinstance(event, EventItself) or not event.batch:
            raise self.problem(node.iter, "a loop over one event", "use together=True")
        if target.id in self.scope.kinds or target.id in self.scope.references:
            raise self.problem(target, f"another value for {target.id}", "use another variable")
        before = set(self.scope.assigned or ())
        counter = self.scope.temporary()
        place = Variable(ValueKind.INT, counter)
        self.scope.references[target.id] = EventItself(False, place)
        body, left = self._body(node.body)
        del self.scope.references[target.id]
        start, stop = (Variable(ValueKind.INT, name) for name in ("e_begin", "e_end"))
        return [Count(counter, start, stop, 1, body, self._else(node, before, left))]


def both(first: set[str] | None, second: set[str] | None) -> set[str] | None:
    """Variables that have a value on both paths; None is a path that is not taken."""
    if first is None or second is None:
        return second if first is None else first
    return first & second
