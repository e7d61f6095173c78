"""Attributes and ids that a view passes on unchanged: columns without a copy by the kernel.

A view does not change attributes. Where every result of one form has the same attribute as a
parameter, its column is that of the agents, so the kernel does not append it, and does not get it
if nothing else in the view depends on it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, Final, cast

from minerva_fast.compiled.form import (
    Append,
    Assign,
    Count,
    Expression,
    If,
    Output,
    Program,
    Shown,
    Slot,
    Statement,
    ValueKind,
    Variable,
    While,
)

_ID: Final = Variable(ValueKind.TEXT, "g_id")
_Shared = dict[int, dict[str, str]]
"""Attributes by the names of slots, for each output."""


def with_shared(program: Program) -> Program:
    """The program of a view whose outputs share the columns of attributes."""
    shared: _Shared = {}
    values = _assigned_once(program.body)
    for index, output in enumerate(program.outputs):
        if isinstance(output, Shown):
            appended = [
                each.values
                for each in _inside(program.body)
                if isinstance(each, Append) and each.output == index
            ]
            shared[index] = _same(output.slots, appended, values)
    outputs = [_sharing(output, shared.get(at, {})) for at, output in enumerate(program.outputs)]
    body = _without_copies(_without(program.body, program, shared))
    used = set(_variables((body, program.helpers)))
    return replace(
        program,
        body=body,
        outputs=tuple(outputs),
        reads=tuple([each for each in program.reads if f"a_{each.name}" in used]),
        given=tuple([each for each in program.given if each.name != "id" or _ID.name in used]),
    )


def _assigned_once(body: Sequence[Statement]) -> dict[str, Expression]:
    """The values of variables that have one assignment."""
    assigned = [each for each in _inside(body) if isinstance(each, Assign)]
    times = Counter([each.name for each in assigned])
    return {each.name: each.value for each in assigned if times[each.name] == 1}


def _same(
    slots: Sequence[Slot],
    appended: Sequence[Sequence[Expression]],
    values: Mapping[str, Expression],
) -> dict[str, str]:
    """The slots that have the same attribute in all results; `values` are those of variables."""
    same: dict[str, str] = {}
    for slot, given in zip(slots, zip(*appended, strict=True), strict=True):
        names = {_attribute(value, values) for value in given}
        name = names.pop()
        if name and not names:
            same[slot.name] = name
    return same


def _sharing(output: Output, shared: dict[str, str]) -> Output:
    if not isinstance(output, Shown):
        return output
    slots = tuple([slot for slot in output.slots if slot.name not in shared])
    return replace(output, slots=slots, shared=tuple(shared.items()))


def _attribute(value: Expression, values: Mapping[str, Expression]) -> str:
    """The attribute that a value is; empty if it is another value."""
    # Parameters are checked as temporaries, which are assigned once.
    if isinstance(value, Variable) and value.name.startswith("t_"):
        value = values.get(value.name, value)
    if isinstance(value, Variable) and value.name.startswith("a_"):
        return value.name.removeprefix("a_")
    return "id" if value == _ID else ""


def _inside(statements: Sequence[Statement]) -> Iterator[Statement]:
    """All statements, with those in branches and loops."""
    for statement in statements:
        yield statement
        match statement:
            case If(_, then, otherwise):
                yield from _inside(then)
                yield from _inside(otherwise)
            case While(_, body) | Count(body=body):
                yield from _inside(body)
            case _:
                pass


def _rewritten(
    statements: Sequence[Statement], change: Callable[[Statement], Statement | None]
) -> list[Statement]:
    """All statements, with those in branches and loops, after a change; without those of None."""
    made: list[Statement] = []
    for statement in statements:
        match statement:
            case If(test, then, otherwise):
                made.append(If(test, _rewritten(then, change), _rewritten(otherwise, change)))
            case While(_, body) | Count(body=body):
                made.append(replace(statement, body=_rewritten(body, change)))
            case _:
                changed = change(statement)
                made += [] if changed is None else [changed]
    return made


def _without(statements: Sequence[Statement], program: Program, shared: _Shared) -> list[Statement]:
    """The statements, whose results lack what is shared."""

    def change(statement: Statement) -> Statement:
        if not isinstance(statement, Append):
            return statement
        slots = program.outputs[statement.output].slots
        kept = [
            value
            for slot, value in zip(slots, statement.values, strict=True)
            if slot.name not in shared.get(statement.output, {})
        ]
        return Append(statement.output, tuple(kept))

    return _rewritten(statements, change)


def _without_copies(statements: Sequence[Statement]) -> list[Statement]:
    """The statements without variables that have the value of another, and that nothing reads."""
    read = set(_variables(statements))

    def change(statement: Statement) -> Statement | None:
        match statement:
            case Assign(name, Variable()) if name not in read:
                return None
            case _:
                return statement

    return _rewritten(statements, change)


def _variables(part: Any) -> Iterator[str]:
    """The names of the variables that a part of a program reads."""
    if isinstance(part, Variable):
        yield part.name
    elif isinstance(part, list | tuple):
        for each in cast("Sequence[Any]", part):
            yield from _variables(each)
    elif is_dataclass(part):
        for field in fields(part):
            yield from _variables(getattr(part, field.name))
