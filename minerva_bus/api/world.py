"""Worlds in Python: made of classes, or loaded from a world file."""

from __future__ import annotations

import sys
import weakref
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final, cast

from minerva_bus.api.symbols import SymbolFinder, spec_of
from minerva_bus.collect.plans import read_entries
from minerva_bus.errors import MisuseError, WorldFileError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.reading import read_tables, read_world_file
from minerva_bus.launch.resuming import option_text
from minerva_bus.launch.specs import bind, find_service
from minerva_bus.launch.toml import read_toml, toml_text
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.outputs import write_output
from minerva_bus.settings.declaring import check_known, settings_of
from minerva_bus.settings.overrides import AS_WRITTEN, Overrides
from minerva_bus.settings.tables import WorldSettings
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Service

if TYPE_CHECKING:
    from minerva_bus.api.async_live import AsyncLive
    from minerva_bus.api.live import Live

MAKE: Final = "make"
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
    plain = {key: _plain(value) for key, value in options.items()}
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
    event_type = _plain(event)
    return ServiceSpec("each", {"event": event_type, "every": every}, name or event_type)


class World:
    """A world: its string, its agents and services, and its settings.

    Args:
        string: the initial string, as a text of the language, as a `Scene`, or as a function that
            takes the options and returns either.
        agents: agent classes, or a mapping from names of processes to them; default: those of the
            string that the calling code can access.
        services: generators and devices: classes, installed names, `service(...)` and `each(...)`,
            or a mapping from names of processes to them.
        name: of the world; letters, digits and `_ . ~ -`.
        options: the world's own options with their defaults; a function `string` takes them.
        symbols: further symbols that cannot be found in code, or a complete `Vocabulary`.
        collect: expressions that each run collects, by name, such as
            `{"sick": count(Person, "sick == true")}`.
        norms, placement: tables of the world file, by name; see docs/norms.md, docs/fleet.md.
        settings: the settings of [world] in docs/worlds.md: `seed`, `frames`, `dt` (seconds),
            `rate` (frames per second), `order` (event types or their names), `until`, ...

    Raises MisuseError, WorldFileError and SceneError if the world cannot be read.

    Example:
        >>> world = World("ASnail#anna · ASnail#bert<x=2>", services=[each(eSun)], order=[eSun])
        >>> run(world, frames=100).scene

    """

    def __init__(
        self,
        string: str | Scene | Callable[[Mapping[str, Any]], str | Scene],
        *,
        agents: Iterable[type[Agent]] | Mapping[str, Any] | None = None,
        services: Iterable[Any] | Mapping[str, Any] = (),
        name: str = "world",
        options: Mapping[str, Any] | None = None,
        symbols: Iterable[Any] = (),
        collect: Any = None,
        norms: Mapping[str, Any] | None = None,
        placement: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        # The caller's variables: symbols that the code names in strings only are looked up among
        # them.
        frame = sys._getframe(1)  # pyright: ignore[reportPrivateUsage]
        made = _Made(
            string, name, dict(options or {}), {**frame.f_globals, **frame.f_locals}, settings
        )
        made.find(agents, services, symbols)
        made.tables["norm"] = dict(norms or {})
        made.tables["placement"] = dict(placement or {})
        entries = read_entries(collect) if collect is not None else {}
        made.tables["collect"] = {key: str(entry) for key, entry in entries.items()}
        self._made: _Made | None = made
        self._path: Path | None = None
        self._given = AS_WRITTEN
        # The module would otherwise stay for as long as the program runs.
        weakref.finalize(self, sys.modules.pop, made.module.__name__, None)
        self.read()

    @classmethod
    def load(cls, path: str | Path, **options: Any) -> World:
        """The world of a world file or an installed name, with its own options.

        Raises WorldFileError and SceneError if it cannot be read.

        Example:
            `World.load("garden.toml")`, `World.load("robot", robots=3)`

        """
        world = cls.__new__(cls)
        world._made = None
        world._path = find_world(str(path))
        world._given = Overrides({key: option_text(value) for key, value in options.items()})
        world.read()
        return world

    @property
    def name(self) -> str:
        """The world's name."""
        return self.read().world.name

    @property
    def vocabulary(self) -> Vocabulary:
        """Its symbols and event types."""
        return self.read().world.vocabulary

    @property
    def scene(self) -> Scene:
        """Its initial string."""
        return self.read().world.scene

    @property
    def agents(self) -> list[type[Agent]]:
        """The agent classes that its processes evolve."""
        processes = self.read().processes
        return list(dict.fromkeys(cls for process in processes for cls in process.agents))

    def read(self, overrides: Overrides = AS_WRITTEN) -> WorldFile:
        """The world with some settings replaced, checked. Raises WorldFileError and SceneError."""
        # Settings of a run take precedence over the options of `load`.
        overrides = overrides.over(self._given)
        if self._made is not None:
            path = Path.cwd() / f"{self._made.name}.toml"
            return read_tables(self._made.tables, path, overrides)
        assert self._path is not None
        return read_world_file(self._path, overrides)

    def save(self, path: str | Path) -> None:
        """Write the world as a world file, for `minerva run` and for other processes.

        Raises MisuseError if a class or symbol is not in a module that other processes can import,
        or if the file cannot be written.
        """
        target = Path(path)
        if target.suffix != ".toml":
            raise MisuseError(f"{target}: the name of a world file ends with .toml")
        write_output(target, self.toml().encode(), "world file")

    def toml(self) -> str:
        """The text of its world file. Raises MisuseError as `save` does."""
        if self._made is None:
            return self.read().text
        return self._made.toml()

    def tables(self) -> dict[str, Any]:
        """The tables of its world file."""
        return read_toml(self.read().text) if self._made is None else self._made.tables

    @property
    def path(self) -> Path | None:
        """Its world file; None if it was made in Python."""
        return self._path

    @property
    def given(self) -> Overrides:
        """The options that it was loaded with."""
        return self._given

    def start(self, *, bus: bool = False, **settings: Any) -> Live:
        """Start the world, paused, to run it frame by frame; see `Live`.

        Args:
            bus: start processes; otherwise everything runs in this one.
            settings: as for `run`: `seed`, `collect`, `into`, `processes`, `record`, and options.

        Raises MinervaError if it cannot start.

        Example:
            >>> with world.start(seed=7) as live:
            ...     live.step(10)
            ...     live.publish(eRain())
            ...     print(live.frame, live.scene)

        """
        from minerva_bus.api.live import start

        return start(self, bus=bus, **settings)

    def start_async(self, *, bus: bool = False, **settings: Any) -> AsyncLive:
        """As `start`, for `async with`: `step`, `publish` and the others are awaited."""
        from minerva_bus.api.async_live import AsyncLive

        return AsyncLive(lambda: self.start(bus=bus, **settings))

    def __repr__(self) -> str:
        agents = ", ".join(cls.__name__ for cls in self.agents) or "no agents"
        return f"<World {self.name!r}: {agents}>"


class _Made:
    """A world that was made in Python, as the tables of a world file.

    Its classes are attributes of a module that exists in this process only, so that they are found
    like those of a world file.
    """

    def __init__(
        self,
        string: str | Scene | Callable[[Mapping[str, Any]], str | Scene],
        name: str,
        options: dict[str, Any],
        names: Mapping[str, Any],
        settings: Mapping[str, Any],
    ) -> None:
        known = {key: value for key, value in settings_of(WorldSettings).items() if value.key}
        check_known(settings, known)
        self.name = name
        self.module = ModuleType(f"minerva_world_{next(_numbers)}")
        sys.modules[self.module.__name__] = self.module
        self._string = string
        self._finder = SymbolFinder(names)
        world = {key: _plain(value) for key, value in settings.items()}
        self.tables: dict[str, Any] = {"world": {"name": name, **world}, "options": options}

    def find(
        self,
        agents: Iterable[type[Agent]] | Mapping[str, Any] | None,
        services: Iterable[Any] | Mapping[str, Any],
        symbols: Iterable[Any],
    ) -> None:
        """Find agents, services and vocabulary, and describe the processes."""
        finder, processes = self._finder, dict[str, Any]()
        for symbol in symbols:
            finder.add(symbol)
        self._add_string()
        given: Mapping[str, Any] = (
            cast("Mapping[str, Any]", agents)
            if isinstance(agents, Mapping)
            else {"agents": list(agents)}
            if agents is not None
            else {}
        )
        for classes in given.values():
            for cls in _listed(classes):
                finder.add(cls)
        for process, spec in self._services(services):
            cls = find_service(spec.service) if isinstance(spec.service, str) else spec.service
            # An instance, because event types may depend on its options.
            finder.add_service(cls, bind(cls, spec.options, f"{self.name}: {process}")())
            own = spec.service if isinstance(spec.service, str) else self._keep(cls)
            processes[process] = {"service": own, **spec.options}
        vocabulary = finder.vocabulary()
        # Found in the string and in code, after services have added the event types that they use.
        if agents is None:
            given = {"agents": list(finder.agents().values())}
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

    def _add_string(self) -> None:
        world, string = self.tables["world"], self._string
        if isinstance(string, str):
            world["string"] = string
            # A text with options can be parsed only after they are filled in.
            if "${" not in string:
                self._finder.add_scene(parse(string, f"{self.name}: the string"))
        elif isinstance(string, Scene):
            # World files name a function that takes the options.
            world["scene"] = self._keep(partial(_same, string), MAKE)
            self._finder.add_scene(string)
        elif callable(string):  # pyright: ignore[reportUnnecessaryComparison]
            world["scene"] = self._keep(string, MAKE)
            self._finder.add_function(string)
            # Made once with the defaults, to find its symbols.
            made = string(dict(self.tables["options"]))
            self._finder.add_scene(parse(made) if isinstance(made, str) else made)
        else:
            raise MisuseError(f"{self.name}: a string is a text or a Scene, not {string!r:.60}")

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
        world = dict(self.tables["world"])
        vocabulary: Vocabulary = vars(self.module)["vocabulary"]
        kinds = self._finder.agents()
        entries: list[Any] = [
            *vocabulary.primitives.values(),
            *vocabulary.transformations.values(),
            *vocabulary.events.values(),
            *[kinds[name] for name in vocabulary.kinds],
        ]
        world["vocabulary"] = [spec_of(entry, _shown(entry)) for entry in entries]
        if isinstance(self._string, Scene):
            # The text can be written to a file, the function in this process cannot.
            del world["scene"]
            world["string"] = str(self._string)
        elif "scene" in world:
            world["scene"] = spec_of(self._string, "the function that makes the string")
        processes = {
            name: {key: self._public(value) for key, value in table.items()}
            for name, table in self.tables["process"].items()
        }
        return toml_text({**self.tables, "world": world, "process": processes})

    def _public(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self._public(item) for item in cast("list[Any]", value)]
        prefix = f"{self.module.__name__}:"
        if isinstance(value, str) and value.startswith(prefix):
            thing = getattr(self.module, value.removeprefix(prefix))
            return spec_of(thing, _shown(thing))
        return value


def world_of(world: World | str | Path, options: Mapping[str, Any]) -> World:
    """A world, or the one of a world file, with its own options. Raises WorldFileError."""
    if isinstance(world, str | Path):
        return World.load(world, **options)
    if not isinstance(world, World):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"{world!r:.60} is no World, and no name of a world file")
    return world


def own_options(world: World, options: Mapping[str, Any]) -> Mapping[str, str]:
    """The values of a world's options as texts. Raises WorldFileError for unknown ones."""
    known = world.read().options
    for name in options:
        if name not in known:
            names = f"it has {', '.join(known) or 'none'}"
            raise WorldFileError(
                f"{world.name} has no option {name!r}{nearest(name, list(known), names)}"
            )
    return {name: option_text(value) for name, value in options.items()}


def _same(scene: Scene, options: Mapping[str, Any]) -> Scene:
    """The string of a world whose options do not change it."""
    return scene


def _listed(classes: Any) -> list[Any]:
    return [classes] if isinstance(classes, type) else list(classes)


def _plain(value: Any) -> Any:
    """A setting or option as in a world file: event types by their names, paths as texts."""
    if isinstance(value, EventType):
        return value.name
    if isinstance(value, list | tuple):
        return [_plain(item) for item in cast("list[Any]", value)]
    if isinstance(value, Path):
        return str(value)
    return value


def _shown(thing: Any) -> str:
    return str(getattr(thing, "__name__", getattr(thing, "name", thing)))
