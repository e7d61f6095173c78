"""The processes of a world: the tables [process.NAME], and the views of the command line.

Where cores are few, services share a process of the operating system. Methods of agents that
`[world] compiled` names are compiled before processes start, which inherit the machine code.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import field, replace
from itertools import chain, count
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import MisuseError, WorldFileError, nearest
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.member_table import incompatibility
from minerva_bus.frame.messages import Hello
from minerva_bus.grammar.columns import MANY
from minerva_bus.grammar.scene import Scene, kind_counts
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.specs import Factory, divisible_names, find_agent, find_service, find_view
from minerva_bus.launch.toml_tables import Table, beside, extended, read_view, settings_by_process
from minerva_bus.runtime.timeouts import Patience
from minerva_bus.settings.kinds import AUTO, settings_of
from minerva_bus.settings.world_settings import PatienceSettings, ProcessSettings
from minerva_bus.user_code import changes
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.keys import COORDINATOR, checked_name
from minerva_bus.wording import counted, named_some
from minerva_bus.world.agent import Agent
from minerva_bus.world.class_declaration import IF_POSSIBLE, Mode, NotCompilable, compile_all
from minerva_bus.world.evolution import Policy
from minerva_bus.world.services import Participation, Service

PEOPLE: Final = "people"
"""In `applies`: the people who send events from a terminal or a window; `people:NAME` is one."""

_RESERVED: Final = {
    COORDINATOR: "it is that of the process that runs the frames; choose another name",
    PEOPLE: "norms and logs call those who send events by it; choose another name",
}
"""Names that no process may have, and why."""

SERVICES: Final = "services"
"""Name of the process that services share."""


@fast_dataclass
class ProcessSpec:
    """A process that a world needs, and the policy for its failure: restart, stop or ignore.

    `elsewhere`: the world waits for it, but it is started on another machine, by hand or by a
    service manager: `minerva attach WORLD --process NAME`. `speaks_for`: kinds and `#id`s of agents
    in whose name a generator may send events. `table`: the name of its table in the
    world file, empty for a view of the command line. `automatic`: it stands for as many processes
    as `distributed` chooses. `shared`: it shares a process of the operating system with others.
    `dividing`: the processes that divide the agents of its generator, itself among them.
    """

    name: str
    make_service: Factory | None = None
    agents: tuple[type[Agent], ...] = ()
    command: tuple[str, ...] = ()
    folder: Path = field(default_factory=Path)
    on_failure: str = "restart"
    restarts: int = 5
    elsewhere: bool = False
    table: str = ""
    speaks_for: tuple[str, ...] = ()
    patience: Patience | None = None
    automatic: bool = False
    shared: bool = False
    dividing: tuple[str, ...] = ()

    def make_member(self) -> Member:
        """The member that this process runs."""
        service = self.make_service() if self.make_service is not None else None
        member = Member(self.name, service, self.agents)
        if self.dividing[1:]:
            member.divide(self.table, self.dividing)
        return member


def read_processes(top: Table, path: Path) -> tuple[ProcessSpec, ...]:
    """The processes of a world file, in its order, followed by the views of the command line.

    Raises WorldFileError.
    """
    reader = _ProcessReader(top, path)
    table, settings = top.table("process"), settings_by_process(top.overrides.settings)
    processes: list[ProcessSpec] = []
    for name in list(table.data):
        processes += reader.processes(name, table.table(name), settings.pop(name, {}))
    for view in top.overrides.views:
        spec, kind, options = read_view(view)
        name = _free_name(kind, {process.name for process in processes})
        cls = find_view(spec, path.parent)
        options = extended({}, options | settings.pop(name, {}))
        given = Table(options, f"process.{name}", "", f"--view {view}")
        patience = reader.patience(given)
        make = reader.maker(name, cls, given.rest())
        processes.append(ProcessSpec(name, make, on_failure="ignore", patience=patience))
    if settings:
        name = next(iter(settings))
        known = list(dict.fromkeys(process.table or process.name for process in processes))
        raise WorldFileError(f"--set: there is no process {name!r}{nearest(name, known)}")
    return tuple(processes)


def _free_name(kind: str, taken: Collection[str]) -> str:
    """The kind of a view, or KIND-2, KIND-3 ... for further ones."""
    names = (f"{kind}-{number}" for number in count(2))
    return next(name for name in chain((kind,), names) if name not in taken)


@fast_dataclass
class _ProcessReader:
    """Reads single tables [process.NAME]."""

    top: Table
    path: Path

    def processes(self, name: str, table: Table, settings: dict[str, Any]) -> list[ProcessSpec]:
        """The processes of one table, with the `settings` of the command line."""
        # Settings of the command line are checked like those of the file.
        table.data.update(extended(table.data, settings))
        checked = table.named(name, "a process")
        own = table.read(ProcessSettings)
        plain = ProcessSpec(
            checked,
            table=name,
            on_failure=own.on_failure,
            restarts=own.restarts,
            elsewhere=own.elsewhere,
            speaks_for=own.speaks_for,
            patience=self.patience(table),
        )
        if sum(map(bool, (own.agents, own.command, own.service))) != 1:
            raise WorldFileError(
                f"{self.path}: [process.{name}] needs exactly one of service, agents and command"
            )
        if own.agents and own.speaks_for:
            table.wrong("speaks_for", "is for generators: agents speak for themselves")
        folder, names = self.path.parent, self._names(checked, table, own)
        if own.service:
            options = {key: beside(value, folder) for key, value in table.rest().items()}
            with table.loading("service"):
                cls = find_service(own.service, folder)
            make = self.maker(name, cls, options, table)
            dividing = tuple(names) if getattr(cls, "by_agent", False) else ()
            if names[1:] and not dividing:
                problem = f"is {len(names)}, but {cls.__name__} has one process for all agents"
                table.wrong("processes", f"{problem}; several are possible for {divisible_names()}")
            plain = replace(plain, make_service=make, dividing=dividing)
            return [replace(plain, name=each) for each in names]
        # Only services have further keys, the arguments of their constructors.
        table.done()
        # The command runs in the world file's folder, which PATH does not contain.
        if own.command:
            program = own.command[0]
            path = str(folder / program) if os.sep in program else program
            if shutil.which(path) is None:
                words = program.split()
                hint = f"; write its words as a list: {json.dumps(words)}" if words[1:] else ""
                table.wrong("command", f"names {program!r}, which is not an executable file{hint}")
        with table.loading("agents"):
            classes = tuple(find_agent(spec, folder) for spec in own.agents)
        automatic = own.processes == AUTO and not own.elsewhere
        plain = replace(
            plain, agents=classes, command=own.command, folder=folder, automatic=automatic
        )
        return [replace(plain, name=each) for each in names]

    def _names(self, name: str, table: Table, own: ProcessSettings) -> list[str]:
        """The names of the processes of a table; one name if their number is automatic."""
        count = own.processes
        if not own.agents:
            # The option of the command line is for agents: two clocks would be another world.
            declared = settings_of(ProcessSettings)["processes"]
            count = table.get(declared.key, declared.kind, declared.default)
            if count == AUTO:
                table.wrong("processes", '"auto" is for agents; expected a whole number')
        return names_of(name, max(count, 1))

    def maker(
        self, name: str, cls: type[Service], options: dict[str, Any], table: Table | None = None
    ) -> Factory:
        """The factory of a process's service; `table` is that of its options, if any."""
        file, process = self.path.name, f"[process.{name}]"
        lines = {} if table is None else {key: table.line(key) for key in options}
        places = {key: f"{file}{line}: {process}" for key, line in lines.items()}
        return Factory(cls, options, f"{file}: {process}", places)

    def patience(self, table: Table) -> Patience | None:
        """Time-outs of frames for a process; None: those for all members."""
        if not any(key in table for key in settings_of(PatienceSettings)):
            return None
        bus = self.top.table("bus").read(PatienceSettings)
        return read_patience(table, bus)


