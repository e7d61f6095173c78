"""Rules whose activations do not depend on one another, so that several threads may share them.

Such a rule has no draws, writes only to its own row or cell (`birds.vx[i]`), and reads other rows
only in what it does not change. The check reads the source of the rule and of the kernels that it
calls; what it does not recognize counts as dependent.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.world.accelerator import NotCompilable
from minerva_fast.compiled.origin import Origin
from minerva_fast.space.edges import degree, edge, neighbour
from minerva_fast.space.field import go_to, near
from minerva_fast.space.kernels import Kernel
from minerva_fast.space.lattice import beside
from minerva_fast.space.occupancy import within

_READING: Final = frozenset((near, within, beside, degree, edge, neighbour))
"""Kernels that change nothing except the list of rows that a search has found."""
_SHAPES: Final = ("lattice", "field")
"""What a rule may read of its subject without a row."""


@dataclass(frozen=True, slots=True)
class Independence:
    """What is known about the activations of a rule.

    Attributes:
        independent: whether none depends on another.
        moves: whether one moves its row in a field, by `go_to`.

    """

    independent: bool
    moves: bool = False


def independence(function: FunctionType) -> Independence:
    """Check a rule `(i, subject, ...)` that has no draws."""
    row, subject, *_ = inspect.signature(function).parameters
    try:
        moves = list(_Body(function, subject, row).moves())
    except NotCompilable:  # also if there is no source
        return Independence(independent=False)
    # A second move would change the order of a cell's rows, unless it happens at once.
    return Independence(moves in ([], [False]), bool(moves))


_DEPENDS: Final = "an activation depends on another"


@dataclass(frozen=True, slots=True)
class _Body:
    """A function in which the subject and the row of the rule have these names, "" for none.

    `own` has the nodes that name the subject and concern only its row.
    """

    function: FunctionType
    subject: str
    row: str
    own: set[ast.AST] = field(default_factory=set[ast.AST])

    def moves(self) -> Iterator[bool]:
        """For each `go_to` of the row, whether it is in a loop. Raises NotCompilable for others."""
        tree = Origin.of(self.function).tree
        nodes = list(ast.walk(tree))
        loops = [node for node in nodes if isinstance(node, ast.For | ast.While)]
        looped = {node for loop in loops for node in ast.walk(loop)}
        for node in nodes:
            self._find_own(node)
            if isinstance(node, ast.Call):
                for inner in self._moves_of(node):
                    yield inner or node in looped
        for node in nodes:
            self._check(node)

    def _find_own(self, node: ast.AST) -> None:
        """Find the subject in `subject.column[row]`, `subject[row]` and `subject.field`."""
        if isinstance(node, ast.Subscript) and _is(node.slice, self.row):
            value = node.value
            # The cell of a row changes later, if several threads move rows.
            if isinstance(value, ast.Attribute) and value.attr != "cell":
                value = value.value
            if _is(value, self.subject):
                self.own.add(value)
        elif isinstance(node, ast.Attribute) and node.attr in _SHAPES:
            self.own.add(node.value)

    def _check(self, node: ast.AST) -> None:
        """Raise NotCompilable if a node reads another row of the subject, or writes elsewhere."""
        if _is(node, self.subject) and node not in self.own:
            raise NotCompilable(_DEPENDS)
        if not isinstance(getattr(node, "ctx", None), ast.Store | ast.Del):
            return
        if isinstance(node, ast.Attribute) or _is(node, self.row):
            raise NotCompilable(_DEPENDS)
        if isinstance(node, ast.Subscript):
            base = node.value
            if isinstance(base, ast.Attribute):
                base = base.value
            if base not in self.own:
                raise NotCompilable(_DEPENDS)

    def _moves_of(self, call: ast.Call) -> Iterator[bool]:
        """The moves of a kernel that is called, with this function's subject and row."""
        called: object = None
        if isinstance(call.func, ast.Name):
            called = cast("Any", self.function).__globals__.get(call.func.id)
        if not isinstance(called, Kernel) or called in _READING:
            return
        kernel = cast("Kernel[..., Any]", called)
        try:
            bound = inspect.signature(kernel.function).bind(
                *call.args, **{str(each.arg): each.value for each in call.keywords}
            )
        except TypeError:
            raise NotCompilable(_DEPENDS) from None
        subjects = [name for name, node in bound.arguments.items() if _is(node, self.subject)]
        rows = [name for name, node in bound.arguments.items() if _is(node, self.row)]
        if subjects and (len(subjects), len(rows)) != (1, 1):
            raise NotCompilable(_DEPENDS)
        if kernel is go_to:
            if not subjects:
                raise NotCompilable(_DEPENDS)
            yield False
        elif kernel.function.__module__.startswith("minerva_fast.space."):
            raise NotCompilable(_DEPENDS)
        else:
            yield from _Body(kernel.function, "".join(subjects), rows[0] if rows else "").moves()
        self.own.update(bound.arguments[name] for name in subjects)
