"""Reading world files: each table by its own module, and what only all of them together tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.border import read_border
from minerva_bus.launch.description import read_description
from minerva_bus.launch.keeping import read_recording
from minerva_bus.launch.norms import read_norms
from minerva_bus.launch.options import filled, read_options
from minerva_bus.launch.overrides import AS_WRITTEN, Overrides
from minerva_bus.launch.patience import read_patience
from minerva_bus.launch.processes import check_members, read_processes
from minerva_bus.launch.specs import called
from minerva_bus.launch.table import Table
from minerva_bus.launch.toml import TomlError, read_toml
from minerva_bus.launch.watching import read_watching
from minerva_bus.launch.worldfile import BusSettings, WorldFile
from minerva_bus.outputs import note_read

MAX_BYTES = 16 * 1024 * 1024
TABLES = ("world", "options", "process", "bus", "limits", "placement", "norm", "metrics", "log")


def read_world_file(path: Path, overrides: Overrides = AS_WRITTEN) -> WorldFile:
    """Read, complete and check a world file. Raises WorldFileError and SceneError."""
    overrides.check()
    top, text = _tables(path)
    return _read(top, text, path, overrides)


def open_tables(path: Path) -> Table:
    """The tables of a world file, of which nothing is read yet. Raises WorldFileError."""
    return _tables(path)[0]


def _tables(path: Path) -> tuple[Table, str]:
    text = _read_text(path)
    try:
        top = Table(read_toml(text), "", text, str(path))
    except TomlError as error:
        raise WorldFileError(f"{path}: {error}") from None
    for one in TABLES:
        top.table(one)
    top.done()  # First: what is missing in [world] may stand in [wrold].
    return top, text


def _read_text(path: Path) -> str:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise WorldFileError(f"{path}: over {MAX_BYTES} bytes, which is no world file")
        note_read(path)
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise WorldFileError(f"{path}: this is no text in UTF-8") from None
    except OSError as error:
        raise WorldFileError(f"{path}: {error.strerror}") from None


def _read(top: Table, text: str, path: Path, given: Overrides) -> WorldFile:
    """Read the tables, in an order in which each finds what it needs."""
    completed_by = top.table("world").text("defaults")
    options = read_options(top.table("options"), path, given.options, completed_by)
    for part in ("world", "process", "bus", "norm"):
        if part in top:
            top.data[part] = filled(top.data[part], options, path)
    processes = read_processes(top, path, given)
    names = [process.name for process in processes]
    bus = _bus(top, path, given)
    about = top.table("world")
    record = read_recording(about, replace(given.recording, path=given.record))
    world, rate = read_description(about, top.table("placement"), path, given, options, processes)
    norms = read_norms(top.table("norm"), world.vocabulary, world.scene, names)
    world = replace(world, norms=norms)
    watch = read_watching(top, given.metrics, given.log_format)
    members = check_members(processes, world.vocabulary, path)
    file = WorldFile(
        path, world, rate, processes, bus, options, record=record, text=text, watch=watch
    )
    file = replace(file, notes=_notes(top.table("world").text("notes"), options, path))
    interactive = any(one.service is not None and one.service.interactive for one in members)
    return _interactive(file, given) if interactive else file


def _bus(top: Table, path: Path, given: Overrides) -> BusSettings:
    table, plain = top.table("bus"), BusSettings()
    own_listen, limits = table.text("listen", plain.listen), top.table("limits")
    listen = given.listen or own_listen
    bus = BusSettings(
        listen,
        read_patience(table, plain.patience),
        table.truth("shared_memory", False) if "shared_memory" in table else None,
        read_border(table, limits, listen, path.parent, given.border),
        table.text("journal", plain.journal),
    )
    if given.journal:
        bus = replace(bus, journal=given.journal)
    table.done()
    return bus


def _notes(spec: str, options: Mapping[str, Any], path: Path) -> tuple[str, ...]:
    """What people should know of a world with these options, as a function says; "": nothing."""
    notes: object = called(spec, options, path) if spec else ()
    if not isinstance(notes, list | tuple):
        raise WorldFileError(f"{path}: {spec} must return a list of texts, not {notes!r:.60}")
    return tuple([str(note) for note in cast("list[object]", notes)])


def _interactive(file: WorldFile, given: Overrides) -> WorldFile:
    """People sit before it: in real time and without end, unless somebody says otherwise."""
    world, rate, notes = file.world, file.rate, list(file.notes)
    if given.rate is None and not rate:
        rate = 1.0 / world.dt
        notes.append(f"{rate:g} frames a second, real time (--rate changes it)")
    if given.until is None and world.until:
        notes.append(f"no end at {world.until} (--until {world.until} sets it)")
        world = replace(world, until="")
    return replace(file, world=world, rate=rate, notes=tuple(notes))
