"""Search for the symbols that a world uses: in its string, its agents' code and services."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, TypeAlias, cast

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import AgentNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import (
    AgentKind,
    EventType,
    Primitive,
    Transformation,
    Vocabulary,
)
from minerva_bus.user_code import variables_of
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Device, Generator, Service

Symbol: TypeAlias = Primitive | Transformation | EventType | type[Agent]

MAIN: Final = "__main__"
_OWN: Final = __name__.partition(".")[0]


class SymbolFinder:
    """Collects symbols by name, from the code that uses them.

    Names in code are looked up as Python does: in the variables of the function, then in its
    module. Names in strings, such as event types in `@on("eRain")`, are looked up among all symbols
    of the modules visited so far and of `names`, the variables of the calling code.
    """

    def __init__(self, names: Mapping[str, Any]) -> None:
        self._namespaces: list[Mapping[str, Any]] = [names]
        self._symbols: dict[str, Symbol] = {}
        self._walked: set[int] = set()
        self._wanted: dict[str, None] = {}

    def add(self, symbol: object) -> None:
        """Add a symbol, with those that it uses. Raises MisuseError for anything else."""
        if isinstance(symbol, Vocabulary):
            for table in (symbol.primitives, symbol.transformations, symbol.events):
                for entry in table.values():
                    self.add(entry)
        elif isinstance(symbol, Primitive | Transformation | EventType):
            self._symbols.setdefault(symbol.name, symbol)
        elif _is_agent(symbol):
            self._add_agent(cast("type[Agent]", symbol))
        elif isinstance(symbol, Agent):
            raise MisuseError(
                f"{symbol!r:.60} is an agent: give its class, {type(symbol).__name__}"
            )
        else:
            raise MisuseError(
                f"{symbol!r:.60} is not a symbol: give primitives, transformations, event types and"
                ' agent classes with a symbol, class Fox(Agent, symbol="AFox")'
            )

    def _add_agent(self, cls: type[Agent]) -> None:
        # Classes may use each other, so each one is walked once.
        if self._symbols.setdefault(cls.kind.name, cls) is cls and id(cls) not in self._walked:
            self._walked.add(id(cls))
            self._walk_class(cls, Agent)
            self._wanted |= dict.fromkeys(sorted(cls.kind.subscribes | cls.kind.views))

    def add_service(self, cls: type[Service], service: Service) -> None:
        """Add the event types of a service, and the symbols that its own code uses."""
        self._walk_class(cls, Service)
        if isinstance(service, Generator):
            self._wanted |= dict.fromkeys([*service.generates(), *service.takes_orders()])
        if isinstance(service, Device):
            self._wanted |= dict.fromkeys(service.draws)

    def add_scene(self, scene: Scene) -> None:
        """Add the symbols of a string."""
        waiting = [*reversed(scene.pieces)]
        while waiting:
            piece = waiting.pop()
            # Columns have their symbols once for all rows, so a million agents are not visited.
            levels = piece.levels() if isinstance(piece, Columns) else (piece,)
            self._wanted |= {level.symbol: None for level in levels}
            if isinstance(piece, TransformationNode | AgentNode):
                waiting += reversed(piece.scope.pieces)

    def add_function(self, function: object) -> None:
        """Add the symbols that a function uses."""
        if isinstance(function, FunctionType):
            self._walk_function(function)

    def vocabulary(self) -> Vocabulary:
        """All symbols. Raises MisuseError for a name of which the symbol is not known."""
        self._resolve()
        for name in self._wanted:
            if name not in self._symbols:
                kind = "agents=[...]" if name.startswith("A") else "symbols=[...]"
                remedy = f"declare or import it there, or give World {kind}"
                hint = nearest(name, list(self._symbols), remedy)
                raise MisuseError(f"the calling code has no {name}{hint}")
        return Vocabulary.of(*self._symbols.values())

    def agents(self) -> dict[str, type[Agent]]:
        """The agent classes, by symbol."""
        self._resolve()
        return {
            name: cast("type[Agent]", symbol)
            for name, symbol in self._symbols.items()
            if _is_agent(symbol)
        }

    def _resolve(self) -> None:
        """Look up names until none is new, because each agent may use further ones."""
        known: set[str] = set()
        while wanted := [name for name in self._wanted if name not in known]:
            known.update(wanted)
            for name in wanted:
                symbol = self._symbols.get(name) or self._named(name)
                if symbol is not None:
                    self.add(symbol)

    def _named(self, name: str) -> Symbol | None:
        for namespace in self._namespaces:
            for value in list(namespace.values()):
                if _is_symbol(value) and name == getattr(value, "kind", value).name:
                    return value
        return None

    def _walk_class(self, cls: type, root: type) -> None:
        for base in cls.__mro__:
            # Code of this package uses no symbols of the world.
            if base is root or base.__module__.partition(".")[0] == _OWN:
                continue
            for value in vars(base).values():
                # Static and class methods have `__func__`, properties `fget`.
                function = getattr(value, "__func__", getattr(value, "fget", value))
                self.add_function(function)

    def _walk_function(self, function: FunctionType) -> None:
        if id(function) in self._walked:
            return
        self._walked.add(id(function))
        # As Python resolves names: variables of an enclosing function hide those of the module.
        names = {**function.__globals__, **variables_of(function)}
        # Event types are also named in strings, which are looked up in every module met.
        if all(function.__globals__ is not known for known in self._namespaces):
            self._namespaces.append(function.__globals__)
        used = list(names_in(function.__code__))
        for name in used:
            value = names.get(name)
            if isinstance(value, ModuleType):
                # The code of `symbols.PFox` has both names but not which belongs to which, so all
                # are tried.
                for attribute in used:
                    self._use(vars(value).get(attribute))
            else:
                self._use(value)

    def _use(self, value: object) -> None:
        if _is_symbol(value):
            self.add(value)
        elif isinstance(value, FunctionType) and _is_near(value.__module__):
            self._walk_function(value)


def names_in(code: CodeType) -> Iterator[str]:
    """The global, attribute and enclosing names that code uses."""
    yield from code.co_names
    yield from code.co_freevars
    # Nested functions, lambdas and comprehensions are constants of the code around them.
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from names_in(constant)


def _is_near(module: str) -> bool:
    """Whether a module is the user's, not of this package or an installed one."""
    file = getattr(sys.modules.get(module), "__file__", None)
    own = module.partition(".")[0] == _OWN
    return not own and (file is None or "site-packages" not in file)