def read_patience(table: Table, defaults: PatienceSettings | None = None) -> Patience:
    """Time-outs of frames for members, in [bus] or for one process. Raises WorldFileError."""
    settings = table.read(PatienceSettings, defaults)
    if settings.soft > settings.hard:
        table.wrong("soft", f"must be at most hard, {settings.hard:g}")
    return Patience(settings.soft, settings.hard, settings.late)


def check_members(
    processes: Iterable[ProcessSpec], vocabulary: Vocabulary, path: Path
) -> list[Member]:
    """Check the hello of each member before any process starts.

    The processes of one table differ only in their names, so only the first one is checked.
    Raises WorldFileError.
    """
    seen: set[str] = set()
    tables: set[str] = set()
    members: list[Member] = []
    for process in processes:
        if process.name in seen:
            raise WorldFileError(f"{path}: two processes are named {process.name}")
        seen.add(process.name)
        if process.name in _RESERVED:
            raise WorldFileError(
                f"{path}: the process name {process.name} is reserved: {_RESERVED[process.name]}"
            )
        # The capabilities of a command are known only from its hello.
        first = process.table not in tables
        tables.update({process.table} - {""})
        if not process.command and first:
            members.append(process.make_member())
            hello = members[-1].hello()
            reason = incompatibility(hello, vocabulary) or _invalid_topic(hello)
            if process.dividing[1:] and hello.when.asked is not Participation.IN_STEP:
                reason = f'several processes divide a generator "in step", not "{hello.when}"'
            if reason:
                raise WorldFileError(f"{path}: [process.{process.name}]: {reason}")
    _check_written(members, path)
    return members


