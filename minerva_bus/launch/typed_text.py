"""Texts as typed values: options of a world and of its services, PROCESS.KEY=VALUE, views.

The options of a world are its table [options], `--name value` on a command line, and `${name}` in
other tables.
"""

from __future__ import annotations

import inspect
import json
import re
import traceback
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast, get_type_hints

from minerva_bus.entry_points import entries
from minerva_bus.errors import MinervaError, MisuseError, UnknownOption, WorldFileError, nearest
from minerva_bus.grammar.assignment import names_nodes
from minerva_bus.launch.installed import SERVICES, is_file
from minerva_bus.launch.specs import load
from minerva_bus.launch.toml_tables import Table, TomlError, read_toml, toml_value_text
from minerva_bus.settings.kinds import fits, phrase_of
from minerva_bus.settings.overrides import plain_value
from minerva_bus.user_code import place_of, report
from minerva_bus.world.services import Service


def toml_value(text: str) -> Any:
    """The value of a text in TOML; any other text is returned unchanged."""
    try:
        return read_toml(f"value = {text}")["value"]
    except (TomlError, KeyError):
        return text


def typed_options(cls: type[Service], options: Mapping[str, str]) -> dict[str, Any]:
    """The options of a service, typed; `0` stays a text if the service declares a text."""
    hints = get_type_hints(cls.__init__)
    values = {key: toml_value(text) for key, text in options.items()}
    return {
        key: options[key] if hints.get(key) is str and not isinstance(value, str) else value
        for key, value in values.items()
    }


