"""World files: a world's string, its rules, and the processes that run it, in TOML.

    [world]
    string = "PMeadow · AFox#a<x=1, y=2> · AFox#b"   # or scene = "module:function"
    vocabulary = "meadow:vocabulary"
    order = ["eNear", "eHunger", "eRepresent"]

    [process.foxes]
    agents = "meadow:Fox"
    processes = 2

docs/worlds.md has every key.
"""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from minerva_bus.bus.session import check_endpoint
from minerva_bus.errors import MinervaError, MisuseError, WorldFileError, nearest
from minerva_bus.frame.description import World
from minerva_bus.frame.participant import Participant
from minerva_bus.frame.roster import objection
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.specs import SERVICES, bind, entries, find_agents, find_service, load
from minerva_bus.launch.table import Table
from minerva_bus.protocol.keys import COORDINATOR, checked_name
from minerva_bus.world.agent import Agent
from minerva_bus.world.evolution import Policy
from minerva_bus.world.order import Order
from minerva_bus.world.services import Service

MAX_BYTES = 16 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Process:
    """One process of a world, and what happens when it fails: restart, stop or ignore."""

    name: str
    make_service: Callable[[], Service] | None = None
    agents: tuple[type[Agent], ...] = ()
    command: tuple[str, ...] = ()
    folder: Path = field(default_factory=Path)
    on_failure: str = "restart"
    restarts: int = 5

    def participant(self) -> Participant:
        """The member that this process is."""
        service = self.make_service() if self.make_service is not None else None
        return Participant(self.name, service, self.agents)


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Where the coordinator listens and how long a frame waits for a member, seconds.

    `shared_memory`: large messages between processes of the world file do not go through sockets;
    None: where the initial string is large, and where there is room for it.
    """

    listen: str = "tcp/127.0.0.1:0"
    soft: float = 1.0
    hard: float = 30.0
    shared_memory: bool | None = None


@dataclass(frozen=True, slots=True)
class RecordSettings:
    """Where a run is recorded ("": nowhere), and how often it reaches the disk, seconds.

    `durable`: a frame counts once it is on the disk.
    """

    path: str = ""
    flush: float = 2.0
    durable: bool = False


@dataclass(frozen=True, slots=True)
class WorldFile:
    """All that a world file says, checked; `notes` are what people should know of it."""

    path: Path
    world: World
    rate: float
    processes: tuple[Process, ...]
    bus: BusSettings
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    notes: tuple[str, ...] = ()
    record: RecordSettings = field(default_factory=lambda: RecordSettings())
    text: str = ""


@dataclass(frozen=True, slots=True)
class Overrides:
    """What a command line says instead of the world file."""

    options: Mapping[str, str] = field(default_factory=dict[str, str])
    settings: tuple[str, ...] = ()
    views: tuple[str, ...] = ()
    name: str = ""
    seed: int | None = None
    rate: float | None = None
    frames: int | None = None
    until: str | None = None
    record: str = ""
    listen: str = ""


def read_world_file(path: Path, overrides: Overrides = Overrides()) -> WorldFile:
    """Read, complete and check a world file. Raises WorldFileError and SceneError."""
    text = _read_text(path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise WorldFileError(f"{path}: {error}") from None
    return _Loader(path, Table(data, "", text, str(path)), overrides, text).load()


def _read_text(path: Path) -> str:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise WorldFileError(f"{path}: over {MAX_BYTES} bytes, which is no world file")
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise WorldFileError(f"{path}: this is no text in UTF-8") from None
    except OSError as error:
        raise WorldFileError(f"{path}: {error.strerror}") from None


class _Loader:
    """Reads one world file, step by step."""

    def __init__(self, path: Path, top: Table, overrides: Overrides, text: str) -> None:
        self.path = path
        self.text = text
        self.folder = path.parent
        self.top = top
        self.overrides = overrides
        self.options: dict[str, Any] = {}

    def load(self) -> WorldFile:
        self._check_overrides()
        completed_by = self.top.table("world").text("defaults")
        self.options = self._options(self.top.table("options"), completed_by)
        for part in ("world", "process", "bus"):
            if part in self.top:
                self.top.data[part] = self._filled(self.top.data[part])
        processes = self._processes(self.top.table("process"))
        bus = self._bus(self.top.table("bus"))
        about = self.top.table("world")
        record = self._record(about)
        world, rate = self._world(about, processes)
        self.top.done()
        members = self._check_members(processes, world.vocabulary)
        file = WorldFile(
            self.path, world, rate, processes, bus, self.options, record=record, text=self.text
        )
        interactive = any(one.service is not None and one.service.interactive for one in members)
        return self._interactive(file) if interactive else file

    def _interactive(self, file: WorldFile) -> WorldFile:
        """People sit before it: in real time and without end, unless somebody says otherwise."""
        world, rate, notes = file.world, file.rate, list[str]()
        if self.overrides.rate is None and not rate:
            rate = 1.0 / world.dt
            notes.append(f"{rate:g} frames a second, real time (--rate changes it)")
        if self.overrides.until is None and world.until:
            notes.append(f"no end at {world.until} (--until {world.until} sets it)")
            world = replace(world, until="")
        return replace(file, world=world, rate=rate, notes=tuple(notes))

    def _check_overrides(self) -> None:
        given = self.overrides
        if given.rate is not None and not 0 <= given.rate < float("inf"):
            raise WorldFileError(f"--rate must be a number from 0, not {given.rate:g}")
        if given.frames is not None and given.frames < 0:
            raise WorldFileError(f"--frames must be a whole number from 0, not {given.frames}")
        if given.seed is not None and not -(1 << 63) <= given.seed < 1 << 63:
            raise WorldFileError("--seed must be a whole number of at most 64 bits")

    # --- options ---

    def _options(self, table: Table, completed_by: str) -> dict[str, Any]:
        options = {key: self._beside(value) for key, value in table.rest().items()}
        for key, given in self.overrides.options.items():
            if key not in options:
                raise WorldFileError(
                    f"{self.path.stem} has no option --{key}{nearest(key, list(options))}; it has"
                    f" {', '.join('--' + one for one in options) or 'none'}"
                )
            options[key] = _like(key, given, options[key])
        if completed_by:
            completed = self._called(completed_by, options)
            if not isinstance(completed, Mapping):
                raise WorldFileError(f"{self.path}: {completed_by} must return a mapping")
            options = dict(cast("Mapping[str, Any]", completed))
        return options

    def _called(self, spec: str, options: Mapping[str, Any]) -> Any:
        """What a function that the world file names returns for the options."""
        function = load(spec, self.folder)
        if not callable(function):
            raise WorldFileError(f"{self.path}: {spec} is no function")
        try:
            return function(options)
        except MinervaError:
            raise
        except Exception as error:
            raise WorldFileError(f"{self.path}: {spec} raised {error!r}") from error

    def _beside(self, value: Any) -> Any:
        """A text that names a file beside the world file stands for that file."""
        if isinstance(value, str) and value and "\n" not in value and len(value) < 1000:
            path = self.folder / value
            return str(path) if path.is_file() else value
        return value

    def _filled(self, value: Any) -> Any:
        """A value with `${option}` replaced, as what it is where it stands alone."""
        if isinstance(value, list):
            return [self._filled(item) for item in cast("list[Any]", value)]
        if isinstance(value, dict):
            return {k: self._filled(v) for k, v in cast("dict[str, Any]", value).items()}
        if not isinstance(value, str):
            return value
        alone = re.fullmatch(r"\$\{(\w+)\}", value)
        if alone:
            return self._option(alone.group(1))
        return re.sub(r"\$\{(\w+)\}", lambda match: str(self._option(match.group(1))), value)

    def _option(self, name: str) -> Any:
        if name not in self.options:
            raise WorldFileError(
                f"{self.path}: ${{{name}}} is no option{nearest(name, list(self.options))};"
                " declare it under [options]"
            )
        return self.options[name]

    # --- processes ---

    def _processes(self, table: Table) -> tuple[Process, ...]:
        settings = self._settings()
        found: list[Process] = []
        for name in list(table.data):
            found += self._process(name, table.table(name), settings.pop(name, {}))
        for view in self.overrides.views:
            spec, name, options = _view(view)
            options |= settings.pop(name, {})
            found.append(self._service(name, spec, options, "ignore", 5))
        if settings:
            name = next(iter(settings))
            known = [process.name for process in found]
            raise WorldFileError(f"--set: there is no process {name!r}{nearest(name, known)}")
        return tuple(found)

    def _settings(self) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = {}
        for setting in self.overrides.settings:
            place, equals, value = setting.partition("=")
            process, dot, key = place.partition(".")
            if not equals or not dot:
                raise WorldFileError(f"--set {setting}: expected PROCESS.KEY=VALUE")
            found.setdefault(process, {})[key] = toml_value(value)
        return found

    def _process(self, name: str, table: Table, settings: dict[str, Any]) -> list[Process]:
        table.data.update(settings)
        checked = self._checked_name(name, "a process")
        count = table.whole("processes", 1, least=1)
        policy = table.choice("on_failure", ("restart", "stop", "ignore"))
        restarts = table.whole("restarts", 5)
        agents, command = table.texts("agents"), table.texts("command")
        service = table.text("service")
        if sum(map(bool, (agents, command, service))) != 1:
            raise WorldFileError(
                f"{self.path}: [process.{name}] needs exactly one of service, agents and command"
            )
        names = [checked] if count == 1 else [f"{checked}-{i + 1}" for i in range(count)]
        if service:
            options = {key: self._beside(value) for key, value in table.rest().items()}
            return [self._service(one, service, options, policy, restarts) for one in names]
        table.done()
        if command and shutil.which(command[0], path=self._path()) is None:
            table.wrong("command", f"names {command[0]!r}, which is no program")
        classes = tuple(cls for spec in agents for cls in find_agents(spec, self.folder))
        return [
            Process(
                one,
                agents=classes,
                command=command,
                folder=self.folder,
                on_failure=policy,
                restarts=restarts,
            )
            for one in names
        ]

    def _path(self) -> str:
        return os.pathsep.join([str(self.folder), os.environ.get("PATH", os.defpath)])

    def _service(
        self, name: str, spec: str, options: dict[str, Any], policy: str, restarts: int
    ) -> Process:
        cls = find_service(spec, self.folder)
        make = bind(cls, options, f"{self.path.name}: [process.{name}]")
        return Process(name, make_service=make, on_failure=policy, restarts=restarts)

    def _record(self, table: Table) -> RecordSettings:
        plain = RecordSettings()
        own = table.text("record", plain.path)
        settings = RecordSettings(
            self.overrides.record or own,
            table.number("flush", plain.flush, 0.0),
            table.truth("durable", plain.durable),
        )
        if settings.path and not settings.path.endswith(".mcap"):
            raise WorldFileError(f"{self.path}: a record is a file .mcap, not {settings.path!r}")
        return settings

    def _bus(self, table: Table) -> BusSettings:
        plain = BusSettings()
        bus = BusSettings(
            self.overrides.listen or table.text("listen", plain.listen),
            table.number("soft", plain.soft, 0.05),
            table.number("hard", plain.hard, 0.1),
            table.truth("shared_memory", False) if "shared_memory" in table else None,
        )
        check_endpoint(bus.listen)
        if bus.soft > bus.hard:
            table.wrong("soft", f"must not be over hard, {bus.hard:g}")
        table.done()
        return bus

    # --- the world ---

    def _world(self, table: Table, processes: tuple[Process, ...]) -> tuple[World, float]:
        given = self.overrides
        table.text("defaults")
        own_name, own_rate = table.text("name", self.path.stem), table.number("rate", 0.0)
        own_seed, own_frames = table.whole("seed", 0, -(1 << 63)), table.whole("frames", 0)
        rate = own_rate if given.rate is None else given.rate
        vocabulary = self._vocabulary(table)
        world = World(
            name=self._checked_name(given.name or own_name, "a world"),
            scene=self._scene(table, vocabulary),
            vocabulary=vocabulary,
            seed=self._checked_seed(own_seed if given.seed is None else given.seed),
            dt=table.number("dt", 1.0 / own_rate if own_rate else 0.1, 1e-9),
            order=Order(self._event_types(table, "order", vocabulary)),
            policy=Policy(table.choice("policy", ("sequential", "literal"))),
            frames=own_frames if given.frames is None else given.frames,
            until=self._until(table, vocabulary, given.until),
            expected=frozenset(process.name for process in processes),
        )
        table.done()
        if not processes:
            raise WorldFileError(f"{self.path}: no [process.NAME]: nobody would run this world")
        return world, rate

    def _checked_name(self, name: str, what: str) -> str:
        try:
            return checked_name(name, what)
        except MisuseError as error:
            raise WorldFileError(f"{self.path}: {error}") from None

    def _checked_seed(self, seed: int) -> int:
        if not -(1 << 63) <= seed < 1 << 63:
            raise WorldFileError(f"{self.path}: the seed must be a whole number of 64 bits")
        return seed

    def _vocabulary(self, table: Table) -> Vocabulary:
        spec = table.text("vocabulary")
        if not spec:
            raise WorldFileError(f'{self.path}: [world] needs vocabulary = "module:attribute"')
        found = load(spec, self.folder)
        if not isinstance(found, Vocabulary):
            kind = type(found).__name__
            table.wrong("vocabulary", f"must name a Vocabulary; {spec} is of type {kind}")
        return found

    def _event_types(self, table: Table, key: str, vocabulary: Vocabulary) -> tuple[str, ...]:
        types = table.texts(key)
        for one in types:
            if one not in vocabulary.events:
                known = list(vocabulary.events)
                table.wrong(key, f"has the unknown event type {one}{nearest(one, known)}")
        return types

    def _until(self, table: Table, vocabulary: Vocabulary, given: str | None) -> str:
        types = self._event_types(table, "until", vocabulary)
        if given is not None:
            if given and given not in vocabulary.events:
                known = nearest(given, list(vocabulary.events))
                raise WorldFileError(f"--until: there is no event type {given}{known}")
            types = (given,) if given else ()
        if len(types) > 1:
            table.wrong("until", "must be one event type")
        for one in types:
            if vocabulary.events[one].visual:
                table.wrong("until", f"must be an event that agents send; {one} is visual")
        return "".join(types)

    def _check_members(
        self, processes: tuple[Process, ...], vocabulary: Vocabulary
    ) -> list[Participant]:
        """Let each member say hello to the world once, before anything is started."""
        seen: set[str] = set()
        members: list[Participant] = []
        for process in processes:
            if process.name in seen:
                raise WorldFileError(f"{self.path}: two processes are called {process.name}")
            seen.add(process.name)
            if process.name == COORDINATOR:
                raise WorldFileError(f"{self.path}: the name {COORDINATOR} is taken")
            if not process.command:
                members.append(process.participant())
                reason = objection(members[-1].hello(), vocabulary)
                if reason:
                    raise WorldFileError(f"{self.path}: [process.{process.name}]: {reason}")
        return members

    def _scene(self, table: Table, vocabulary: Vocabulary) -> Scene:
        text, maker = table.text("string"), table.text("scene")
        if bool(text) == bool(maker):
            raise WorldFileError(f"{self.path}: [world] needs exactly one of string and scene")
        if text:
            return vocabulary.read(text, f"{self.path}: world.string")
        made = self._called(maker, self.options)
        if isinstance(made, str):
            return vocabulary.read(made, maker)
        if not isinstance(made, Scene):
            kind = type(made).__name__
            raise WorldFileError(f"{self.path}: {maker} must return a string, not {kind}")
        return vocabulary.check(made, maker)


def _like(key: str, given: str, default: Any) -> Any:
    """A command line's text as a value of the same type as the world file's."""
    if isinstance(default, str):
        path = Path(given)
        return str(path.resolve()) if given and path.is_file() else given
    value = toml_value(given)
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(default):
        kind = type(default).__name__
        wanted = {"int": "a whole number", "float": "a number", "bool": "true or false"}
        shown = wanted.get(kind, f"a {kind} as in TOML")
        raise WorldFileError(f"--{key} must be {shown}, not {given!r}")
    return value


def toml_value(text: str) -> Any:
    """A value as TOML writes it; anything else is a text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return text


def _view(text: str) -> tuple[str, str, dict[str, Any]]:
    """What `svg`, `svg:every=5`, `module:Class` or `module:Class:every=5` name.

    Returns what is to be loaded, the name of the process and its options.
    """
    kind, _, rest = text.partition(":")
    first, _, others = rest.partition(":")
    if first and "=" not in first and kind not in entries(SERVICES):
        return f"{kind}:{first}", first.lower(), _pairs(others) if others else {}
    return kind, kind, _pairs(rest) if rest else {}


def _pairs(text: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for pair in text.split(","):
        key, equals, value = pair.partition("=")
        if not equals:
            raise WorldFileError(f"{pair!r}: expected KEY=VALUE")
        found[key.strip()] = toml_value(value)
    return found