def _check_written(members: Iterable[Member], path: Path) -> None:
    """Raise WorldFileError if two services write one file."""
    writers: dict[str, str] = {}
    for member in members:
        for file in () if member.service is None else member.service.writes:
            other = writers.setdefault(os.path.realpath(file), member.name)
            if other != member.name:
                raise WorldFileError(
                    f"{path}: [process.{member.name}]: writes {file}, and so does {other};"
                    f" choose another file, for example {file.with_stem(f'{file.stem}-2')}"
                )


def check_hosts(processes: Iterable[ProcessSpec], policy: Policy, path: Path) -> None:
    """Raise WorldFileError for several hosts of agents under a policy that makes copies."""
    hosts = [process for process in processes if process.agents]
    if not policy.rules.makes_copies or len(hosts) < 2:
        return
    text = f'{path}: policy = "{policy.value}" evolves all agents on one host, but'
    tables = list(dict.fromkeys(process.table for process in hosts))
    if len(tables) == 1:
        raise WorldFileError(
            f"{text} [process.{tables[0]}] has {len(hosts)} processes; use processes = 1"
        )
    named = " and ".join(f"[process.{name}]" for name in tables)
    raise WorldFileError(f"{text} {named} have agents; name all classes in the agents of one table")


def _invalid_topic(hello: Hello) -> str:
    """Why a sensor topic cannot be part of a key of the bus, or an empty string."""
    try:
        for topic in (*hello.topics, *hello.publishes):
            checked_name(topic, "a topic")
    except MisuseError as error:
        return str(error)
    return ""


def forgotten(processes: Iterable[ProcessSpec]) -> Iterator[str]:
    """A warning for each generator in step that changes its attributes and does not save them."""
    for process in processes:
        cls = process.make_service and process.make_service.cls
        if cls and cls.save is Service.save and (names := changes(cls, "generate")):
            lost = f"changes {named_some(names, 5)} and has no `save`; it begins again"
            yield f"{cls.__name__} of [process.{process.name}] {lost} (docs/howto/resume.md)"


