"""Refuses SIMULTANEOUS rules whose result depends on the order of their activations.

What such a rule reads of its subject it must read from `before`, unless no activation changes it.
Machine code and Python agree on other rules as well, but they are not simultaneous: each row would
see what the rows before it have changed.
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
from minerva_fast.space.callable import called
from minerva_fast.space.field import go_to, near
from minerva_fast.space.kernels import Kernel
from minerva_fast.space.occupancy import copy, move_to, random_at, random_free, remove, within

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
