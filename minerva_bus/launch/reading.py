"""Reading world files: each table by its own module, then the checks that need all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError, SceneError, WorldFileError
from minerva_bus.launch.access import read_access
from minerva_bus.launch.collecting import read_collecting
from minerva_bus.launch.compiling import apply_mode
from minerva_bus.launch.description import read_description
from minerva_bus.launch.distribution import distributed
from minerva_bus.launch.installed import file_text
from minerva_bus.launch.norms import read_norms
from minerva_bus.launch.options import filled, read_options
from minerva_bus.launch.processes import check_hosts, check_members, read_patience, read_processes
from minerva_bus.launch.specs import called
from minerva_bus.launch.table import Table
from minerva_bus.launch.toml import TomlError, read_toml
from minerva_bus.launch.unplaced import unplaced, unpublished
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.settings.kinds import TEXT, TOPICS
from minerva_bus.settings.overrides import AS_WRITTEN, Overrides
from minerva_bus.settings.tables import BusSettings, RecordSettings, WatchSettings, WorldSettings

MAX_BYTES: Final = 16 << 20
"""Bytes of a world file."""

TABLES: Final = (
    *("world", "options", "choices", "process", "norm", "bus"),
    *("limits", "placement", "metrics", "log", "collect"),
)


def read_world_file(path: Path, overrides: Overrides = AS_WRITTEN) -> WorldFile:
    """Read, complete and check a world file. Raises WorldFileError and SceneError."""
    top, text = _tables(path, overrides)
    return _read(top, text, path)


def read_world_text(text: str, path: Path, overrides: Overrides = AS_WRITTEN) -> WorldFile:
    """As `read_world_file`, from the text of a file that may be on another machine."""
    return _read(_parsed(text, path, overrides), text, path)


def read_tables(
    tables: Mapping[str, Any], path: Path, overrides: Overrides = AS_WRITTEN
) -> WorldFile:
    """A world from tables that are not in a file, read as if they were at this path.

    Raises WorldFileError and SceneError.
    """
    return _read(_opened(Table(tables, "", "", path.stem, overrides)), "", path)


def open_tables(path: Path) -> Table:
    """The tables of a world file, unread. Raises WorldFileError."""
    return _tables(path)[0]


def _tables(path: Path, overrides: Overrides = AS_WRITTEN) -> tuple[Table, str]:
    text = file_text(path, MAX_BYTES)
    return _parsed(text, path, overrides), text


def _parsed(text: str, path: Path, overrides: Overrides) -> Table:
    try:
        return _opened(Table(read_toml(text), "", text, str(path), overrides))
    except TomlError as error:
        if path.suffix == ".py":
            problem = "a Python program, not a world file (.toml); to run it, write: python"
            raise WorldFileError(f"{path}: {problem} {path.name}") from None
        place = SceneError(
            f"not TOML: {error}",
            text=text,
            offset=error.offset,
            expected=error.expected,
            source=str(path),
        )
        raise WorldFileError(str(place)) from None


def _opened(top: Table) -> Table:
    for name in TABLES:
        top.table(name)
    top.done()  # First, because a key missing in [world] may be in [wrold].
    return top


def _read(top: Table, text: str, path: Path) -> WorldFile:
    """Read the tables, in the order of their dependencies."""
    overrides = top.overrides
    completed_by = top.table("world").get("defaults", TEXT, "")
    # Options come first, because the other tables may refer to them as `${name}`.
    options = read_options(top, path, overrides.options, completed_by)
    for name in ("world", "process", "bus", "norm", "collect"):
        if name in top:
            top.put(name, filled(top.data[name], options, path))
    # Before the description, which compares the agents of processes with the vocabulary.
    processes = read_processes(top, path)
    bus = top.read(BusSettings)
    waiting = read_patience(top.table("bus"))
    access = read_access(top, bus, path.parent)
    record = _record_settings(top)
    settings = top.read(WorldSettings)
    world = read_description(top, settings, path, options, processes)
    compiled = apply_mode(processes, settings.compiled, path)
    names = [process.name for process in processes]
    norms = read_norms(top.table("norm"), world.vocabulary, world.scene, names)
    watch = top.read(WatchSettings)
    collect = read_collecting(top, world.vocabulary)
    for name in ("world", "bus", "limits", "metrics", "log", "collect"):
        # Every reader has taken its keys, so the remaining ones are unknown.
        top.table(name).done()
    # The views of the command line are in no table.
    made = [p for p in processes if not (overrides.only_code and p.table and p.make_service)]
    members = check_members(made, world.vocabulary, path)
    check_hosts(processes, world.policy, path)
    file = WorldFile(
        path,
        replace(world, norms=norms),
        settings.rate,
        processes,
        bus,
        access,
        waiting,
        options,
        (*_notes(settings.notes, options, path, top.table("world")), *compiled),
        record,
        text,
        watch,
        collect,
    )
    file = distributed(file, members)
    # Without its services, the file seems to publish nothing.
    unheard = [] if overrides.only_code else unpublished(file, members)
    file = replace(file, notes=(*file.notes, *unplaced(file), *unheard))
    interactive = any(each.service is not None and each.service.interactive for each in members)
    return _interactive(file, overrides) if interactive else file


def _record_settings(top: Table) -> RecordSettings:
    """Settings of a run's record; `record` in [world] is a file or a table.

    Raises WorldFileError, and MisuseError for topics without a record.
    """
    world, defaults = top.table("world"), RecordSettings()
    nested: Any = world.data.get("record")
    if isinstance(nested, dict):
        table = world.table("record")
        defaults = RecordSettings(table.get("file", TEXT, ""), table.get("topics", TOPICS, ()))
        table.done()
        # Otherwise `record` is read as a text below.
        del world.data["record"]
    settings = top.read(RecordSettings, defaults)
    if settings.path and not settings.path.endswith(".mcap"):
        raise WorldFileError(f"a record is a file .mcap, not {settings.path!r}")
    if settings.topics and not settings.path:
        raise MisuseError("topics are recorded in a record: name one, --record FILE.mcap")
    return settings


def _notes(spec: str, options: Mapping[str, Any], path: Path, world: Table) -> tuple[str, ...]:
    """The notes that a function returns for these options; `spec` "": none."""
    notes: object = called(spec, options, path, world, "notes") if spec else ()
    if not isinstance(notes, list | tuple):
        raise WorldFileError(f"{path}: {spec} must return a list of texts, not {notes!r:.60}")
    return tuple([str(note) for note in cast("list[object]", notes)])


def _interactive(file: WorldFile, overrides: Overrides) -> WorldFile:
    """A world with a user interface: by default in real time and without end."""
    world, rate, notes = file.world, file.rate, list(file.notes)
    if "rate" not in overrides.values and not rate:
        rate = 1.0 / world.dt
        notes.append(f"{rate:g} frames per second, real time (--rate changes it)")
    if "until" not in overrides.values and world.until:
        notes.append(f"no end at {world.until} (--until {world.until} sets it)")
        world = replace(world, until="")
    return replace(file, world=world, rate=rate, notes=tuple(notes))
