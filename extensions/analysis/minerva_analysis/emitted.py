"""Search for the event types that an agent's code may emit."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from functools import cache
from types import FunctionType, ModuleType
from typing import Any, Final, cast

from minerva_bus.api.python_tables import names_in
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.user_code import variables_of
from minerva_bus.world.agent import Agent

_KERNEL: Final = "minerva_bus"


def emitted_by(cls: type[Agent]) -> set[str]:
    """The event types that an agent's code names as variables, and thus may emit.

    The search follows functions, classes and tables of them in the agent's own package, in files
    that are not installed, and in installed modules that use Minerva Bus. The code of other agents,
    such as children, does not count.
    """
    search = _EventTypeSearch(cls.__module__.partition(".")[0])
    for base in cls.__mro__:
        if base is not Agent and search.follows(base.__module__):
            search.enter(vars(base).values())
    return search.events


class _EventTypeSearch:
    def __init__(self, package: str) -> None:
        self.events: set[str] = set()
        self._package = package
        self._entered: set[int] = set()

    def follows(self, module: str) -> bool:
        """Whether the code of a module counts."""
        top = module.partition(".")[0]
        if top == self._package:
            return True
        file = getattr(sys.modules.get(module), "__file__", None)
        if file is None or top == _KERNEL or top in sys.stdlib_module_names:
            return False
        return "site-packages" not in file or _uses_kernel(module)

    def enter(self, values: Iterable[object]) -> None:
        """Search values and the code behind them."""
        waiting = [*values]
        while waiting:
            value = waiting.pop()
            if isinstance(value, EventType):
                self.events.add(value.name)
            elif id(value) not in self._entered:
                self._entered.add(id(value))
                waiting += self._behind(value)

    def _behind(self, value: object) -> Iterable[object]:
        # Static and class methods have `__func__`, properties `fget`.
        inner: Any = getattr(value, "__func__", getattr(value, "fget", value))
        if isinstance(inner, FunctionType):
            return _used_by(inner) if self.follows(inner.__module__) else ()
        if isinstance(inner, Mapping):
            return list(cast("Mapping[Any, object]", inner).values())
        if isinstance(inner, tuple | list):
            return list(cast("Iterable[object]", inner))
        if isinstance(inner, type):
            cls = cast("type[Any]", inner)
            follow = not issubclass(cls, Agent) and self.follows(cls.__module__)
            return list(vars(cls).values()) if follow else ()
        return ()


def _used_by(function: FunctionType) -> Iterable[object]:
    """The values of the names that a function uses."""
    names: dict[str, Any] = {**function.__globals__, **variables_of(function)}
    used = [*names_in(function.__code__)]
    values = [names[name] for name in used if name in names]
    # The code of `symbols.eBite` has both names but not which belongs to which, so all are tried.
    modules = [value for value in values if isinstance(value, ModuleType)]
    return [*values, *(vars(m)[name] for m in modules for name in used if name in vars(m))]


@cache
def _uses_kernel(module: str) -> bool:
    """Whether a module has a variable of the kernel: its classes, functions or objects of them."""
    values = vars(sys.modules[module]).values()
    homes = (getattr(value, "__module__", None) or type(value).__module__ for value in values)
    return any(str(home).partition(".")[0] == _KERNEL for home in homes)
