"""What a command line says instead of a world file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, get_type_hints

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.border import BorderOverrides
from minerva_bus.launch.keeping import RecordOverrides
from minerva_bus.launch.specs import SERVICES, entries
from minerva_bus.launch.toml import TomlError, read_toml
from minerva_bus.world.services import Service


@dataclass(frozen=True, slots=True)
class Overrides:
    """What a command line says instead of the world file."""

    options: Mapping[str, str] = field(default_factory=dict[str, str])
    settings: tuple[str, ...] = ()
    views: tuple[str, ...] = ()
    name: str = ""
    seed: int | None = None
    rate: float | None = None
    frames: int | None = None
    until: str | None = None
    record: str = ""
    recording: RecordOverrides = field(default_factory=RecordOverrides)
    listen: str = ""
    border: BorderOverrides = field(default_factory=BorderOverrides)
    journal: str = ""
    metrics: str = ""
    log_format: str = ""
    coordinator_only: bool = False

    def check(self) -> None:
        """Complain of numbers that no world can have. Raises WorldFileError."""
        if self.rate is not None and not 0 <= self.rate < float("inf"):
            raise WorldFileError(f"--rate must be a number from 0, not {self.rate:g}")
        if self.frames is not None and self.frames < 0:
            raise WorldFileError(f"--frames must be a whole number from 0, not {self.frames}")
        if self.seed is not None and not -(1 << 63) <= self.seed < 1 << 63:
            raise WorldFileError("--seed must be a whole number of at most 64 bits")

    def by_process(self) -> dict[str, dict[str, Any]]:
        """The settings, PROCESS.KEY=VALUE, by process and key. Raises WorldFileError."""
        found: dict[str, dict[str, Any]] = {}
        for setting in self.settings:
            place, equals, value = setting.partition("=")
            process, dot, key = place.partition(".")
            if not equals or not dot:
                raise WorldFileError(f"--set {setting}: expected PROCESS.KEY=VALUE")
            found.setdefault(process, {})[key] = toml_value(value)
        return found


AS_WRITTEN: Final = Overrides()
"""Nothing is said: the world file holds as it is written."""


def toml_value(text: str) -> Any:
    """A value as TOML writes it; anything else is a text."""
    try:
        return read_toml(f"value = {text}")["value"]
    except (TomlError, KeyError):
        return text


def typed_options(cls: type[Service], options: Mapping[str, str]) -> dict[str, Any]:
    """A service's options as a command line has them; what is to be a text is one: `vision 0`."""
    hints = get_type_hints(cls.__init__)
    found = {key: toml_value(text) for key, text in options.items()}
    return {
        key: options[key] if hints.get(key) is str and not isinstance(value, str) else value
        for key, value in found.items()
    }


def read_view(text: str) -> tuple[str, str, dict[str, Any]]:
    """What `svg`, `svg:every=5`, `module:Class` or `module:Class:every=5` name.

    Returns what is to be loaded, the name of the process and its options. Raises WorldFileError.
    """
    kind, _, rest = text.partition(":")
    first, _, others = rest.partition(":")
    if first and "=" not in first and kind not in entries(SERVICES):
        return f"{kind}:{first}", first.lower(), _pairs(others) if others else {}
    return kind, kind, _pairs(rest) if rest else {}


def _pairs(text: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for pair in text.split(","):
        key, equals, value = pair.partition("=")
        if not equals:
            raise WorldFileError(f"{pair!r}: expected KEY=VALUE")
        found[key.strip()] = toml_value(value)
    return found
