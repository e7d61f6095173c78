"""What is installed: services, agents and worlds by name, and the options of world files.

It imports little, because completing a command line must be fast.
"""

from __future__ import annotations

import importlib.util
import inspect
import json
import os
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from minerva_bus.entry_points import OWN, entries
from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.files import MAX_BYTES, ending_of, note_read, read_text, similar
from minerva_bus.settings.kinds import phrase_of
from minerva_bus.values import fast_dataclass

SERVICES, AGENTS, WORLDS = "minerva.services", "minerva.agents", "minerva.worlds"


def installed_views() -> list[str]:
    """The names of installed views; services of other packages may be views, too."""
    views = ("minerva_services.views.", "minerva_services.bridges.ros2:Ros2View")
    return sorted(
        name
        for name, entry in entries(SERVICES).items()
        if entry.value.startswith(views) or not entry.value.startswith(OWN)
    )


def is_file(path: Path) -> bool:
    """Whether a user's text is the path of a file."""
    # pathlib raises an error for a part that is too long, such as a text that is not a path.
    return os.path.isfile(path)  # noqa: PTH113


def find_world(spec: str) -> Path:
    """The world file of a path or an installed name. Raises WorldFileError."""
    path = Path(spec)
    if is_file(path):
        return path.resolve()
    known = entries(WORLDS)
    if spec in known:
        module, _, name = known[spec].value.partition(":")
        package = importlib.util.find_spec(module)
        folders = package.submodule_search_locations if package is not None else None
        for folder in folders or ():
            if (Path(folder) / name).is_file():
                return Path(folder) / name
        raise WorldFileError(f"the world {spec!r} is installed without its file {name}")
    if spec and os.path.isdir(path):  # noqa: PTH112 - as in `is_file`
        there = f"{spec.rstrip('/')}/NAME.toml"
        raise WorldFileError(f"{spec} is a folder; give the world file in it, {there}")
    if ending_of(path) in (".toml", ".mcap") or "/" in spec:
        what = "record" if ending_of(path) == ".mcap" else "world file"
        raise WorldFileError(f"there is no {what} {spec}{similar(path)}")
    there = ", ".join(sorted(known)) or "none"
    hint = nearest(spec, list(known), f"installed are {there}; or give a world file, NAME.toml")
    if spec in entries(SERVICES) or spec in entries(AGENTS):
        hint = f"; {spec} takes part in a running world: minerva attach {spec}"
    raise WorldFileError(f"there is no world {spec!r}{hint}")


def file_text(path: Path, most: int = MAX_BYTES) -> str:
    """The text of a world file or of a file with a string, of at most `most` bytes.

    No output may overwrite the file. Raises WorldFileError.
    """
    try:
        text = read_text(path, most)
    except UnicodeDecodeError:
        raise WorldFileError(f"{path}: not a text in UTF-8") from None
    except OSError as error:
        raise WorldFileError(f"{path}: {error.strerror}{similar(path)}") from None
    except ValueError as error:  # The name contains a null character.
        raise WorldFileError(f"{path}: {error}") from None
    note_read(path)
    return text


def installed_worlds() -> dict[str, str]:
    """The installed worlds with their descriptions: the first line of each file, a comment."""
    lines = {
        name: file_text(find_world(name)).partition("\n")[0] for name in sorted(entries(WORLDS))
    }
    return {
        name: line.removeprefix("#").strip() if line.startswith("#") else ""
        for name, line in lines.items()
    }


@fast_dataclass
class DeclaredOption:
    """An option of a world file: its default, the comment beside it, and its values.

    `choices` are all values that it can have, as they are typed on a command line; empty: any.
    """

    name: str
    default: Any
    comment: str = ""
    choices: tuple[str, ...] = ()

    def help_line(self) -> tuple[str, str]:
        """The option and its description, as the help of a command shows them."""
        values = "" if isinstance(self.default, bool) else "|".join(self.choices)
        return help_line(self.name, type(self.default), self.comment, self.default, values)


def declared_options(spec: str) -> list[DeclaredOption]:
    """The options of a world. It runs no code. Raises WorldFileError if there is no such world."""
    text = file_text(find_world(spec))
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return []  # The run reports the error with its place.
    comments = {match["key"]: match["comment"] for match in _COMMENTED.finditer(text)}
    choices = tables.get("choices", {})
    return [
        DeclaredOption(key, value, comments.get(key, ""), _typed(value, choices.get(key, ())))
        for key, value in tables.get("options", {}).items()
    ]


def _typed(default: Any, choices: Iterable[Any]) -> tuple[str, ...]:
    """The values of an option as they are typed on a command line: texts literally, or as TOML."""
    values = (True, False) if isinstance(default, bool) else choices
    return tuple(each if isinstance(each, str) else json.dumps(each) for each in values)


_COMMENTED: Final = re.compile(
    r"""^(?P<key>[\w-]+)\s*=\s*(?:"[^"\n]*"|[^"#\n])*#\s*(?P<comment>.*)$""", re.MULTILINE
)
"""A key, its value and a comment on one line; a text between quotes may contain `#`."""


def help_line(name: str, python: Any, text: str, default: Any, values: str = "") -> tuple[str, str]:
    """An option and its description, as the help of a command shows them.

    `values` are shown in place of the type.
    """
    kind = values or phrase_of(python).removeprefix("a ") or "toml"
    if default is inspect.Parameter.empty:
        return f"--{name} <{kind}>", f"{text}  [required]".lstrip()
    return f"--{name} <{kind}>", f"{text}  [default: {json.dumps(default, default=str)}]".lstrip()
