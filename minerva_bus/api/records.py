"""Checks, records and replays as functions, which commands of the same names call."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from minerva_bus.api.run_result import Run
from minerva_bus.api.running import run_file
from minerva_bus.api.world import World
from minerva_bus.errors import WorldFileError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import Scene, walk
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.replaying import recomputed
from minerva_bus.launch.restless import restless
from minerva_bus.launch.resuming import WorldSource, read_resumed
from minerva_bus.launch.specs import load
from minerva_bus.launch.structure import structure_of
from minerva_bus.log.comparison import Difference, compare
from minerva_bus.log.reader import Record
from minerva_bus.settings.overrides import Overrides
from minerva_bus.wording import counted


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
        file = world.read()
        return Checked(_world_shown(len(file.processes), file.world.scene), restless(file))
    path = Path(world)
    # Neither a file nor a name with a suffix: an installed world.
    if not path.suffix and not path.exists():
        path = find_world(str(world))
    if path.suffix != ".toml":
        return Checked(_check_string(path, vocabulary))
    if code:
        return check(World.load(path))
    structure = structure_of(path)
    string = "a string that code makes" if structure.string is None else _size(structure.string)
    processes = counted(len(structure.processes), "process")
    shown = f"a world of {processes}, {string}; no code was run"
    return Checked(shown, code=list(structure.code))


def _world_shown(processes: int, scene: Scene) -> str:
    return f"a world of {counted(processes, 'process')}, {_size(scene)}"


def _check_string(path: Path, vocabulary: str) -> str:
    text = _read(path)
    if not vocabulary:
        return f"a string of L(M), {_size(parse(text, str(path)))}"
    alphabet = load(vocabulary, path.resolve().parent)
    if not isinstance(alphabet, Vocabulary):
        raise WorldFileError(f"{vocabulary} names a {type(alphabet).__name__}, not a Vocabulary")
    return f"a string of its vocabulary, {_size(alphabet.read(text, str(path)))}"


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise WorldFileError(f"{file}: not a text in UTF-8") from None
    except OSError as error:
        raise WorldFileError(f"{file}: {error.strerror}") from None


def _size(scene: Any) -> str:
    count = sum(1 for opens, _ in walk(scene) if opens)
    return counted(count, "symbol")


def diff(a: str | Path, b: str | Path) -> Difference:
    """The first frame in which two records differ, and why; `same` if none does.

    Raises RecordError.
    """
    with Record(Path(a)) as first, Record(Path(b)) as second:
        return compare(first, second)


def replay(
    record: str | Path,
    world: World | str | Path = "",
    progress: Callable[[int, int], None] | None = None,
) -> Difference:
    """Run the agents of a record again and compare each frame; `same` if all are equal.

    Args:
        record: the file, .mcap.
        world: the world with the agents' code; "": the world file that the record names.
        progress: called with the number of completed frames and the total.

    Raises RecordError, WorldFileError and MinervaError, also if the record is of another world.

    Example:
        `assert replay("run.mcap").same`

    """
    return recomputed(Path(record), _source(world), progress or (lambda done, last: None))


def record(world: World | str | Path, path: str | Path, **settings: Any) -> Run:
    """Run a world and record it in a file, .mcap; the settings are those of `run`."""
    from minerva_bus.api.running import run

    return run(world, record=path, **settings)


def resume(
    record: str | Path,
    world: World | str | Path = "",
    *,
    frames: int | None = None,
    until: str | None = None,
) -> Run:
    """Continue a recorded run after its last complete frame, in this process, deterministically.

    Args:
        record: the file, .mcap; new frames are appended.
        world: the world with the agents' code; "": the world file that the record names.
        frames: the last frame; default: as recorded.
        until: the event type that ends the world; default: as recorded; "": none.

    Raises RecordError and MinervaError, also if the run is over.

    Example:
        `resume("run.mcap", frames=600)`

    """
    overrides = Overrides(frames=frames, until=until, rate=0.0)
    return run_file(read_resumed(Path(record), _source(world), overrides), time.monotonic())


def _source(world: World | str | Path) -> WorldSource:
    return world.read if isinstance(world, World) else str(world)