def names_of(name: str, count: int) -> list[str]:
    """The names of the processes of a table."""
    return [name] if count == 1 else [f"{name}-{number + 1}" for number in range(count)]


DEFAULT: Final = ProcessSpec("")


def by_process(processes: Iterable[ProcessSpec]) -> dict[str, tuple[ProcessSpec, ...]]:
    """The processes that run here, by name of the process of the operating system."""
    members: dict[str, list[ProcessSpec]] = {}
    for process in processes:
        if not process.elsewhere:
            members.setdefault(SERVICES if process.shared else process.name, []).append(process)
    return {name: tuple(each) for name, each in members.items()}


def sharing(
    processes: Sequence[ProcessSpec], members: Iterable[Member], cores: int
) -> tuple[ProcessSpec, ...]:
    """The processes; services share one if all of them and the coordinator exceed the cores.

    `members` are those of the first process of each table.
    """
    hellos = {member.name: member.hello() for member in members if member.service is not None}
    tables = {
        process.table: hellos[process.name] for process in processes if process.name in hellos
    }
    alike = [
        process
        for process in processes
        if process.table in tables
        and not process.elsewhere
        and not process.dividing[1:]
        # They are restarted together.
        and (process.on_failure, process.restarts) == (DEFAULT.on_failure, DEFAULT.restarts)
        # Frames wait for it, or nobody does.
        and (tables[process.table].coupled or not tables[process.table].draws)
    ]
    enough = len(by_process(processes)) < cores
    if enough or len(alike) < 2 or SERVICES in {process.name for process in processes}:
        return tuple(processes)
    return tuple(
        replace(process, shared=True) if process in alike else process for process in processes
    )


def apply_mode(processes: Sequence[ProcessSpec], mode: Mode, scene: Scene, path: Path) -> list[str]:
    """Mark methods of all agent classes as `[world] compiled` asks; returns lines.

    With "if possible", only those of classes with enough agents in the scene to be columns. Raises
    WorldFileError if one cannot be compiled and `mode` is True.
    """
    notes: list[str] = []
    classes, counts = _classes(processes), kind_counts(*scene.pieces)
    for cls in classes:
        enough = mode != IF_POSSIBLE or counts[cls.kind.name] >= MANY
        try:
            reasons = [*map(_first, compile_all(cls, mode if enough else False))]
        except NotCompilable as error:
            raise WorldFileError(
                f'{path}: [world] compiled = true: {error}\n  or: compiled = "{IF_POSSIBLE}"'
            ) from None
        reasons += [] if enough else [f"{cls.__name__}, fewer than {MANY} agents"]
        notes += [f"not compiled: {each}" for each in dict.fromkeys(reasons)]
    if mode == IF_POSSIBLE:
        made = [cls.accelerator for cls in classes if cls.accelerator is not None]
        methods = counted(sum(len(each.methods) for each in made), "method")
        notes.insert(0, f"compiled {methods} of agents")
    return notes


def compile_agents(
    processes: Iterable[ProcessSpec], progress: Callable[..., None] = lambda *_: None
) -> None:
    """Compile the methods of the agents that run on this machine, and the rules of their spaces.

    Before the launcher starts processes, so that they inherit the machine code; `progress` is
    passed a word, the number compiled, that of all, and a title. Raises MisuseError without numba,
    or if a rule cannot be compiled.
    """
    classes = _classes([process for process in processes if not process.elsewhere])
    code = [each for cls in classes for each in cls.machine_code()]
    for done, (title, compiled) in enumerate(code):
        progress("compiling", done, len(code), title)
        compiled()


def _classes(processes: Iterable[ProcessSpec]) -> list[type[Agent]]:
    """The agent classes of processes, each once."""
    return list(dict.fromkeys(cls for process in processes for cls in process.agents))


def _first(reason: str) -> str:
    """The problem of a method and its place, on one line."""
    problem, *place = reason.split("\n")
    return f"{problem} ({place[0].strip()})" if place else problem