def _is_agent(value: object) -> bool:
    return (
        isinstance(value, type)
        and issubclass(value, Agent)
        and isinstance(getattr(value, "kind", None), AgentKind)
    )


def _is_symbol(value: object) -> bool:
    return isinstance(value, Primitive | Transformation | EventType) or _is_agent(value)


def spec_of(thing: Any, what: str) -> str:
    """The `module:attribute` by which other processes find a class, function or symbol.

    Raises MisuseError if they cannot.
    """
    module = getattr(thing, "__module__", "")
    if isinstance(thing, type | FunctionType):
        spec = f"{module}:{thing.__qualname__}"
        importable = _attribute(module, thing.__qualname__) is thing
    else:
        spec, importable = _variable_of(thing), True
        module = spec.partition(":")[0]
    if module == MAIN or not spec or not importable:
        where = "the program that runs (__main__)" if module == MAIN else "a function or cell"
        raise MisuseError(
            f"{what} is defined in {where}, where other processes cannot find it; move it into a"
            f" module, such as agents.py, and import it: from agents import {shown(thing)}"
        )
    return spec


def _attribute(module: str, qualname: str) -> Any:
    value: Any = sys.modules.get(module)
    for part in qualname.split("."):
        value = getattr(value, part, None)
    return value


def _variable_of(symbol: Any) -> str:
    """The `module:variable` of a symbol, preferably not in the main program; "" if none."""
    homes = [
        f"{name}:{variable}"
        for name, module in sys.modules.copy().items()
        # Modules of worlds made in Python exist in this process only, and libraries register the
        # main program under a second name.
        if name.partition(".")[0] not in (_OWN, "__mp_main__")
        and not name.startswith("minerva_world_")
        # Any object may stand in `sys.modules`.
        for variable, value in getattr(module, "__dict__", {}).copy().items()
        if value is symbol
    ]
    # Another module than the main program, which other processes cannot import.
    others = [home for home in homes if not home.startswith(f"{MAIN}:")]
    return (others or homes or [""])[0]


def shown(thing: Any) -> str:
    """The name of a class, function or symbol, for messages."""
    return str(getattr(thing, "__name__", getattr(thing, "name", thing)))
