"""How a setting is declared: as a field of a dataclass, with its place, kind, limits and help."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any, Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.settings.kinds import BOOLEAN, TEXT, TEXTS, Kind, number, whole

_METADATA: Final = "setting"
_KINDS: Final = {bool: BOOLEAN, int: whole(), float: number(), str: TEXT, tuple: TEXTS}
_UNSET: Final = "\0"
"""No key is given; an empty one means that the setting is not in a world file."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting.

    `table` and `key` are its place in a world file (key "": not there), `option` its name on the
    command line without `--` ("": not there). `help` is a sentence for `--help` and the documents;
    `more` continues it in the documents, in Markdown. `form` and `shown` replace the kind and the
    default in the documents. `empty`: an empty text on the command line is a value; otherwise it
    leaves the setting to the world file.
    """

    table: str
    kind: Kind
    default: Any
    help: str
    name: str = ""
    key: str = ""
    option: str = ""
    more: str = ""
    form: str = ""
    shown: str = ""
    empty: bool = False

    @property
    def flag(self) -> str:
        """The option as a user types it."""
        return f"--{self.option.replace('_', '-')}"

    def given(self, value: Any) -> Any:
        """The value of a command line, converted. Raises MisuseError that names the option."""
        try:
            return self.kind.convert(value)
        except MisuseError as error:
            raise MisuseError(f"{self.flag} {error}, not {value!r}") from None


def setting(
    table: str,
    default: Any,
    help: str,
    kind: Kind | None = None,
    *,
    key: str = _UNSET,
    option: str = "",
    more: str = "",
    form: str = "",
    shown: str = "",
    empty: bool = False,
) -> Any:
    """Declare a setting as a field of a dataclass; without `kind`, that of the default's type.

    Its key in the world file is the name of the field, unless `key` is given.
    """
    own = kind or _KINDS[type(default)]
    declared = Setting(table, own, default, help, "", key, option, more, form, shown, empty)
    return field(default=default, metadata={_METADATA: declared})


@cache
def settings_of(cls: type[Any]) -> Mapping[str, Setting]:
    """The settings that a dataclass declares, by the names of its fields."""
    settings: dict[str, Setting] = {}
    for each in fields(cls):
        declared: Setting | None = each.metadata.get(_METADATA)
        if declared is not None:
            key = each.name if declared.key == _UNSET else declared.key
            settings[each.name] = replace(declared, name=each.name, key=key)
    return settings


def by_option(*classes: type[Any]) -> Mapping[str, Setting]:
    """The settings of these classes that have an option, by its name."""
    declared = [entry for cls in classes for entry in settings_of(cls).values()]
    return {each.option: each for each in declared if each.option}


def check_known(
    names: Mapping[str, object], known: Mapping[str, Setting], others: Sequence[str] = ()
) -> None:
    """Raise MisuseError if a name is not one of these settings; `others` may be meant, too."""
    for name in names:
        if name not in known:
            raise MisuseError(f"there is no setting {name!r}{nearest(name, [*known, *others])}")
