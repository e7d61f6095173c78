"""The checked form of a method for one agent: from its function to a `Program`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any

from minerva_bus.grammar.types import Type
from minerva_bus.world.accelerator import NotCompilable
from minerva_fast.compiled.form import Attribute, Program, ValueKind
from minerva_fast.compiled.names import (
    AgentItself,
    EventItself,
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
