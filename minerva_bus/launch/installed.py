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
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.settings.kinds import phrase_of

SERVICES, AGENTS, WORLDS = "minerva.services", "minerva.agents", "minerva.worlds"


@cache
def entries(group: str) -> Mapping[str, EntryPoint]:
    """The installed entry points of a group, by name."""
    return {entry.name: entry for entry in entry_points(group=group)}


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
    if path.suffix == ".toml" or "/" in spec:
        raise WorldFileError(f"there is no world file {spec}")
    raise WorldFileError(
        f"there is no world {spec!r}{nearest(spec, list(known))}; installed are"
        f" {', '.join(sorted(known)) or 'none'}; or give a world file, NAME.toml"
    )


def installed_worlds() -> dict[str, str]:
    """The installed worlds with their descriptions: the first line of each file, a comment."""
    lines = {
        name: find_world(name).read_text(encoding="utf-8").partition("\n")[0]
        for name in sorted(entries(WORLDS))
    }
    return {
        name: line.removeprefix("#").strip() if line.startswith("#") else ""
        for name, line in lines.items()
    }


def described(spec: str) -> list[tuple[str, str]]:
    """The options of a world, each with its comment and default, for the command line's help.

    It runs no code. Raises WorldFileError if there is no such world.
    """
    text = find_world(spec).read_text(encoding="utf-8")
    try:
        options = tomllib.loads(text).get("options", {})
    except tomllib.TOMLDecodeError:
        return []  # The run reports the error with its place.
    comments = {match["key"]: match["comment"] for match in _COMMENTED.finditer(text)}
    return [
        help_line(key, type(value), comments.get(key, ""), value) for key, value in options.items()
    ]


_COMMENTED: Final = re.compile(
    r"""^(?P<key>[\w-]+)\s*=\s*(?:"[^"\n]*"|[^"#\n])*#\s*(?P<comment>.*)$""", re.MULTILINE
)
"""A key, its value and a comment on one line; a text between quotes may contain `#`."""


def help_line(name: str, python: Any, text: str, default: Any) -> tuple[str, str]:
    """An option and its description, as the help of a command shows them."""
    kind = python.__name__ if phrase_of(python) else "toml"
    if default is inspect.Parameter.empty:
        return f"--{name} <{kind}>", f"{text}  [required]".lstrip()
    return f"--{name} <{kind}>", f"{text}  [default: {json.dumps(default, default=str)}]".lstrip()
