"""The upper layer of the settings: what a command line sets in place of a world file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.settings.kinds import Setting, by_option, check_known
from minerva_bus.settings.world_settings import TABLES

OPTIONS: Final[Mapping[str, Setting]] = by_option(*TABLES)
"""The settings that have an option on the command line, by its name."""


@dataclass(frozen=True, slots=True, init=False)
class Overrides:
    """Settings of a command line: they replace those of the world file.

    `options` are the world's own options as text, `settings` texts PROCESS.KEY=VALUE, or
    SYMBOL.PARAMETER=VALUE for the string, `views` texts such as `svg:every=5`, `collect` texts
    NAME=EXPRESSION that replace the expressions of [collect]. With `only_code`, the services of the
    world file are not created: its agents' code answers questions about a record. `values` are
    the other settings that were given, by the names of their options:
    `Overrides(seed=3, record="run.mcap")`; None means not given. Values are converted when a world
    file is read. Raises MisuseError for a name that is not a setting.
    """

    options: Mapping[str, str]
    settings: tuple[str, ...]
    views: tuple[str, ...]
    collect: tuple[str, ...]
    only_code: bool
    values: Mapping[str, Any]

    def __init__(
        self,
        options: Mapping[str, str] | None = None,
        settings: tuple[str, ...] = (),
        views: tuple[str, ...] = (),
        collect: tuple[str, ...] = (),
        only_code: bool = False,
        **values: Any,
    ) -> None:
        check_known(values, OPTIONS)
        plain = {name: plain_value(value) for name, value in values.items()}
        given = {name: value for name, value in plain.items() if _given(name, value)}
        for name, value in (
            ("options", dict(options or {})),
            ("settings", tuple(settings)),
            ("views", tuple(views)),
            ("collect", tuple(collect)),
            ("only_code", only_code),
            ("values", given),
        ):
            object.__setattr__(self, name, value)

    def over(self, lower: Overrides) -> Overrides:
        """These settings, and those of a lower layer that are not given here."""
        return Overrides(
            {**lower.options, **self.options},
            # The upper layer comes last: of two settings of one key, the later one counts
            # (`settings_by_process`).
            (*lower.settings, *self.settings),
            (*lower.views, *self.views),
            self.collect or lower.collect,
            self.only_code or lower.only_code,
            **{**lower.values, **self.values},
        )


def _given(name: str, value: Any) -> bool:
    """Whether a value replaces that of the world file: an empty text may not."""
    return value is not None and value != () and (value != "" or OPTIONS[name].empty)


def plain_value(value: Any) -> Any:
    """A number of numpy as a Python object, other values unchanged."""
    # Without numpy, which commands that need no world do not import.
    scalar = type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0
    return value.item() if scalar else value


AS_WRITTEN: Final = Overrides()
"""No setting is replaced."""
