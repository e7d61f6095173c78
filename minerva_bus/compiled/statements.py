"""Statements of a compiled method: control flow."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, cast

from minerva_bus.compiled.form import (
    Constant,
    Count,
    Expression,
    Finish,
    If,
    Item,
    Jump,
    Statement,
    ValueKind,
    Variable,
    While,
)
from minerva_bus.compiled.helper_calls import HelperCalls
from minerva_bus.compiled.names import (
    EventItself,
    Known,
    LocalNames,
    Method,
)
from minerva_bus.compiled.refused import STATEMENTS

_PASSES: Final = 10
"""Passes over a function until the kinds of its variables are known: each may change once."""


class Statements(HelperCalls):
    """Checks the statements of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        super().__init__(method, scope)
        self._breaks: list[set[str] | None] = []
        """Of each loop around a statement, the variables that have a value at its breaks."""

    def _checks_of_statements(self) -> Mapping[type[ast.AST], Callable[[Any], list[Statement]]]:
        return {
            ast.Assign: self._assign,
            ast.AugAssign: self._augmented,
            ast.AnnAssign: self._annotated,
            ast.Expr: self._expression,
            ast.If: self._if,
            ast.While: self._while,
            ast.For: self._for,
            ast.Return: self._return,
            ast.Pass: lambda node: [Jump.PASS],
            ast.Break: lambda node: self._jump(node, Jump.BREAK),
            ast.Continue: lambda node: self._jump(node, Jump.CONTINUE),
            # The row runs in Python again, which raises the error with its usual message.
            ast.Raise: lambda node: self._fault(),
            ast.Assert: self._assert,
        }

    def checked(self, method: Method, scope: LocalNames) -> list[Statement]:
        """The checked statements of a function that is called."""
        return Statements(method, scope).function()

    def function(self) -> list[Statement]:
        """The statements of the function, once the kinds of its variables are known."""
        body = self.scope.origin.tree.body
        parameters = set(self.scope.assigned or ())
        for _ in range(_PASSES):
            known = dict(self.scope.kinds), self.scope.result, dict(self.method.kinds)
            self.scope.assigned = set(parameters)
            self.scope.litters, self._repeated = {}, set()
            self.scope.names = iter(range(1_000_000))
            outputs = len(self.method.outputs)
            checked = self.block(body)
            reached = self._reached()
            if known == (self.scope.kinds, self.scope.result, self.method.kinds):
                return [*checked, *self._end(reached)]
            if not self.scope.helper:
                del self.method.outputs[outputs:]
        raise AssertionError("the kinds of variables have not settled")

    def _reached(self) -> bool:
        return self.scope.assigned is not None

    def _end(self, reached: bool) -> list[Statement]:
        """The end of the function's source, if it can be reached."""
        if not reached:
            return []
        if self.scope.helper:
            raise self.problem(
                self.scope.origin.tree,
                "a function that returns no value on one path",
                "end it with return",
            )
        return [Finish(True, ())]

    def block(self, nodes: Sequence[ast.stmt]) -> list[Statement]:
        """The checked form of statements; those that are never reached are left out."""
        checks, made = self._checks_of_statements(), list[Statement]()
        for node in nodes:
            if self.scope.assigned is None:
                break
            check = checks.get(type(node))
            if check is None:
                raise self.problem(node, *STATEMENTS.get(type(node), ("this statement", "")))
            made += check(node)
        return made

    def _fault(self) -> list[Statement]:
        self.scope.assigned = None
        return [Jump.FAULT]

    def _assert(self, node: ast.Assert) -> list[Statement]:
        return [If(self.truth(node.test), (), (Jump.FAULT,))]

    def _if(self, node: ast.If) -> list[Statement]:
        test, before = self.truth(node.test), self.scope.assigned
        self.scope.assigned = set(before or ())
        then = self.block(node.body)
        after_then = self.scope.assigned
        self.scope.assigned = set(before or ())
        otherwise = self.block(node.orelse)
        self.scope.assigned = _both(after_then, self.scope.assigned)
        return [If(test, then, otherwise)]

    def _jump(self, node: ast.AST, jump: Jump) -> list[Statement]:
        if jump is Jump.BREAK:
            left = self._breaks[-1]
            self._breaks[-1] = _both(left, self.scope.assigned)
        self.scope.assigned = None
        return [jump]

    def _loop(self, body: Sequence[ast.stmt], *, endless: bool = False) -> list[Statement]:
        """The body of a loop, which may run any number of times; `endless`: until a break."""
        before = set(self.scope.assigned or ())
        self._breaks.append(None)
        self.scope.loops += 1
        checked = self.block(body)
        self.scope.loops -= 1
        left = self._breaks.pop()
        self.scope.assigned = left if endless else _both(before, left)
        return checked

    def _while(self, node: ast.While) -> list[Statement]:
        self._no_else(node)
        endless = isinstance(node.test, ast.Constant) and bool(node.test.value)
        test = self.truth(node.test)
        return [While(test, self._loop(node.body, endless=endless))]

    def _no_else(self, node: ast.While | ast.For) -> None:
        if node.orelse:
            raise self.problem(node, "else after a loop", "use a bool variable and if")

    def _for(self, node: ast.For) -> list[Statement]:
        self._no_else(node)
        if isinstance(node.iter, ast.Call):
            function = self.reference(node.iter.func)
            if isinstance(function, Known) and function.value is range:
                return self._for_range(node, node.iter)
        if isinstance(self.reference(node.iter), EventItself):
            return self._for_events(node)
        sequence = None
        if isinstance(node.iter, ast.Name | ast.Attribute):
            sequence = self.sequence(node.iter)
        if sequence is None:
            self._refuse_iteration(node)
        return self._for_items(node, cast("tuple[str, ValueKind, int]", sequence))

    def _refuse_iteration(self, node: ast.For) -> None:
        if isinstance(node.iter, ast.Call):
            self.value(node.iter)
        raise self.problem(
            node.iter,
            "a loop over this",
            "loop over range(...), a constant tuple, a local list or a batch of events",
        )

    def _for_range(self, node: ast.For, call: ast.Call) -> list[Statement]:
        if call.keywords or not 1 <= len(call.args) <= 3:
            raise self.problem(call, "these arguments of range", "write range(start, stop, step)")
        values = [self.value(argument) for argument in call.args]
        if any(value.kind is not ValueKind.INT for value in values):
            raise self.problem(call, "a range of numbers that are not ints", "write int(...)")
        step = values[2] if len(values) == 3 else Constant(ValueKind.INT, 1)
        if not isinstance(step, Constant) or step.value == 0:
            raise self.problem(call, "a step that is not a constant", "write a number, such as 2")
        start, stop = (Constant(ValueKind.INT, 0), values[0]) if len(values) == 1 else values[:2]
        counter = self.scope.temporary()
        return self._counted(
            node, counter, start, stop, int(step.value), Variable(ValueKind.INT, counter)
        )

    def _counted(
        self,
        node: ast.For,
        counter: str,
        start: Expression,
        stop: Expression,
        step: int,
        value: Expression,
    ) -> list[Statement]:
        before = set(self.scope.assigned or ())
        target = self._target(node)
        first = self.assign(target, value)
        body = self._loop(node.body)
        # The loop may run zero times; then its variable has no value.
        if self.scope.assigned is not None and target.id not in before:
            self.scope.assigned.discard(target.id)
        return [Count(counter, start, stop, step, [first, *body])]

    def _target(self, node: ast.For) -> ast.Name:
        if not isinstance(node.target, ast.Name):
            raise self.problem(node.target, "a loop over several names", "use one name")
        return node.target

    def _for_items(self, node: ast.For, sequence: tuple[str, ValueKind, int]) -> list[Statement]:
        name, kind, length = sequence
        counter = self.scope.temporary()
        item = Item(kind, name, length, Variable(ValueKind.INT, counter))
        start, stop = Constant(ValueKind.INT, 0), Constant(ValueKind.INT, length)
        return self._counted(node, counter, start, stop, 1, item)

    def _for_events(self, node: ast.For) -> list[Statement]:
        """A loop over the events of a batch: the variable stands for one event."""
        event = self.reference(node.iter)
        target = self._target(node)
        if not isinstance(event, EventItself) or not event.batch:
            raise self.problem(node.iter, "a loop over one event", "use together=True")
        if target.id in self.scope.kinds or target.id in self.scope.references:
            raise self.problem(target, f"another value for {target.id}", "use another variable")
        counter = self.scope.temporary()
        place = Variable(ValueKind.INT, counter)
        self.scope.references[target.id] = EventItself(False, place)
        body = self._loop(node.body)
        del self.scope.references[target.id]
        start, stop = (Variable(ValueKind.INT, name) for name in ("e_begin", "e_end"))
        return [Count(counter, start, stop, 1, body)]


def _both(first: set[str] | None, second: set[str] | None) -> set[str] | None:
    """Variables that have a value on both paths; None is a path that is not taken."""
    if first is None or second is None:
        return second if first is None else first
    return first & second
