"""Variables of a rule that may have no value when they are read.

Machine code would read what memory happens to contain there, so such a rule is refused, as a
compiled method is.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from minerva_fast.compiled.origin import Origin

_LOOPS: Final = (ast.For, ast.While)


def check_values(origin: Origin) -> None:
    """Raise NotCompilable at the first variable that may have no value."""
    arguments = origin.tree.args
    parameters = {each.arg for each in (*arguments.posonlyargs, *arguments.args)}
    stored = {
        node.id
        for node in ast.walk(origin.tree)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    _Paths(origin, stored | parameters).block(origin.tree.body, parameters)


@dataclass(frozen=True, slots=True)
class _Paths:
    """Follows the paths through a function with these variables.

    `breaks` has, for each loop around a statement, the variables with a value at its breaks.
    """

    origin: Origin
    variables: set[str]
    breaks: list[set[str] | None] = field(default_factory=list[set[str] | None])

    def block(self, body: Iterable[ast.stmt], known: set[str] | None) -> set[str] | None:
        """The variables with a value after some statements; None if their end is not reached."""
        for node in body:
            if known is None:
                break
            known = self._after(node, known)
        return known

    def _after(self, node: ast.stmt, known: set[str]) -> set[str] | None:
        if isinstance(node, ast.If):
            self._read(node.test, known)
            return _both(self.block(node.body, {*known}), self.block(node.orelse, {*known}))
        if isinstance(node, _LOOPS):
            return self._after_loop(node, known)
        self._read(node, known)
        if isinstance(node, ast.Break):
            self.breaks[-1] = _both(self.breaks[-1], known)
        if isinstance(node, ast.Return | ast.Raise | ast.Break | ast.Continue):
            return None
        return known | _stored(node)

    def _after_loop(self, node: ast.For | ast.While, known: set[str]) -> set[str] | None:
        head = node.iter if isinstance(node, ast.For) else node.test
        self._read(head, known)
        self.breaks.append(None)
        inside = known | _stored(node.target) if isinstance(node, ast.For) else {*known}
        self.block(node.body, inside)
        left = self.breaks.pop()
        endless = isinstance(head, ast.Constant) and bool(head.value)
        return _both(left, None if endless else self.block(node.orelse, {*known}))

    def _read(self, node: ast.AST, known: set[str]) -> None:
        """Check the variables that an expression or a statement without others in it reads."""
        for each in ast.walk(node):
            if not isinstance(each, ast.Name) or each.id not in self.variables - known:
                continue
            if isinstance(each.ctx, ast.Load) or isinstance(node, ast.AugAssign):
                raise self.origin.problem(
                    each,
                    f"{each.id} may have no value here",
                    f"assign {each.id} before the branch or loop that sets it",
                )


def _stored(node: ast.AST) -> set[str]:
    if isinstance(node, ast.AnnAssign) and node.value is None:
        return set()
    names = [each for each in ast.walk(node) if isinstance(each, ast.Name)]
    return {each.id for each in names if isinstance(each.ctx, ast.Store)}


def _both(first: set[str] | None, other: set[str] | None) -> set[str] | None:
    """The variables with a value on both of two paths, of which None is not reached."""
    if first is None or other is None:
        return other if first is None else first
    return first & other
