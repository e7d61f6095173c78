"""Texts of a command line as typed values: TOML, service options, PROCESS.KEY=VALUE, views."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, get_type_hints

from minerva_bus.entry_points import entries
from minerva_bus.errors import WorldFileError
from minerva_bus.grammar.assignment import names_nodes
from minerva_bus.launch.installed import SERVICES
from minerva_bus.launch.toml import TomlError, read_toml
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


def by_process(settings: Iterable[str]) -> dict[str, dict[str, Any]]:
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
