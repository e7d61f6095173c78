"""What a world file says without any of the code that it names: `minerva check --no-code`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.errors import WorldFileError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.options import filled, read_options
from minerva_bus.launch.reading import open_tables
from minerva_bus.launch.table import Table

WORLD_CODE: Final = ("vocabulary", "scene", "defaults", "notes")
PROCESS_CODE: Final = ("service", "agents", "command")


@dataclass(frozen=True, slots=True)
class Structure:
    """The processes of a world file, its string where it is written there, and what it would run.

    `code` has the module:attribute names and commands of the file, in their order.
    """

    processes: tuple[str, ...]
    string: Scene | None
    code: tuple[str, ...]


def structure_of(path: Path) -> Structure:
    """Check a world file as far as that needs no code. Raises WorldFileError and SceneError."""
    top = open_tables(path)
    world, processes = top.table("world"), top.table("process")
    tables = [processes.table(name) for name in processes.data]
    if not tables:
        raise WorldFileError(f"{path}: no [process.NAME]: nobody would run this world")
    code = [*_named(world, WORLD_CODE), *(one for t in tables for one in _named(t, PROCESS_CODE))]
    return Structure(tuple(processes.data), _string(top, path), tuple(code))


def _named(table: Table, keys: tuple[str, ...]) -> Iterator[str]:
    for key in keys:
        if key == "command":
            yield from [" ".join(table.texts(key))] if key in table else []
        elif key in table:
            yield from table.texts(key)


def _string(top: Table, path: Path) -> Scene | None:
    """The string in L(M); None where code makes it, or completes the options that are in it."""
    world = top.table("world")
    if "string" not in world or "defaults" in world:
        return None
    options = read_options(top.table("options"), path, {}, "")
    text = Table(filled(world.data, options, path), "world", "", str(path)).text("string")
    return parse(text, f"{path}: world.string")