def settings_by_process(settings: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Settings PROCESS.KEY=VALUE, by process and key. Raises WorldFileError.

    Settings of nodes, such as `AEgg.speed=0.3`, are left out.
    """
    values: dict[str, dict[str, Any]] = {}
    for setting in settings:
        if of_nodes(setting):
            continue
        place, equals, value = setting.partition("=")
        process, dot, key = place.partition(".")
        if not equals or not dot:
            raise WorldFileError(f"--set {setting}: expected PROCESS.KEY=VALUE")
        values.setdefault(process, {})[key] = toml_value(value)
    return values


def of_nodes(setting: str) -> bool:
    """Whether a setting KEY=VALUE sets a parameter of the world's string."""
    return names_nodes(setting.partition("=")[0])


def read_view(text: str) -> tuple[str, str, dict[str, Any]]:
    """Parse `svg`, `svg:every=5`, `module:Class` or `module:Class:every=5`.

    Returns the name of the service, the name of its process and its options. Raises WorldFileError.
    """
    kind, _, rest = text.partition(":")
    first, _, others = rest.partition(":")
    if first and "=" not in first and kind not in entries(SERVICES):
        return f"{kind}:{first}", first.lower(), _pairs(others) if others else {}
    return kind, kind, _pairs(rest) if rest else {}


def _pairs(text: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for pair in text.split(","):
        key, equals, value = pair.partition("=")
        if not equals:
            raise WorldFileError(f"{pair!r}: expected KEY=VALUE")
        values[key.strip()] = toml_value(value)
    return values


def read_options(
    top: Table, path: Path, given: Mapping[str, str], completed_by: str
) -> dict[str, Any]:
    """The options of a world file, replaced by those of the command line.

    `completed_by` names a function that completes them ("": none). Raises WorldFileError.
    """
    written = top.table("options").rest()
    for key in written:
        # Otherwise the command line could not name it: `--some-rate` is `some_rate`.
        if not key.isidentifier():
            expected = "letters, digits and _, beginning with a letter, as in step_size"
            raise WorldFileError(f"{path}: {key[:80]!r} cannot name an option: use {expected}")
    options = {key: beside(value, path.parent) for key, value in written.items()}
    choices = _read_choices(top.table("choices"), options, path.parent)
    for key, text in given.items():
        if key not in options:
            raise UnknownOption(path.stem, f"--{key}", [f"--{name}" for name in options])
        if key in choices:
            options[key] = beside(_chosen(key, text, choices[key]), path.parent)
        else:
            options[key] = _like(key, text, options[key])
    # Last, so that the function derives its results from the values of the command line.
    if completed_by:
        completed = called(completed_by, options, path, top.table("world"), "defaults")
        if not isinstance(completed, Mapping):
            raise WorldFileError(f"{path}: {completed_by} must return a mapping")
        options = dict(cast("Mapping[str, Any]", completed))
    return options


def _read_choices(table: Table, options: Mapping[str, Any], folder: Path) -> dict[str, list[Any]]:
    """The table [choices]: all values of an option, by its name. Raises WorldFileError."""
    choices = table.rest()
    for key, values in choices.items():
        if key not in options:
            known = nearest(key, list(options))
            table.wrong(key, f"is not an option{known}; declare it under [options]")
        known = cast("list[Any]", values) if isinstance(values, list) else []
        # A default is a full path already if it names a file.
        if options[key] not in [beside(value, folder) for value in known]:
            default = json.dumps(options[key], default=str)
            table.wrong(key, f"must be a list of values, one of them the default, {default}")
    return choices


def _chosen(key: str, given: str, choices: list[Any]) -> Any:
    """The value of a text on the command line among the choices. Raises WorldFileError."""
    value = given if isinstance(choices[0], str) else toml_value(given)
    if value in choices:
        return choices[choices.index(value)]
    shown = [str(each) for each in choices]
    raise WorldFileError(
        f"--{key} must be {' or '.join(shown)}, not {given!r}{nearest(given, shown)}"
    )


def beside(value: Any, folder: Path) -> Any:
    """The full path of a text that names a file in `folder`; any other value unchanged."""
    # Other texts, such as a string of the grammar, are not paths, and may be too long for one.
    if isinstance(value, str) and value and "\n" not in value and len(value) < 1000:
        path = folder / value
        return str(path) if is_file(path) else value
    return value


def _like(key: str, given: str, default: Any) -> Any:
    """The value of a text on the command line, of the same type as its default."""
    if isinstance(default, str):
        # Relative to the current folder, as for any command; a default is relative to the world
        # file.
        path = Path(given)
        return str(path.resolve()) if given and is_file(path) else given
    value = toml_value(given)
    python = cast("type[Any]", type(default))
    if not (fits(value, python) if phrase_of(python) else isinstance(value, python)):
        phrase = phrase_of(python) or f"a {python.__name__} as in TOML"
        raise WorldFileError(f"--{key} must be {phrase}, not {given!r}")
    return float(value) if python is float else value


def called(spec: str, options: Mapping[str, Any], path: Path, table: Table, key: str) -> Any:
    """Call the function that a key of a world file names, `module:function`, with its options.

    Raises WorldFileError, and any MinervaError that the function itself raises.
    """
    with table.loading(key):
        function = load(spec, path.parent)
    # An instance of a class is none of the values that these functions return.
    if not callable(function) or inspect.isclass(function):
        raise WorldFileError(f"{path}: {spec} is not a function")
    try:
        return function(options)
    except MinervaError as error:
        if not _misused(error):
            raise
        raise WorldFileError(f"{path}: {spec}: {report(error)}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise WorldFileError(f"{path}: {spec}: {report(error)}") from error


def _misused(error: MinervaError) -> bool:
    """Whether a function of the framework raised this, because code of a world misused it."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    place = place_of(error)
    return (
        isinstance(error, MisuseError)
        and place is not None
        and frame.f_code.co_filename != place.file
    )


def filled(value: Any, options: Mapping[str, Any], path: Path) -> Any:
    """A value with `${option}` replaced; an option without other text keeps its type.

    Raises WorldFileError for an unknown option.
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
    return re.sub(r"\$\{(\w+)\}", lambda match: str(_option(match.group(1), options, path)), value)


def _option(name: str, options: Mapping[str, Any], path: Path) -> Any:
    if name not in options:
        hint = nearest(name, list(options), "declare it under [options]")
        raise WorldFileError(f"{path}: ${{{name}}} is not an option{hint}")
    return options[name]


def option_text(value: Any) -> str:
    """An option as on a command line: a text is unchanged, any other value is in TOML."""
    return value if isinstance(value, str) else toml_value_text(plain_value(value))
