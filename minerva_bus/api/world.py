"""Worlds in Python, made of classes or loaded from a world file, and the settings of one run."""

from __future__ import annotations

import re
import sys
import warnings
import weakref
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

from minerva_bus.api.python_tables import PythonTables
from minerva_bus.collect.data_tables import check_table
from minerva_bus.collect.plans import plans_of, read_entries
from minerva_bus.errors import MisuseError, SceneError, WorldFileError, nearest
from minerva_bus.files import check_ending, write_output
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.toml_tables import option_text, read_toml
from minerva_bus.launch.world_files import (
    Collecting,
    WorldFile,
    read_tables,
    read_world_file,
    several_hosts,
)
from minerva_bus.settings.world_settings import AS_WRITTEN, OPTIONS, Overrides
from minerva_bus.values import fast_dataclass, named, path_of
from minerva_bus.world.agent import Agent

if TYPE_CHECKING:
    from minerva_bus.api.live import Live
    from minerva_bus.launch.past import WorldSource
    from minerva_bus.runtime.coordinator import Coordinator


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
        symbols: Iterable[Any] | Vocabulary = (),
        collect: Any = None,
        norms: Mapping[str, Any] | None = None,
        placement: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        # The caller's variables: symbols that the code names in strings only are looked up among
        # them.
        frame = sys._getframe(1)  # pyright: ignore[reportPrivateUsage]
        made = PythonTables(string, name, named("options", options or {}), settings)
        made.find(agents, services, symbols, {**frame.f_globals, **frame.f_locals})
        made.tables["norm"] = named("norms", norms or {})
        made.tables["placement"] = named("placement", placement or {})
        entries = read_entries(collect) if collect is not None else {}
        made.tables["collect"] = {key: str(entry) for key, entry in entries.items()}
        self._made: PythonTables | None = made
        self._path: Path | None = None
        self._given = AS_WRITTEN
        # The module would otherwise stay for as long as the program runs.
        weakref.finalize(self, sys.modules.pop, made.module.__name__, None)
        self._file = self.read()
        for line in self._file.warnings:
            warnings.warn(line, UserWarning, stacklevel=2)

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
        world._file = world.read()
        return world

    @property
    def name(self) -> str:
        """The world's name."""
        return self._file.world.name

    @property
    def vocabulary(self) -> Vocabulary:
        """Its symbols and event types."""
        return self._file.world.vocabulary

    @property
    def scene(self) -> Scene:
        """Its initial string."""
        return self._file.world.scene

    @property
    def agents(self) -> list[type[Agent]]:
        """The agent classes that its processes evolve."""
        processes = self._file.processes
        return list(dict.fromkeys(cls for process in processes for cls in process.agents))

    def read(self, overrides: Overrides = AS_WRITTEN) -> WorldFile:
        """The world with some settings replaced, checked. Raises WorldFileError and SceneError."""
        # Settings of a run take precedence over the options of `load`.
        overrides = overrides.over(self._given)
        if self._made is not None:
            path = Path.cwd() / f"{self._made.name}.toml"
            with arguments_named(f"{path}: "):  # There is no such file.
                return read_tables(self._made.tables, path, overrides)
        assert self._path is not None
        return read_world_file(self._path, overrides)

    def save(self, path: str | Path) -> None:
        """Write the world as a world file, for `minerva run` and for other processes.

        Raises MisuseError if a class or symbol is not in a module that other processes can import,
        or if the file cannot be written.
        """
        target = path_of("path", path)
        check_ending(target, (".toml",), "world file")
        write_output(target, self.toml().encode(), "world file")

    def toml(self) -> str:
        """The text of its world file. Raises MisuseError as `save` does."""
        if self._made is None:
            return self._file.text
        return self._made.toml()

    def tables(self) -> dict[str, Any]:
        """The tables of its world file."""
        return read_toml(self._file.text) if self._made is None else self._made.tables

    @property
    def path(self) -> Path | None:
        """Its world file; None if it was made in Python."""
        return self._path

    @property
    def file(self) -> WorldFile:
        """The world with its own settings, as it was read when this object was made."""
        return self._file

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

    def __repr__(self) -> str:
        agents = ", ".join(cls.__name__ for cls in self.agents) or "no agents"
        return f"<World {self.name!r}: {agents}>"


