"""Attributes of agent classes as expressions: `Person.x`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from minerva_bus.world.expressions import Expression

NO_DEFAULT: Final = object()


class ClassAttribute:
    """Makes `Person.x` an expression, where `person.x` is the value of an agent.

    It has no `__set__`, so the state of an agent is found in the agent itself.
    """

    __slots__ = ("default", "name")

    def __init__(self, name: str, default: object = NO_DEFAULT) -> None:
        self.name = name
        self.default = default

    def __get__(self, agent: object, cls: Any) -> Any:
        if agent is None:
            kind = getattr(cls, "kind", None)
            return self if kind is None else Expression(kind.name, self.name)
        if self.default is NO_DEFAULT:
            raise AttributeError(f"{type(agent).__name__!r} object has no attribute {self.name!r}")
        return self.default


def expose_attributes(cls: type[Any], names: Iterable[str]) -> None:
    """Make each of these attributes of a class an expression, as `ClassAttribute`."""
    for name in names:
        # Looked up without `getattr`, which would call the descriptor instead of returning it.
        homes = [base for base in cls.__mro__ if name in vars(base)]
        value = vars(homes[0])[name] if homes else NO_DEFAULT
        if not isinstance(value, ClassAttribute):
            setattr(cls, name, ClassAttribute(name, value))


def default_of(cls: type[Any], name: str) -> Any:
    """The default that a class itself gives an attribute; NO_DEFAULT if it gives none."""
    value = vars(cls).get(name, NO_DEFAULT)
    return value.default if isinstance(value, ClassAttribute) else value
