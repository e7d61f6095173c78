"""What the activations of a rule know of one another.

A SIMULTANEOUS rule whose result depends on the order of its activations is refused. What such a
rule reads of its subject it must read from `before`, unless no activation changes it. Machine code
and Python agree on other rules as well, but they are not simultaneous: each row would see what the
rows before it have changed.

Several threads may share the activations of an *independent* rule. It has no draws, writes only to
its own row or cell (`birds.vx[i]`), and reads other rows only in what it does not change. The check
reads the source of the rule and of the kernels that it calls; what it does not recognize counts as
dependent.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast.compiled.origin import Origin
from minerva_fast.space.checking import called
from minerva_fast.space.kernels import Kernel
from minerva_fast.space.places import (
    beside,
    copy,
    degree,
    edge,
    go_to,
    move_to,
    near,
    neighbour,
    random_at,
    random_free,
    remove,
    within,
)

_SEARCHES: Final = (near, within, random_at, random_free)
_CHANGES: Final = (go_to, move_to, remove, copy)
_POSITION: Final = ("cell", "x", "y")
_ANY: Final = "*"
"""In place of a column: all of them."""


@dataclass(frozen=True, slots=True)
class _Read:
    """A read of a column, "" for a matrix, and whether it is of the rule's own row."""

    origin: Origin
    node: ast.AST
    column: str
    own: bool


@dataclass(frozen=True, slots=True)
class _Uses:
    """What a rule and its kernels do with the subject."""

    reads: list[_Read] = field(default_factory=list[_Read])
    changed: set[str] = field(default_factory=set[str])
    """Columns that the rule changes, at any row."""
    elsewhere: set[str] = field(default_factory=set[str])
    """Those that it changes at other rows than its own."""
    known: set[tuple[FunctionType, str, str]] = field(
        default_factory=set[tuple[FunctionType, str, str]]
    )


def check_simultaneous(function: FunctionType) -> None:
    """Raise NotCompilable if a rule reads of its subject what other activations change."""
    row, subject, *others = inspect.signature(function).parameters
    uses = _Uses()
    _collect(function, subject, row, uses)
    for read in uses.reads:
        changed = uses.elsewhere if read.own else uses.changed
        if read.column in changed or (read.column == _ANY and changed):
            raise _problem(read, subject, "before" in others)


def _problem(read: _Read, subject: str, has_before: bool) -> NotCompilable:
    shown = "before" if has_before else f"a parameter `before` of the type of {subject}"
    return read.origin.problem(
        read.node,
        f"a read of {subject} that depends on the order of a SIMULTANEOUS rule",
        f"read it from {shown}, the state before the rule, or declare ORDERED",
    )


def _collect(function: FunctionType, subject: str, row: str, uses: _Uses) -> None:
    """Collect what a function does with the subject and the row, which have these names here."""
    if (function, subject, row) in uses.known:
        return
    uses.known.add((function, subject, row))
    try:
        origin = Origin.of(function)
    except NotCompilable:  # there is no source
        return
    nodes = [node for statement in origin.tree.body for node in ast.walk(statement)]
    if any(_is(node, row) and not isinstance(_context(node), ast.Load) for node in nodes):
        row = ""  # another one from some place on
    seen = {named for node in nodes for named in _noted(origin, node, subject, row, uses)}
    columns = [node for node in nodes if isinstance(node, ast.Attribute)]
    # What is named without an index, such as for another name of a column.
    for node in columns:
        if _is(node.value, subject) and node.value not in seen:
            seen.add(node.value)
            uses.reads.append(_Read(origin, node, node.attr, own=False))
    tables = [node for node in nodes if _is(node, subject) and node not in seen]
    uses.reads.extend(_Read(origin, node, _ANY, own=False) for node in tables)


def _noted(origin: Origin, node: ast.AST, subject: str, row: str, uses: _Uses) -> Iterator[ast.AST]:
    """Note what a node does with the subject; the nodes that name it there."""
    if isinstance(node, ast.Subscript):
        yield from _item(origin, node, subject, row, uses)
    elif isinstance(node, ast.Call):
        yield from _call(origin, node, subject, row, uses)
    elif isinstance(node, ast.Attribute) and node.attr in _SHAPES:
        yield node.value


def _item(
    origin: Origin, node: ast.Subscript, subject: str, row: str, uses: _Uses
) -> Iterator[ast.AST]:
    """Note `subject.column[k]` or `subject[k]`; the node that names the subject."""
    owner, column = node.value, ""
    if isinstance(owner, ast.Attribute):
        owner, column = owner.value, owner.attr
    if not _is(owner, subject):
        return
    yield owner
    own = bool(row) and _is(node.slice, row)
    if _is_newborn(origin, node.slice):
        return  # which no other activation knows
    if isinstance(node.ctx, ast.Load):
        uses.reads.append(_Read(origin, node, column, own))
        return
    uses.changed.add(column)
    if not own:
        uses.elsewhere.add(column)


def _is_newborn(origin: Origin, index: ast.expr) -> bool:
    """Whether an index is the row of a copy, or a variable that is always such a row."""
    if isinstance(index, ast.Call):
        return called(origin, index.func) is copy
    if not isinstance(index, ast.Name):
        return False
    values = list[ast.expr | None]()
    for node in ast.walk(origin.tree):
        if isinstance(node, ast.Assign) and _is(node.targets[0], index.id):
            values.append(node.value)
        elif _is(node, index.id) and isinstance(_context(node), ast.Store):
            values.append(None)
    # Each assignment is counted twice: as a statement, and as the name that it stores.
    made = [each for each in values if isinstance(each, ast.Call)]
    return (
        bool(made)
        and 2 * len(made) == len(values)
        and all(called(origin, each.func) is copy for each in made)
    )


def _call(origin: Origin, node: ast.Call, subject: str, row: str, uses: _Uses) -> Iterator[ast.AST]:
    """Note what a kernel that is called does with the subject; the nodes that name it."""
    function: Any = called(origin, node.func)
    if function is len:
        yield from (each for each in node.args if _is(each, subject))
        for each in node.args:
            if isinstance(each, ast.Attribute) and _is(each.value, subject):
                yield each.value
    if not isinstance(function, Kernel):
        return
    kernel = cast("Kernel[..., Any]", function)
    try:
        given = inspect.signature(kernel.function).bind(
            *node.args, **{str(each.arg): each.value for each in node.keywords}
        )
    except TypeError:  # which the check of calls reports
        return
    tables = [name for name, each in given.arguments.items() if _is(each, subject)]
    rows = [name for name, each in given.arguments.items() if row and _is(each, row)]
    if not tables:
        return
    yield from (given.arguments[name] for name in tables)
    if kernel in _SEARCHES:
        uses.reads.extend(_Read(origin, node, column, own=False) for column in _POSITION)
    elif kernel in _CHANGES:
        uses.changed.update(_POSITION)
        if rows[:1] != ["i"]:
            # The row may have been activated before, or may be activated later.
            uses.reads.append(_Read(origin, node, _ANY, own=False))
    else:
        _collect(kernel.function, tables[0], rows[0] if rows else "", uses)


def _is(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def _context(node: ast.AST) -> ast.expr_context:
    return cast("ast.Name", node).ctx


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
