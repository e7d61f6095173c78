"""Worlds that are made in Python, as the tables of a world file; their services with options.

`SymbolFinder` finds the symbols that a world uses: in its string, its agents' code and services.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, TypeAlias, cast

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import AgentNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import (
    AgentKind,
    EventType,
    Primitive,
    Transformation,
    Vocabulary,
)
from minerva_bus.launch.specs import Factory, find_service
from minerva_bus.launch.toml_tables import filled, toml_text
from minerva_bus.settings.kinds import check_known, settings_of
from minerva_bus.settings.world_settings import WorldSettings
from minerva_bus.user_code import variables_of
from minerva_bus.values import named, text
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Device, Generator, Service

Symbol: TypeAlias = Primitive | Transformation | EventType | type[Agent]

MAIN: Final = "__main__"
_OWN: Final = __name__.partition(".")[0]

MAKE: Final = "make"

_ARGUMENTS: Final = ("agents", "services", "symbols", "options", "collect", "norms", "placement")
"""Arguments of `World` beside its settings."""

_numbers = count(1)


@dataclass(frozen=True, slots=True)
class ServiceSpec:
    """A generator or device of a world: its class or installed name, and its options."""

    service: str | type[Service]
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    name: str = ""


def service(service: str | type[Service], name: str = "", **options: Any) -> ServiceSpec:
    """A generator or device for `World(services=[...])`.

    Args:
        service: an installed name, such as "neighbours", or a class.
        name: of its process; default: that of the service.
        options: arguments of its constructor. An event type is replaced by its name.

    Example:
        `service("neighbours", radius=2.0, event=eNear)`

    """
    plain = {key: plain_setting(value) for key, value in options.items()}
    return ServiceSpec(service, plain, name)


def each(event: EventType | str, every: int = 1, name: str = "") -> ServiceSpec:
    """A generator of one event without data, in each `every`-th frame, beginning with frame 0.

    Raises MisuseError if it has data.

    Example:
        `World(..., services=[each(eDay), each(eRain, every=7)])`

    """
    if isinstance(event, Event):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(
            f"each({event}): expected an event type, such as each({event.type}); its data are the"
            f" defaults of the type: EventType({event.type!r}, amount=Default(float, 0.5))"
        )
    event_type = text("event", plain_setting(event))
    return ServiceSpec("each", {"event": event_type, "every": every}, name or event_type)


def plain_setting(value: Any) -> Any:
    """A setting or option as in a world file: event types by their names, paths as texts."""
    if isinstance(value, EventType):
        return value.name
    if isinstance(value, list | tuple):
        return [plain_setting(item) for item in cast("list[Any]", value)]
    if isinstance(value, Path):
        return str(value)
    return value


class PythonTables:
    """A world that was made in Python, as the tables of a world file.

    Its classes are attributes of a module that exists in this process only, so that they are found
    like those of a world file.
    """

    def __init__(
        self,
        string: str | Scene | Callable[[Mapping[str, Any]], str | Scene],
        name: str,
        options: dict[str, Any],
        settings: Mapping[str, Any],
    ) -> None:
        known = {key: value for key, value in settings_of(WorldSettings).items() if value.key}
        check_known(settings, known, _ARGUMENTS)
        self.name = name
        self.module = ModuleType(f"minerva_world_{next(_numbers)}")
        sys.modules[self.module.__name__] = self.module
        self._string = string
        self._kinds: dict[str, type[Agent]] = {}
        world = {key: plain_setting(value) for key, value in settings.items()}
        self.tables: dict[str, Any] = {"world": {"name": name, **world}, "options": options}

    def find(
        self,
        agents: Iterable[type[Agent]] | Mapping[str, Any] | None,
        services: Iterable[Any] | Mapping[str, Any],
        symbols: Iterable[Any] | Vocabulary,
        names: Mapping[str, Any],
    ) -> None:
        """Find agents, services and vocabulary, and describe the processes.

        `names` are the variables of the calling code. They are not kept: they may refer to a
        running world, which has to end when its last variable is deleted.
        """
        self._check_list("agents", () if agents is None else agents, "agents=[Fox]")
        self._check_list("services", services, "services=[Sun, each(eTick)]")
        symbols = [symbols] if isinstance(symbols, Vocabulary) else symbols
        self._check_list("symbols", symbols, "symbols=[PDot]")
        finder = SymbolFinder(names)
        for symbol in symbols:
            finder.add(symbol)
        self._add_string(finder)
        given = _by_process(agents)
        for classes in given.values():
            for cls in _listed(classes):
                finder.add(cls)
        processes = {
            process: self._process(process, spec, finder)
            for process, spec in self._services(services)
        }
        vocabulary = finder.vocabulary()
        self._kinds = finder.agents()
        # Found in the string and in code, after services have added the event types that they use.
        if agents is None:
            given = _by_process(self._kinds.values())
        hosts = {
            process: {"agents": [self._keep(cls) for cls in _listed(classes)]}
            for process, classes in given.items()
            if _listed(classes)
        }
        twice = hosts.keys() & processes.keys()
        if twice:
            raise MisuseError(f"{self.name}: two processes are called {min(twice)}")
        self.tables["process"] = {**hosts, **processes}
        self.tables["world"]["vocabulary"] = self._keep(vocabulary, "vocabulary")

    def _process(self, name: str, spec: ServiceSpec, finder: SymbolFinder) -> dict[str, Any]:
        """The table of a service's process; its symbols go to the finder."""
        cls = find_service(spec.service) if isinstance(spec.service, str) else spec.service
        options = self._filled(dict(spec.options))
        # An instance, because event types may depend on its options.
        finder.add_service(cls, Factory(cls, options, f"{self.name}: {name}")())
        own = spec.service if isinstance(spec.service, str) else self._keep(cls)
        return {"service": own, **spec.options}

    def _filled(self, value: Any) -> Any:
        """A value with the defaults of the options in place of `${option}`."""
        return filled(value, self.tables["options"], Path(f"{self.name}"))

    def _check_list(self, name: str, given: object, example: str) -> None:
        if isinstance(given, str) or not isinstance(given, Iterable):
            raise MisuseError(
                f"{self.name}: {name} is a list, such as {example}, not {given!r:.60}"
            )

    def _add_string(self, finder: SymbolFinder) -> None:
        world, string = self.tables["world"], self._string
        if isinstance(string, str):
            world["string"] = string
            finder.add_scene(parse(self._filled(string), f"{self.name}: the string"))
        elif isinstance(string, Scene):
            # World files name a function that takes the options.
            world["scene"] = self._keep(partial(_same, string), MAKE)
            finder.add_scene(string)
        elif callable(string):  # pyright: ignore[reportUnnecessaryComparison]
            world["scene"] = self._keep(string, MAKE)
            finder.add_function(string)
            # Made once with the defaults, to find its symbols. The reader of the tables calls it
            # again, and reports an error with its line.
            with suppress(Exception):
                made = string(dict(self.tables["options"]))
                finder.add_scene(parse(made) if isinstance(made, str) else made)
        else:
            raise MisuseError(
                f"{self.name}: a string is a text, a Scene, or a function that returns one, not"
                f" {string!r:.60}; of agents: Fox('a').string + Fox('b').string"
            )

    def _services(self, services: Any) -> Iterable[tuple[str, ServiceSpec]]:
        named: list[tuple[str, Any]] = (
            list(cast("Mapping[str, Any]", services).items())
            if isinstance(services, Mapping)
            else [("", given) for given in services]
        )
        taken: set[str] = set()
        for name, given in named:
            spec = given if isinstance(given, ServiceSpec) else ServiceSpec(given)
            if not isinstance(spec.service, str) and not (
                isinstance(spec.service, type) and issubclass(spec.service, Service)  # pyright: ignore[reportUnnecessaryIsInstance]
            ):
                raise MisuseError(
                    f"{self.name}: a service is a class or an installed name, not {given!r:.60};"
                    " options: service(MyService, option=value)"
                )
            own = spec.service if isinstance(spec.service, str) else spec.service.__name__.lower()
            process = name or spec.name or own.rpartition(":")[2]
            if process in taken:
                raise MisuseError(
                    f"{self.name}: two services are called {process}; name one, name=..."
                )
            taken.add(process)
            yield process, spec

    def _keep(self, thing: Any, name: str = "") -> str:
        """Keep a class, function or vocabulary in the module; its spec."""
        name = name or thing.__name__
        # Two classes of different modules may have the same name.
        while getattr(self.module, name, thing) is not thing:
            name += "_"
        setattr(self.module, name, thing)
        return f"{self.module.__name__}:{name}"

    def toml(self) -> str:
        """The text of a world file that other processes can read. Raises MisuseError."""
        # First, so that errors name classes of the user before the symbols that they make.
        processes = {
            name: {key: self._public(value) for key, value in table.items()}
            for name, table in self.tables["process"].items()
        }
        world = dict(self.tables["world"])
        vocabulary: Vocabulary = vars(self.module)["vocabulary"]
        entries: list[Any] = [
            *vocabulary.primitives.values(),
            *vocabulary.transformations.values(),
            *vocabulary.events.values(),
            *[self._kinds[name] for name in vocabulary.kinds],
        ]
        world["vocabulary"] = [spec_of(entry, shown(entry)) for entry in entries]
        if isinstance(self._string, Scene):
            # The text can be written to a file, the function in this process cannot.
            del world["scene"]
            world["string"] = str(self._string)
        elif "scene" in world:
            world["scene"] = spec_of(self._string, "the function that makes the string")
        return toml_text({**self.tables, "world": world, "process": processes})

    def _public(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self._public(item) for item in cast("list[Any]", value)]
        prefix = f"{self.module.__name__}:"
        if isinstance(value, str) and value.startswith(prefix):
            thing = getattr(self.module, value.removeprefix(prefix))
            return spec_of(thing, shown(thing))
        return value


def _same(scene: Scene, options: Mapping[str, Any]) -> Scene:
    """The string of a world whose options do not change it."""
    return scene


def _by_process(agents: Iterable[Any] | Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Classes of agents by the process that hosts them; those of a list are in `agents`."""
    if isinstance(agents, Mapping):
        return named("agents", agents)
    return {} if agents is None else {"agents": list(agents)}


def _listed(classes: Any) -> list[Any]:
    if isinstance(classes, type):
        return [classes]
    if not isinstance(classes, Iterable):
        raise MisuseError(f"agents: a process has classes of agents, not {classes!r:.60}")
    return list(cast("Iterable[Any]", classes))


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
            # What is misspelt is reported at its place, when the string and the services are read.
            if name not in self._symbols and not nearest(name, list(self._symbols)):
                kind = "agents=[...]" if name.startswith("A") else "symbols=[...]"
                remedy = f"declare or import it there, or give World {kind}"
                raise MisuseError(f"the calling code has no {name}; {remedy}")
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
