"""Checks of worlds and strings: `check` as a function, which `minerva check` calls."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from minerva_bus.api.world import World
from minerva_bus.errors import MinervaError, WorldFileError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene, walk
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.installed import file_text, find_world
from minerva_bus.launch.specs import load
from minerva_bus.launch.toml_tables import Table, filled, read_options
from minerva_bus.launch.world_files import WorldFile, open_tables, read_world_file
from minerva_bus.settings.kinds import TEXT, TEXTS
from minerva_bus.values import fast_dataclass, path_of
from minerva_bus.wording import counted
from minerva_bus.world.services import WorldInfo


@dataclass(frozen=True, slots=True)
class Checked:
    """Result of a check: a description, warnings, and the code that was named but not run."""

    what: str
    warnings: list[str] = field(default_factory=list[str])
    code: list[str] = field(default_factory=list[str])


def check(world: World | str | Path, *, vocabulary: str = "", code: bool = True) -> Checked:
    """Check a world, or the file of a world (.toml) or a string.

    Args:
        world: a `World`, a file, or the name of an installed world.
        vocabulary: `module:attribute`, with which the file of a string is checked.
        code: whether to run the Python code that a world file names; without it only its tables
            and its string are checked.

    Raises WorldFileError and SceneError, with line, column and caret.

    Example:
        `check("garden.toml").warnings`

    """
    if isinstance(world, World):
        return _checked(world.read())
    path = path_of("world", world)
    # Neither a file nor a name with a suffix: an installed world.
    if not path.suffix and not path.exists():
        path = find_world(str(world))
    # A program is read as a world file, whose error says how to run it.
    if path.suffix not in (".toml", ".py"):
        return Checked(_check_string(path, vocabulary))
    if code:
        # Not as a `World`, which reads the file for each question.
        return _checked(read_world_file(find_world(str(path))))
    structure = structure_of(path)
    string = "a string that code makes" if structure.string is None else _size(structure.string)
    processes = counted(len(structure.processes), "process")
    shown = f"a world with {processes} and {string}; no code was run"
    return Checked(shown, code=list(structure.code))


def _checked(file: WorldFile) -> Checked:
    warnings = [*_checked_services(file), *restless(file), *file.warnings]
    shown = f"a world with {counted(len(file.processes), 'process')} and {_size(file.world.scene)}"
    return Checked(shown, warnings)


def _checked_services(file: WorldFile) -> Iterator[str]:
    """The warnings of services that compare their options with the world. Raises WorldFileError."""
    world, tables = file.world, set[str]()
    info = WorldInfo(world.name, world.vocabulary, world.seed, world.dt)
    for process in file.processes:
        if process.make_service is None or process.table in tables - {""}:
            continue
        tables.add(process.table)
        service = process.make_service()
        try:
            yield from [f"[process.{process.name}]: {line}" for line in service.check(info) or ()]
        except MinervaError as error:
            raise WorldFileError(f"{file.path}: [process.{process.name}]: {error}") from None
        finally:
            service.close()


def _check_string(path: Path, vocabulary: str) -> str:
    text = file_text(path)
    if not vocabulary:
        return f"a string of L(M), {_size(parse(text, str(path)))}"
    alphabet = load(vocabulary, path.resolve().parent)
    if not isinstance(alphabet, Vocabulary):
        raise WorldFileError(f"{vocabulary} names a {type(alphabet).__name__}, not a Vocabulary")
    return f"a string of its vocabulary, {_size(alphabet.read(text, str(path)))}"


def _size(scene: Any) -> str:
    return counted(sum(1 for opens, _ in walk(scene) if opens), "symbol")


WORLD_CODE: Final = ("vocabulary", "scene", "defaults", "notes")
PROCESS_CODE: Final = ("service", "agents", "command")


@fast_dataclass
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
        if key in table:
            words = table.get(key, TEXTS, ())
            yield from [" ".join(words)] if key == "command" else words


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
