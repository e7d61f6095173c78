"""What `minerva check` needs of a world file: its structure, read without code, and warnings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.errors import WorldFileError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.toml_tables import Table
from minerva_bus.launch.typed_text import filled, read_options
from minerva_bus.launch.world_files import WorldFile, open_tables
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
