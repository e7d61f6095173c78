"""How a setting is declared, and the kinds of values that settings take.

A kind is one typed conversion for world files and command lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, fields, replace
from functools import cache
from math import isfinite
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.values import fast_dataclass

MAX_WHOLE: Final = (1 << 63) - 1
"""The greatest whole number that a message can carry."""


@fast_dataclass
class Kind:
    """A type with its limits.

    `convert` returns a checked value, or raises MisuseError with what the value must be. `phrase`
    describes the kind in documents, `schema` in JSON Schema; `python` is the type of one value on
    a command line, and `repeats` whether the option may be given more than once.
    """

    phrase: str
    convert: Callable[[Any], Any]
    python: type = str
    repeats: bool = False
    schema: Mapping[str, Any] = field(default_factory=dict[str, Any])


def _checked(value: Any, types: tuple[type, ...], phrase: str) -> Any:
    # A bool is an int in Python, but `frames = true` is a mistake.
    if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
        raise MisuseError(f"must be {phrase}")
    return value


def _text(value: Any) -> str:
    return _checked(value, (str,), "a text")


def _boolean(value: Any) -> bool:
    return _checked(value, (bool,), "true or false")


def _texts(value: Any) -> tuple[str, ...]:
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, list | tuple):
        raise MisuseError("must be a list of texts")
    items = cast("list[Any] | tuple[Any, ...]", value)
    if not all(isinstance(item, str) for item in items):
        raise MisuseError("must be a list of texts")
    return tuple(items)


def _table(value: Any) -> dict[str, Any]:
    return _checked(value, (dict,), "a table")


def single(what: str) -> Kind:
    """One text, or a list with at most one; `what` it is, for messages."""

    def convert(value: Any) -> str:
        texts = _texts(value)
        if len(texts) > 1:
            raise MisuseError(f"must be one {what}")
        return "".join(texts)

    at_most_one = {"type": "array", "items": {"type": "string"}, "maxItems": 1}
    return Kind(what, convert, schema={"anyOf": [{"type": "string"}, at_most_one]})


def address(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT. Raises MisuseError."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or int(port) > 65535:
        raise MisuseError(f"{text!r} is not an address; expected HOST:PORT, such as 127.0.0.1:9464")
    return host.strip("[]"), int(port)


def _address(value: Any) -> str:
    text = _text(value)
    if text:
        try:
            address(text)
        except MisuseError:
            raise MisuseError("must be HOST:PORT, such as 127.0.0.1:9464") from None
    return text


def _topics(value: Any) -> tuple[str, ...]:
    if isinstance(value, bool):
        return (ALL,) if value else ()
    if value in (ALL, "all"):
        return (ALL,)
    topics = [topic.strip() for topic in value.split(",")] if isinstance(value, str) else value
    from minerva_bus.wire.keys import checked_name

    try:
        return tuple([checked_name(topic, "a topic") for topic in _texts(topics)])
    except MisuseError as error:
        raise MisuseError(f"must be all or a list of topics: {error}") from None


ALL: Final = "*"
"""In place of topics: all of them."""

_STRING: Final = {"type": "string"}
_STRINGS: Final = {"anyOf": [_STRING, {"type": "array", "items": _STRING}]}

TEXT: Final = Kind("text", _text, schema=_STRING)
BOOLEAN: Final = Kind("boolean", _boolean, bool, schema={"type": "boolean"})
TEXTS: Final = Kind("list of texts", _texts, repeats=True, schema=_STRINGS)
TABLE: Final = Kind("table", _table, schema={"type": "object"})
ADDRESS: Final = Kind("address", _address, schema=_STRING)
TOPICS: Final = Kind(
    "list of topics", _topics, schema={"anyOf": [{"type": "boolean"}, *_STRINGS["anyOf"]]}
)
ANY: Final = Kind("any value", lambda value: value)


def whole(least: int = 0, most: int = MAX_WHOLE) -> Kind:
    """Whole numbers from `least` to `most`."""

    def convert(value: Any) -> int:
        number = _checked(value, (int,), "a whole number")
        if number < least:
            raise MisuseError(f"must be at least {least}")
        if number > most:
            raise MisuseError(f"must be at most {most}")
        return number

    limit = f"{least:,} to {most:,}" if most < MAX_WHOLE else f"{least:,}"
    phrase = f"whole number from {limit}" if least > -MAX_WHOLE else "whole number, 64 bits"
    return Kind(phrase, convert, int, schema={"type": "integer", "minimum": least, "maximum": most})


AUTO: Final = 0
"""The number for which the word "auto" stands: the program chooses."""


def whole_or_auto(least: int, most: int) -> Kind:
    """Whole numbers from `least` to `most`, above `AUTO`, or the word "auto"."""
    numbers = whole(least, most)

    def convert(value: Any) -> int:
        if value == "auto":
            return AUTO
        # Options of a command line are texts.
        given = int(value) if isinstance(value, str) and value.isdecimal() else value
        try:
            return numbers.convert(given)
        except MisuseError as error:
            raise MisuseError(f'{error}, or "auto"') from None

    schema = {"anyOf": [numbers.schema, {"enum": ["auto"]}]}
    return Kind(f'{numbers.phrase}, or `"auto"`', convert, schema=schema)


def number(least: float = 0.0, unit: str = "") -> Kind:
    """Finite numbers from `least`, in a unit: `seconds`."""
    of_unit = f" of {unit}" if unit else ""

    def convert(value: Any) -> float:
        checked = _checked(value, (int, float), "a number")
        # NaN fails this comparison, as every other one.
        if not least <= checked < float("inf"):
            raise MisuseError(f"must be a number{of_unit} from {least:g}")
        return float(checked)

    schema = {"type": "number"} | ({"minimum": least} if isfinite(least) else {})
    return Kind(f"{unit or 'number'} from {least:g}", convert, float, schema=schema)


def choice(*words: str) -> Kind:
    """One of these words."""

    def convert(value: Any) -> str:
        word = _text(value)
        if word not in words:
            close = nearest(word, list(words))
            raise MisuseError(f"must be one of {', '.join(words)}{close}")
        return word

    return Kind(", ".join(f'`"{word}"`' for word in words), convert, schema={"enum": list(words)})


def switch(*words: str) -> Kind:
    """True, false, or one of these words."""

    def convert(value: Any) -> bool | str:
        if isinstance(value, bool) or value in words:
            return value
        raise MisuseError(f"must be {', '.join(('true', 'false', *words[:-1]))} or {words[-1]}")

    phrase = ", ".join(["boolean", *(f'`"{word}"`' for word in words)])
    return Kind(phrase, convert, bool, schema={"enum": [True, False, *words]})


_BY_TYPE: Final = {
    bool: (BOOLEAN, "true or false"),
    int: (whole(-MAX_WHOLE - 1), "a whole number"),
    float: (number(float("-inf")), "a number"),
    str: (TEXT, "a text"),
}


def phrase_of(python: Any) -> str:
    """What a value of a Python type is called in messages: `a whole number`; "" if unknown."""
    return _BY_TYPE[python][1] if python in _BY_TYPE else ""


def fits(value: Any, python: Any) -> bool:
    """Whether a value of TOML can be passed where this Python type is declared."""
    if python not in _BY_TYPE:
        return True
    try:
        _BY_TYPE[python][0].convert(value)
    except MisuseError:
        return False
    return True


_METADATA: Final = "setting"
_KINDS: Final = {bool: BOOLEAN, int: whole(), float: number(), str: TEXT, tuple: TEXTS}
_UNSET: Final = "\0"
"""No key is given; an empty one means that the setting is not in a world file."""


@fast_dataclass
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
