"""The checked form of a method for one agent."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, Final

from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.user_code import handler_name, variables_of
from minerva_bus.world.class_declaration import NotCompilable, takes_batch
from minerva_fast.origin import Origin
from minerva_fast.printing import printed
from minerva_fast.results import MethodResults
from minerva_fast.statements import Statements
from minerva_fast.values import (
    DECLARED,
    FunctionScope,
    Given,
    Method,
)


def checked_methods(cls: Any, methods: Mapping[str, Callable[..., Any]]) -> dict[str, Method]:
    """The checked methods of a class by event type. Raises NotCompilable."""
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


def _event_type_of(function: Callable[..., Any], name: str) -> EventType | None:
    """The event type of a name in the module of a function, which has the types of its data."""
    scope: Mapping[str, Any] = getattr(function, "__globals__", {})
    for value in (*scope.values(), *variables_of(function).values()):
        if isinstance(value, EventType) and value.name == name:
            return value
    return None


_PARAMETERS: Final = Given.AGENT, Given.EVENT, Given.MOMENT


def _checked(cls: Any, event_type: str, function: Callable[..., Any]) -> Method:
    types: Mapping[str, Type] = {field.name: field.type for field in cls.kind.fields.all}
    for name, declared in types.items():
        if declared.kind not in DECLARED:
            raise NotCompilable(
                f"{cls.__name__} has compiled methods, so its attributes must be numbers, bools or"
                f" texts; {name} is a {declared}"
            )
    origin = Origin.of(function)
    declaration = _event_type_of(function, event_type)
    method = Method(f"{origin.name} at {event_type}", cls, types, declaration)
    names = [
        parameter.name
        for parameter in inspect.signature(origin.function).parameters.values()
        if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
    ]
    if len(names) != len(_PARAMETERS):
        what = "parameters other than (self, event, moment)"
        raise origin.problem(origin.tree, what, "take exactly these 3")
    scope = FunctionScope(origin, dict(zip(names, _PARAMETERS, strict=True)))
    method.text = printed(method, Statements(method, scope, MethodResults()).function())
    return method
