"""Statements of a compiled method: blocks, branches and ends."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from minerva_fast.compiled.form import Finish, If, Jump, Statement
from minerva_fast.compiled.loops import Loops, both
from minerva_fast.compiled.names import LocalNames, Method
from minerva_fast.compiled.refused import STATEMENTS


class Statements(Loops):
    """Checks the statements of one function."""

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
        while True:  # It ends, because a kind only changes to MIXED, and then stays.
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
        self.scope.assigned = both(after_then, self.scope.assigned)
        return [If(test, then, otherwise)]