def world_of(world: World | str | Path, options: Mapping[str, Any]) -> World:
    """A world, or the one of a world file, with its own options. Raises WorldFileError."""
    if isinstance(world, str | Path):
        return World.load(world, **options)
    if not isinstance(world, World):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"{world!r:.60} is neither a World nor the name of a world file")
    return world


@contextmanager
def arguments_named(place: str = "") -> Generator[None]:
    """Let errors name arguments, not options of the command line, and leave out a place."""
    try:
        yield
    except (WorldFileError, SceneError, MisuseError) as error:
        text = str(error).replace(place, "")
        error.args = (_FLAG.sub(lambda match: match[1].replace("-", "_"), text),)
        raise


_FLAG: Final = re.compile(r"(?<![\w-])--([a-z][a-z-]*)")


def own_options(world: World, options: Mapping[str, Any]) -> Mapping[str, str]:
    """The values of a world's options as texts. Raises WorldFileError for unknown ones."""
    known = world.file.options
    for name in options:
        if name not in known:
            names = f"it has {', '.join(known) or 'none'}"
            hint = nearest(name, [*known, *OPTIONS], names)
            raise WorldFileError(f"{world.name} has no option {name!r}{hint}")
    return {name: option_text(value) for name, value in options.items()}


Processes: TypeAlias = int | Literal["auto"] | None
"""Number of processes for each kind of agents; None: as the world says, without a bus."""


@fast_dataclass
class ContinuedRecord:
    """The record that a run continues.

    A subclass begins with a record otherwise. Its fields are JSON values, with which the launcher
    of the run makes an equal object.
    """

    record: str

    def read(
        self, world: WorldSource, overrides: Overrides
    ) -> tuple[WorldFile, Callable[..., Coordinator]]:
        """The world of the run, and what makes its coordinator.

        Raises RecordError and MinervaError.
        """
        # Only here: the library of records is an extra.
        from minerva_bus.launch.past import read_resumed
        from minerva_bus.runtime.coordinator import Coordinator

        return read_resumed(path_of("record", self.record), world, overrides), Coordinator


@fast_dataclass
class Request:
    """A world with the settings of one run; `past`: the record that it continues."""

    world: World
    overrides: Overrides
    file: WorldFile
    past: ContinuedRecord | None = None

    def needs_bus(self, bus: bool, processes: Processes) -> bool:
        """Whether the run starts processes, by the arguments `bus` and `processes` of `run`."""
        if processes == "auto":
            return bus or several_hosts(self.file.processes)
        return bus or processes is not None


def request_of(
    world: World,
    options: Mapping[str, Any],
    *,
    collect: Any = None,
    into: str | Path = "",
    processes: Processes = None,
    record: str | Path = "",
    past: ContinuedRecord | None = None,
    **values: Any,
) -> Request:
    """The settings of one run, checked. Raises MinervaError."""
    overrides = Overrides(
        own_options(world, options),
        _processes(world, processes),
        record=str(record) if record else None,
        into=str(into) if into and collect is None else None,
        **values,
    )
    with arguments_named():
        file = world.read(overrides) if past is None else past.read(world.read, overrides)[0]
    if collect is not None:
        file = _collecting(file, collect, into)
    return Request(world, overrides, file, past)


def _processes(world: World, count: Processes) -> tuple[str, ...]:
    """The settings for this number of processes for each kind of agents."""
    if count is None:
        return ()
    if isinstance(count, int) and count < 1:
        raise MisuseError(f'processes is {count}; expected at least 1, or "auto"')
    # Settings name a table of the world file, which may stand for several processes.
    hosts = [process.table for process in world.file.processes if process.agents]
    return tuple(dict.fromkeys(f"{name}.processes={count}" for name in hosts))


def _collecting(file: WorldFile, collect: Any, into: str | Path) -> WorldFile:
    entries = read_entries(collect)
    if into != "":
        check_table(path_of("into", into))
    # The plans are made for their checks: errors appear here, before any process starts.
    plans_of(entries, file.world.vocabulary)
    return replace(file, collect=Collecting(entries, str(into)))
