"""The checked form of a method or view for one agent: from its function to a `Program`.

A view (θ) is checked like a method; what differs is its result, a string of primitives and
transformations. Each `return` has a *template*, a string whose parameters are values of the row.
Rows append their values to the output of a template.

A view does not change attributes. Where every result of one form has the same attribute or id as a
parameter, its column is that of the agents, so the kernel does not append it, and does not get it
if nothing else in the view depends on it.
"""

from __future__ import annotations

import ast
import inspect
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import Primitive, Transformation
from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast.compiled.form import (
    Append,
    Assign,
    Attribute,
    Count,
    Expression,
    Figure,
    Finish,
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
from minerva_fast.compiled.names import (
    AgentItself,
    EventItself,
    Known,
    LocalNames,
    Method,
    Moment,
    Reference,
    event_type_of,
    kind_of,
    limit_of,
    slots_of,
)
from minerva_fast.compiled.origin import MISSING, Origin, lookup
from minerva_fast.compiled.statements import Statements

Names = dict[tuple[Any, str], Any]


@dataclass(frozen=True, slots=True)
class CheckedMethod:
    """A program, and the objects that names referred to when it was made."""

    program: Program
    constants: Names

    @property
    def current(self) -> bool:
        """Whether these names still refer to the same objects."""
        return all(_now(owner, name) is value for (owner, name), value in self.constants.items())


def _now(owner: Any, name: str) -> Any:
    """The object of a name in a function's module, or of an attribute of a module or class."""
    if isinstance(owner, FunctionType):
        return lookup(owner, name)
    return getattr(owner, name, MISSING)


def checked_methods(
    cls: Any, methods: Mapping[str, Callable[..., Any]], together: frozenset[str]
) -> dict[str, CheckedMethod]:
    """The programs of a class's compiled methods by event type. Raises NotCompilable.

    Args:
        cls: the agent class; its `kind` has the attributes.
        methods: by event type.
        together: event types whose method takes all events of an agent in a frame at once.

    """
    types = {field.name: field.type for field in cls.kind.fields.all}
    kinds, int_lines = kinds_of_attributes(cls, types), dict[str, int]()
    while True:
        before = dict(kinds)
        checked = {
            event_type: _checked(
                cls, event_type, function, event_type in together, types, kinds, int_lines
            )
            for event_type, function in sorted(methods.items())
        }
        # A method has set a real attribute to an int: those before it must know.
        if kinds == before:
            return checked


def kinds_of_attributes(cls: Any, types: Mapping[str, Type]) -> dict[str, ValueKind]:
    """The kinds of a class's attributes. Raises NotCompilable."""
    kinds: dict[str, ValueKind] = {}
    for name, declared in types.items():
        kind = kind_of(declared)
        if kind is None:
            raise NotCompilable(
                f"{cls.__name__} has compiled methods, so its attributes must be numbers, bools or"
                f" texts; {name} is a {declared}"
            )
        kinds[name] = kind
    return kinds


def _checked(
    cls: Any,
    event_type: str,
    function: Callable[..., Any],
    together: bool,
    types: Mapping[str, Type],
    kinds: dict[str, ValueKind],
    int_lines: dict[str, int],
) -> CheckedMethod:
    origin = Origin.of(function)
    declared = event_type_of(function, event_type)
    method = Method(cls, types, kinds, declared, int_lines=int_lines)
    meanings = AgentItself(), EventItself(together), Moment()
    scope = LocalNames(origin, parameters_of(origin, ("self", "event", "moment"), meanings))
    body = Statements(method, scope).function()
    return CheckedMethod(program_of(event_type, method, scope, body), method.constants)


def parameters_of(
    origin: Origin, expected: Sequence[str], meanings: Sequence[Reference]
) -> dict[str, Reference]:
    """What the parameters of a method stand for, by the names that it gives them."""
    names = [
        parameter.name
        for parameter in inspect.signature(origin.function).parameters.values()
        if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
    ]
    if len(names) != len(expected):
        raise origin.problem(
            origin.tree,
            f"parameters other than ({', '.join(expected)})",
            f"take exactly these {len(expected)}",
        )
    return dict(zip(names, meanings, strict=True))


def program_of(event_type: str, method: Method, scope: LocalNames, body: Any) -> Program:
    """What was collected of a method, for an event type."""
    words = {name: declared.words for name, declared in method.types.items()}
    attributes = {
        name: Attribute(
            name,
            method.kinds[name],
            method.types[name].kind == "real",
            limit_of(method.types[name]),
            tuple(method.code(word) for word in words[name] if name in method.writes),
        )
        for name in sorted(method.reads)
    }
    tables = [(name, kind, key[1]) for key, (name, kind) in method.tables.items()]
    return Program(
        title=f"{scope.origin.name} at {event_type}",
        body=body,
        reads=tuple(attributes.values()),
        writes=tuple(attributes[name] for name in sorted(method.writes)),
        data=slots_of(method.data),
        given=slots_of(method.given),
        draws=method.draws,
        outputs=tuple(method.outputs),
        helpers=tuple(method.helpers.values()),
        lists=tuple(scope.lists.values()),
        tables=tuple(tables),
        texts=tuple(method.texts),
    )


_RESULTS = "return EMPTY, or primitives in transformations: TAt(self.x, self.y)(PSpot())"


def checked_views(cls: Any, methods: Mapping[str, Callable[..., Any]]) -> dict[str, CheckedMethod]:
    """The programs of a class's compiled views by event type. Raises NotCompilable."""
    types = {field.name: field.type for field in cls.kind.fields.all}
    return {
        event_type: _checked_view(cls, types, event_type, function)
        for event_type, function in sorted(methods.items())
    }


def _checked_view(
    cls: Any, types: Mapping[str, Any], event_type: str, function: Callable[..., Any]
) -> CheckedMethod:
    origin = Origin.of(function)
    kinds = kinds_of_attributes(cls, types)
    method = Method(cls, types, kinds, event_type_of(function, event_type))
    meanings = AgentItself(), EventItself(batch=False)
    scope = LocalNames(origin, parameters_of(origin, ("self", "event"), meanings))
    body = _ViewStatements(method, scope).function()
    program = with_shared(program_of(event_type, method, scope, body))
    return CheckedMethod(program, method.constants)


class _ViewStatements(Statements):
    """Checks the statements of a view."""

    def _return(self, node: ast.Return) -> list[Statement]:
        if isinstance(node.value, ast.IfExp):
            return self._return_choice(node, node.value)
        made, values, figures = list[Statement](), list[Expression](), list[Figure]()
        for part in _summands(node, node.value):
            if not self._is_epsilon(part):
                figures.append(self._figure(part, made, values))
        widths = {bool(figure.width) for figure in figures}
        if len(widths) > 1:
            raise self.problem(
                node, "a sum of figures with and without parameters", "give each a parameter"
            )
        if figures:
            slots = tuple(Slot(str(at), value.kind) for at, value in enumerate(values))
            output = self.method.shown(Shown(tuple(figures), slots))
            made.append(Append(output, tuple(values)))
        self.scope.assigned = None
        return [*made, Finish(True, ())]

    def _end(self, reached: bool) -> list[Statement]:
        if reached:
            raise self.problem(
                self.scope.origin.tree, "a path without a result", "return EMPTY to show nothing"
            )
        return []

    def _store_attribute(self, target: ast.Attribute, value: Expression) -> Statement:
        raise self.problem(target, "a view that changes attributes", "use a local variable")

    def _figure(self, node: ast.expr, made: list[Statement], values: list[Expression]) -> Figure:
        """A primitive, or a transformation with one figure in its scope."""
        if not isinstance(node, ast.Call):
            raise self.problem(node, "this result of a view", _RESULTS)
        if not isinstance(node.func, ast.Call):
            return self._primitive(node, made, values)
        symbol = self._symbol(node.func)
        if not isinstance(symbol, Transformation) or len(node.args) > 1 or node.keywords:
            raise self.problem(
                node, "this scope", "write one figure in it, and add further ones: a + b"
            )
        names = self._values(node.func, symbol, made, values)
        if not names:
            raise self.problem(
                node.func, f"{symbol.name} without parameters", "give it one, such as its default"
            )
        inside = [self._figure(each, made, values) for each in node.args]
        return Figure(symbol, names, tuple(inside))

    def _primitive(self, node: ast.Call, made: list[Statement], values: list[Expression]) -> Figure:
        symbol = self._symbol(node)
        if not isinstance(symbol, Primitive):
            raise self.problem(node, "this result of a view", _RESULTS)
        return Figure(symbol, self._values(node, symbol, made, values))

    def _symbol(self, node: ast.Call) -> Any:
        reference = self.reference(node.func)
        return reference.value if isinstance(reference, Known) else None

    def _values(
        self,
        node: ast.Call,
        symbol: Primitive | Transformation,
        made: list[Statement],
        values: list[Expression],
    ) -> tuple[str, ...]:
        """The names of the parameters that are given; their values are appended."""
        named = {str(keyword.arg): keyword.value for keyword in node.keywords}
        statements, known = self.given_values(node, symbol.name, symbol.fields, node.args, named)
        made += statements
        values += known.values()
        return tuple(known)


def _summands(node: ast.AST, value: ast.expr | None) -> Sequence[ast.expr]:
    """The parts of a result, from left to right; `return` alone is None."""
    if value is None:
        return [ast.copy_location(ast.Constant(None), node)]
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.Add):
        return [*_summands(node, value.left), *_summands(node, value.right)]
    return [value]


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
