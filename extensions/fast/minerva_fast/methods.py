"""The checked form of a method for one agent: from its function to a `Program`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.user_code import handler_name, variables_of
from minerva_bus.world.class_declaration import NotCompilable, takes_batch
from minerva_fast.origin import Origin
from minerva_fast.printing import Program, printed
from minerva_fast.results import MethodResults
from minerva_fast.statements import Statements
from minerva_fast.values import (
    DECLARED,
    AgentItself,
    Attribute,
    EventItself,
    FunctionScope,
    Line,
    Method,
    Moment,
    Slot,
)


def checked_methods(cls: Any, methods: Mapping[str, Callable[..., Any]]) -> dict[str, Program]:
    """The programs of a class's compiled methods by event type. Raises NotCompilable."""
    for function in methods.values():
        if takes_batch(function):
            raise NotCompilable(
                f"{handler_name(function)} cannot be compiled: it takes all events of an agent"
                " together; leave out together=True, or write it for a population"
            )
    return {
        event_type: _checked(cls, event_type, function)
        for event_type, function in sorted(methods.items())
    }


def _method_of(cls: Any, event_type: EventType | None) -> Method:
    """Nothing collected yet of a method of a class. Raises NotCompilable."""
    types: Mapping[str, Type] = {field.name: field.type for field in cls.kind.fields.all}
    for name, declared in types.items():
        if declared.kind not in DECLARED:
            raise NotCompilable(
                f"{cls.__name__} has compiled methods, so its attributes must be numbers, bools or"
                f" texts; {name} is a {declared}"
            )
    return Method(cls, types, event_type)


def _event_type_of(function: Callable[..., Any], name: str) -> EventType | None:
    """The event type of a name in the module of a function, which has the types of its data."""
    scope: Mapping[str, Any] = getattr(function, "__globals__", {})
    for value in (*scope.values(), *variables_of(function).values()):
        if isinstance(value, EventType) and value.name == name:
            return value
    return None


_PARAMETERS: Final = AgentItself(), EventItself(), Moment()


def _checked(cls: Any, event_type: str, function: Callable[..., Any]) -> Program:
    method = _method_of(cls, _event_type_of(function, event_type))
    origin = Origin.of(function)
    names = [
        parameter.name
        for parameter in inspect.signature(origin.function).parameters.values()
        if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
    ]
    if len(names) != len(_PARAMETERS):
        what = "parameters other than (self, event, moment)"
        raise origin.problem(origin.tree, what, "take exactly these 3")
    scope = FunctionScope(origin, dict(zip(names, _PARAMETERS, strict=True)))
    body = Statements(method, scope, MethodResults()).function()
    program = _program(f"{origin.name} at {event_type}", method, body)
    return replace(program, text=printed(program, method, body))


def _program(title: str, method: Method, body: Sequence[Line]) -> Program:
    """What was collected of a method, without its text."""
    used = set(re.findall(r"\b[ag]_\w+", str([*body, *method.helpers.values()])))
    attributes = {
        name: Attribute(
            name,
            DECLARED[method.types[name].kind],
            method.types[name],
            tuple([method.code(w) for w in method.types[name].words or ()]),
        )
        for name in sorted(method.reads)
        if f"a_{name}" in used or name in method.writes
    }
    return Program(
        title=title,
        text="",
        reads=tuple(attributes.values()),
        writes=tuple([attributes[name] for name in sorted(method.writes)]),
        data=tuple([Slot(*each) for each in sorted(method.data.items())]),
        given=tuple(
            [Slot(*each) for each in sorted(method.given.items()) if f"g_{each[0]}" in used]
        ),
        draws=method.draws,
        outputs=tuple(method.outputs),
        lists=tuple(method.lists.values()),
        texts=tuple(method.texts),
        current=method.current,
    )
