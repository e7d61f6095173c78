"""A world's own options: the table [options], `--name value` instead of it, and `${name}`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.launch.overrides import toml_value
from minerva_bus.launch.specs import called
from minerva_bus.launch.table import Table


def read_options(
    table: Table, path: Path, given: Mapping[str, str], completed_by: str
) -> dict[str, Any]:
    """The options of a world file, with what a command line says instead of some.

    `completed_by` names a function that completes them ("": none). Raises WorldFileError.
    """
    options = {key: beside(value, path.parent) for key, value in table.rest().items()}
    for key, text in given.items():
        if key not in options:
            raise WorldFileError(
                f"{path.stem} has no option --{key}{nearest(key, list(options))}; it has"
                f" {', '.join('--' + one for one in options) or 'none'}"
            )
        options[key] = _like(key, text, options[key])
    if completed_by:
        completed = called(completed_by, options, path)
        if not isinstance(completed, Mapping):
            raise WorldFileError(f"{path}: {completed_by} must return a mapping")
        options = dict(cast("Mapping[str, Any]", completed))
    return options


def beside(value: Any, folder: Path) -> Any:
    """A text that names a file in the world file's folder stands for that file."""
    if isinstance(value, str) and value and "\n" not in value and len(value) < 1000:
        path = folder / value
        return str(path) if path.is_file() else value
    return value


def _like(key: str, given: str, default: Any) -> Any:
    """A command line's text as a value of the same type as the world file's."""
    if isinstance(default, str):
        path = Path(given)
        return str(path.resolve()) if given and path.is_file() else given
    value = toml_value(given)
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(default):
        kind = type(default).__name__
        wanted = {"int": "a whole number", "float": "a number", "bool": "true or false"}
        shown = wanted.get(kind, f"a {kind} as in TOML")
        raise WorldFileError(f"--{key} must be {shown}, not {given!r}")
    return value


def filled(value: Any, options: Mapping[str, Any], path: Path) -> Any:
    """A value with `${option}` replaced, as what it is where it stands alone.

    Raises WorldFileError where there is no such option.
    """
    if isinstance(value, list):
        return [filled(item, options, path) for item in cast("list[Any]", value)]
    if isinstance(value, dict):
        items = cast("dict[str, Any]", value).items()
        return {key: filled(item, options, path) for key, item in items}
    if not isinstance(value, str):
        return value
    alone = re.fullmatch(r"\$\{(\w+)\}", value)
    if alone:
        return _option(alone.group(1), options, path)
    return re.sub(r"\$\{(\w+)\}", lambda found: str(_option(found.group(1), options, path)), value)


def _option(name: str, options: Mapping[str, Any], path: Path) -> Any:
    if name not in options:
        raise WorldFileError(
            f"{path}: ${{{name}}} is no option{nearest(name, list(options))};"
            " declare it under [options]"
        )
    return options[name]
