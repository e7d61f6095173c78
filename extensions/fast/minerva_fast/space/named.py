"""The rules that the methods of a class name, found in their code before they run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast

from minerva_fast.compiled.origin import MISSING, lookup
from minerva_fast.space.rules import SpaceRule


def rules_of(cls: type) -> list[SpaceRule]:
    """The rules that methods of a class refer to, each once.

    By name, as `module.name`, in a tuple or list, or in a function of the same module that a method
    calls. Others are compiled when they first run.
    """
    rules: dict[SpaceRule, None] = {}
    known: set[FunctionType] = set()
    for base in reversed(cls.__mro__):
        for value in vars(base).values():
            if isinstance(value, FunctionType):
                rules |= dict.fromkeys(_rules_in(value, known))
    return list(rules)


def _rules_in(function: FunctionType, known: set[FunctionType]) -> Iterator[SpaceRule]:
    if function in known:
        return
    known.add(function)
    for value in _values(function):
        if isinstance(value, FunctionType):
            if value.__module__ == function.__module__:
                yield from _rules_in(value, known)
        else:
            yield from _among(value)


def _among(value: Any) -> Iterator[SpaceRule]:
    if isinstance(value, SpaceRule):
        yield value
    elif isinstance(value, tuple | list):
        for item in cast("Iterable[Any]", value):
            yield from _among(item)


def _values(function: FunctionType) -> Iterator[Any]:
    """The objects that a function names, and those of modules that it names."""
    names = list(dict.fromkeys(_names(function.__code__)))
    for name in names:
        value = lookup(function, name)
        if isinstance(value, ModuleType):
            for attribute in names:
                yield getattr(value, attribute, MISSING)
        yield value


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    yield from code.co_freevars
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)
