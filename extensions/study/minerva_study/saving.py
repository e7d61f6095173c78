"""Save the best string as a string (.mnv), or in a copy of the world file (.toml)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from minerva_bus.collect.plans import ENDINGS as TABLES
from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.files import check_ending, check_new, check_output, ending_of, write_output
from minerva_bus.grammar.scene import Scene, scene_of
from minerva_bus.grammar.text_and_digest import text
from minerva_bus.launch.toml_tables import of_nodes, toml_value
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.wording import install
from minerva_study.results import check_table

ENDINGS = (".mnv", ".toml", *TABLES)


@dataclass(frozen=True, slots=True)
class WorldOptions:
    """Options of the command line that the saved world file has to contain."""

    settings: tuple[str, ...] = ()
    options: frozenset[str] = frozenset()
    frames: int | None = None


def check_place(path: Path) -> None:
    """Raise MisuseError if the best string, or the table of all, cannot be saved to this file."""
    check_ending(path, ENDINGS, "string or table")
    if ending_of(path) in TABLES:
        check_table(path)
        # A table has no mark that distinguishes it from a user's file.
        check_new(path, "table")
        return
    check_output(path, "string")
    if not path.parent.is_dir():
        raise MisuseError(f"{path}: there is no folder {path.parent}")
    if ending_of(path) == ".toml":
        _tomlkit()


def save(scene: Scene, path: Path, file: WorldFile, given: WorldOptions) -> None:
    """Save a string. Raises MisuseError and WorldFileError."""
    lines = "\n· ".join([text(scene_of(node)) for node in scene.nodes]) or "ε"
    content = lines + "\n" if ending_of(path) == ".mnv" else _world(lines, file, given)
    write_output(path, content.encode(), "string")


def _world(lines: str, file: WorldFile, given: WorldOptions) -> str:
    """The text of the world file with another string; the rest of the text stays the same."""
    if "${" in lines:
        raise WorldFileError(
            "the string contains ${, which a world file would replace; save it as .mnv"
        )
    kit = _tomlkit()
    # Unlike tomllib, tomlkit keeps the comments and the layout of the user's file.
    document = kit.parse(file.text)
    about = document["world"]
    about.pop("scene", None)
    about["string"] = kit.string(lines, multiline=True)
    about["seed"] = file.world.seed
    if given.frames is not None:
        about["frames"] = given.frames
    for name in sorted(given.options & file.options.keys()):
        document["options"][name] = file.options[name]
    # The string has those of nodes already.
    for setting in itertools.filterfalse(of_nodes, given.settings):
        place, _, value = setting.partition("=")
        process, _, key = place.partition(".")
        document["process"][process][key] = toml_value(value)
    return str(kit.dumps(document))


def _tomlkit() -> Any:
    try:
        import tomlkit
    except ImportError:
        raise MisuseError(f"saving a world file needs tomlkit: {install('evolve')}") from None
    return tomlkit
