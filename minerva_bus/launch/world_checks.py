"""What `minerva check` needs of a world file: its structure, warnings about norms, and layouts.

The structure is read without running code (`--no-code`). In all layouts of processes a world must
have the same strings, frame by frame (`--determinism`): an agent evolves by its state, its events
and its stream of random numbers (equation 3) only, so the result must not depend on the process,
the hash seed or the time zone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from minerva_bus.errors import WorldFileError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.toml_tables import Table
from minerva_bus.launch.typed_text import filled, read_options
from minerva_bus.launch.world_files import Access, WorldFile, open_tables
from minerva_bus.settings.kinds import TEXT, TEXTS
from minerva_bus.settings.world_settings import BusSettings, RecordSettings, WatchSettings
from minerva_bus.world.services import Generator, when_of

WORLD_CODE: Final = ("vocabulary", "scene", "defaults", "notes")
PROCESS_CODE: Final = ("service", "agents", "command")


@dataclass(frozen=True, slots=True)
class Structure:
    """The processes of a world file, its string if it has one, and the code that it names.

    `code` lists the module:attribute names and commands of the file, in their order.
    """

    processes: tuple[str, ...]
    string: Scene | None
    code: tuple[str, ...]


def structure_of(path: Path) -> Structure:
    """Check the parts of a world file that need no code. Raises WorldFileError and SceneError."""
    top = open_tables(path)
    world, processes = top.table("world"), top.table("process")
    tables = [processes.table(name) for name in processes.data]
    if not tables:
        raise WorldFileError(f"{path}: no [process.NAME]: no process would run this world")
    code = [*_named(world, WORLD_CODE)]
    for table in tables:
        code += _named(table, PROCESS_CODE)
    return Structure(tuple(processes.data), _string(top, path), tuple(code))


def _named(table: Table, keys: tuple[str, ...]) -> Iterator[str]:
    for key in keys:
        if key == "command":
            yield from [" ".join(table.get(key, TEXTS, ()))] if key in table else []
        elif key in table:
            yield from table.get(key, TEXTS, ())


def _string(top: Table, path: Path) -> Scene | None:
    """The string in L(M); None if code makes it, or completes its options."""
    world = top.table("world")
    if "string" not in world or "defaults" in world:
        return None
    options = read_options(top, path, {}, "")
    text = Table(filled(world.data, options, path), "world", "", str(path)).get("string", TEXT, "")
    return parse(text, f"{path}: world.string")


def restless(file: WorldFile) -> list[str]:
    """A warning for each norm and kind whose rejected agents would repeat the same step.

    A coupled device executes the actions that agents show. An agent with a rejected step keeps its
    action, unless its kind declares the attributes of an agent at rest (docs/norms.md).
    """
    refusing = [norm for norm in file.world.norms if norm.refuses and not norm.on]
    kinds = file.world.vocabulary.kinds.values()
    restless = [kind for kind in kinds if kind.subscribes and not kind.rest]
    if not refusing or not restless:
        return []
    shown = list(_shown(file))
    return [
        f"norm.{norm.name} rejects steps of {kind.name}, which {device} executes: without `rest`"
        " the agent retries the rejected action in each frame; declare its action, such as"
        f' class X(Agent, symbol="{kind.name}", rest=("action",))'
        for norm in refusing
        for kind in restless
        for device in [name for name, types in shown if types & kind.views][:1]
        if norm.concerns(kind.name)
    ]


def _shown(file: WorldFile) -> Iterator[tuple[str, frozenset[str]]]:
    """The coupled devices, with the visual event types that they draw."""
    for process in file.processes:
        if process.make_service is not None:
            hello = process.make_member().hello()
            if hello.coupled:
                yield process.name, frozenset(hello.draws)


@dataclass(frozen=True, slots=True)
class Layout:
    """A layout of processes for one run of a world.

    `hosts`: number of processes for each process of agents. `in_process`: all members in one
    process, unless one of them is a command.
    """

    name: str
    in_process: bool
    hosts: int
    hash_seed: str
    time_zone: str

    @property
    def environment(self) -> dict[str, str]:
        """The environment variables of its processes."""
        return {"PYTHONHASHSEED": self.hash_seed, "TZ": self.time_zone}

    def runs_in_process(self, file: WorldFile) -> bool:
        """Whether a world file runs in one process here."""
        return self.in_process and not any(process.command for process in file.processes)


LAYOUTS: Final = (
    Layout("one process for all members", True, 1, "5", "MNVA+12"),
    Layout("two processes for each kind of agents", False, 2, "36", "MNVB-14"),
)
"""Chosen to reveal mistakes: local dates always differ between the two layouts. Sets of two to
four short texts such as {"a", "b"} have different orders with these seeds, unlike with many others.
"""


def left_out(file: WorldFile) -> dict[str, str]:
    """Processes that cannot be compared, by name, with the reason."""
    reasons = {process.name: _reason(process) for process in file.processes}
    return {name: reason for name, reason in reasons.items() if reason}


def _reason(process: ProcessSpec) -> str:
    if process.make_service is None:
        return ""
    service = process.make_service()
    if service.interactive or (isinstance(service, Generator) and service.people):
        return "people operate it"
    when = when_of(service)
    if isinstance(service, Generator) and not when.is_awaited:
        return "it runs freely"
    if when.rate > 0:
        return "it requests views by the clock"
    return "" if isinstance(service, Generator) else "it only shows views"


def laid_out(
    file: WorldFile, layout: Layout, omitted: Mapping[str, str], frames: int, record: Path
) -> WorldFile:
    """A world file for a run of `frames` in a layout: recorded, and closed to other members."""
    processes = tuple(
        replace(process, name=name, elsewhere=False)
        for process in file.processes
        if process.name not in omitted
        for name in _names(process, layout.hosts)
    )
    return replace(
        file,
        world=replace(
            file.world,
            frames=min(frames, file.world.frames or frames),
            expected=frozenset(process.name for process in processes),
        ),
        rate=0.0,
        processes=processes,
        bus=BusSettings(shared_memory=file.bus.shared_memory),
        access=Access(),
        record=RecordSettings(str(record)),
        watch=WatchSettings(),
    )


def _names(process: ProcessSpec, hosts: int) -> list[str]:
    several = [f"{process.name}-of-{hosts}-{number}" for number in range(2, hosts + 1)]
    return [process.name, *several] if process.agents else [process.name]
