"""Warnings about class attributes of agents that methods change: all agents share the object."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections import deque
from collections.abc import Iterator
from typing import Any, Final

from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.world.agent import Agent

_MUTABLE: Final[tuple[type, ...]] = (list, dict, set, bytearray, deque)
_CHANGING: Final = frozenset(
    {
        *("append", "appendleft", "extend", "extendleft", "insert", "add", "update", "setdefault"),
        *("pop", "popleft", "popitem", "remove", "discard", "clear", "sort", "reverse"),
    }
)
"""Methods that change an object of these types."""


def shared_attributes(file: WorldFile) -> list[str]:
    """A warning for each list, dict or set of an agent class that its methods change.

    One that methods only read is a constant.
    """
    classes = dict.fromkeys(cls for process in file.processes for cls in process.agents)
    bases = dict.fromkeys(base for cls in classes for base in cls.__mro__)
    own = [cls for cls in bases if issubclass(cls, Agent) and cls is not Agent]
    return list(dict.fromkeys(text for cls in own for text in _warnings(cls, own)))


def _warnings(cls: type[Agent], classes: list[type[Agent]]) -> Iterator[str]:
    kinds: dict[str, type] = {name: type(value) for name, value in vars(cls).items()}
    shared = {
        name: kind.__name__
        for name, kind in kinds.items()
        if not set(kind.__mro__).isdisjoint(_MUTABLE)
    }
    for user in classes if shared else ():
        if not issubclass(user, cls):
            continue
        for name, line in _changes(user):
            if name in shared:
                yield (
                    f"{inspect.getsourcefile(user)}:{line}: {user.__name__} changes {name}, a"
                    f" {shared[name]} that all agents share: it is no state, so it is not in the"
                    " string and differs between processes; declare an attribute of the agent, such"
                    f" as {name}: tuple[str, ...] = (), and assign to self.{name}"
                )


def _changes(cls: type[Agent]) -> Iterator[tuple[str, int]]:
    """The attributes whose objects methods of a class change, each with the line."""
    try:
        lines, first = inspect.getsourcelines(cls)
        tree = ast.parse(textwrap.dedent("".join(lines)))
    except (OSError, TypeError, SyntaxError):
        return  # Made without a file, as in an interactive session.
    for node in ast.walk(tree):
        for changed in _changed(node):
            if isinstance(changed, ast.Attribute) and isinstance(changed.value, ast.Name):
                yield changed.attr, first + changed.lineno - 1


def _changed(node: ast.AST) -> list[Any]:
    """The expressions whose objects a statement or a call changes."""
    match node:
        case ast.Call(func=ast.Attribute(value=value, attr=method)) if method in _CHANGING:
            return [value]
        case ast.Subscript(value=value, ctx=ast.Store() | ast.Del()):
            return [value]
        case ast.AugAssign(target=target):
            return [target]
        case _:
            return []
