"""The structure of a world file, read without running its code: `check --no-code`."""

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
from minerva_bus.settings.kinds import TEXT, TEXTS

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
