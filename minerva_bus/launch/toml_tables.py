"""TOML tables, read strictly: known keys, values of the right type, errors with their line.

The text may be of an untrusted source: it is parsed in bounded time, or rejected with a reason.

Texts of a command line have typed values, too: PROCESS.KEY=VALUE, views, and the options of a
world, which are its table [options], `--name value` on a command line, and `${name}` in other
tables.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
import tomllib
import traceback
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from itertools import filterfalse
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar, cast, get_type_hints

from minerva_bus.entry_points import entries
from minerva_bus.errors import (
    MinervaError,
    MisuseError,
    SceneError,
    UnknownOption,
    WorldFileError,
    nearest,
)
from minerva_bus.launch.assignment import names_nodes
from minerva_bus.launch.installed import SERVICES, is_file
from minerva_bus.launch.specs import load
from minerva_bus.settings.kinds import TABLE, Kind, Setting, fits, phrase_of, settings_of
from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides, plain_value
from minerva_bus.user_code import place_of, report
from minerva_bus.wire.keys import checked_name
from minerva_bus.wording import NO_VALUE
from minerva_bus.world.services import Service

S = TypeVar("S")

MAX_KEY_PARTS: Final = 64
"""Limit for the parts of a dotted key: the parser of the standard library is quadratic in them."""

_STRINGS: Final = re.compile(
    r'"""[\s\S]*?"""|' r"'''[\s\S]*?'''|" r'"(?:[^"\\\n]++|\\.)*+"|' r"'[^'\n]*'|" r"#[^\n]*"
)
# Possessive quantifiers (`*+`, `++`) exclude backtracking, so the search itself takes linear time.
_PART: Final = r"[ \t]*+\.[ \t]*+[\w-]++"
_LONG_KEY: Final = re.compile(rf"(?<![\w-])[\w-]++(?:{_PART}){{{MAX_KEY_PARTS},}}")

_MAX_DIGITS: Final = sys.int_info.default_max_str_digits
_LONG_NUMBER: Final = re.compile(rf"(?<![\w.])[+-]?\d(?:_?\d){{{_MAX_DIGITS},}}")
_POSITION: Final = re.compile(r" \((?:at line (\d+), column (\d+)|at end of document)\)$")

_EXPECTED: Final = {
    "Invalid value": 'a text in quotes ("..."), a number, true, false, a [list] or a {table}',
    "Invalid statement": "`key = value`, [table] or a comment (#)",
}
"""What is expected where the parser names only what is wrong."""


class Table:
    """One table of a world file, below the settings of a command line.

    A value of the command line replaces that of the file; both are converted by the kind of their
    setting. Errors name the option, or the line and column of the key. `done` rejects unknown keys.
    """

    def __init__(
        self,
        data: Mapping[str, Any],
        name: str,
        text: str,
        source: str,
        overrides: Overrides = AS_WRITTEN,
    ) -> None:
        # A copy, because `put` and the command line change it.
        self.data = dict(data)
        self.name = name
        self._text = text
        self._source = source
        self.overrides = overrides
        self._known: list[str] = []
        self._tables: dict[str, Table] = {}

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def get(self, key: str, kind: Kind, default: Any) -> Any:
        """The value of a key of the file, converted. Raises WorldFileError."""
        self._known.append(key)
        if key not in self.data:
            return default
        try:
            return kind.convert(self.data[key])
        except MisuseError as error:
            self.wrong(key, str(error))

    def read(self, cls: type[S], defaults: S | None = None) -> S:
        """The settings that a dataclass declares, of the file and the command line.

        The whole file reads each setting from its own table, a table reads all from itself.
        `defaults` replaces the declared defaults. Raises WorldFileError.
        """
        return cls(**{
            name: self._home(setting)._setting(setting, getattr(defaults, name, setting.default))
            for name, setting in settings_of(cls).items()
        })  # fmt: skip

    def _home(self, setting: Setting) -> Table:
        return self if self.name else self.table(setting.table)

    def _setting(self, setting: Setting, default: Any) -> Any:
        # The file is converted first, so that a mistake in it is found with any command line.
        value = self.get(setting.key, setting.kind, default) if setting.key else default
        if setting.option in self.overrides.values:
            try:
                value = setting.given(self.overrides.values[setting.option])
            except MisuseError as error:
                raise WorldFileError(str(error)) from None
        return value

    def wrong_setting(self, cls: type[Any], name: str, problem: str) -> NoReturn:
        """Raise WorldFileError about a setting, with the source of its value: option or line."""
        setting = settings_of(cls)[name]
        if setting.option in self.overrides.values:
            raise WorldFileError(f"{setting.flag} {problem}")
        self._home(setting).wrong(setting.key, problem)

    def named(self, name: str, what: str) -> str:
        """A name that is valid on the bus. Raises WorldFileError."""
        try:
            return checked_name(name, what)
        except MisuseError as error:
            raise WorldFileError(f"{self._source}: {error}") from None

    def table(self, key: str) -> Table:
        """A table within this one; empty if it is absent."""
        if key not in self._tables:
            data = self.get(key, TABLE, {})
            name = f"{self.name}.{key}" if self.name else key
            self._tables[key] = Table(data, name, self._text, self._source, self.overrides)
        return self._tables[key]

    def put(self, key: str, value: Any) -> None:
        """Replace the value of a key, for example with its options filled in."""
        self.data[key] = value
        # A table that was read earlier has the old values.
        self._tables.pop(key, None)

    def rest(self) -> dict[str, Any]:
        """The keys that have not been read yet, with their values."""
        left = {key: value for key, value in self.data.items() if key not in self._known}
        self._known += left
        return left

    def place(self, key: str) -> str:
        """Location of a key for messages: file, line and name."""
        return f"{self._source}{self.line(key)}: {self.name}.{key}"

    def line(self, key: str) -> str:
        """The line of a key as `:12`; empty if the text has no such key."""
        at = self._place(key)
        return f":{self._text.count(chr(10), 0, at) + 1}" if at >= 0 else ""

    def done(self) -> None:
        """Raise WorldFileError if the table has an unknown key."""
        for key in self.data:
            if key not in self._known:
                where = f"[{self.name}]" if self.name else "a world file"
                # A key that several readers need is there once for each of them.
                known = f"{where} has {', '.join(dict.fromkeys(self._known))}"
                self.wrong(key, f"is unknown{nearest(key, self._known, known)}")

    @contextmanager
    def loading(self, key: str) -> Generator[None]:
        """Name the place of a key in errors of importing what it names."""
        try:
            yield
        except WorldFileError as error:
            text, _, place = str(error).partition("\n")
            if place:  # Its line in a module is more specific than that in this file.
                full = f"{self.name}.{key}" if self.name else key
                raise WorldFileError(f"{self._source}: {full}: {text}\n{place}") from error
            self._raise(key, f": {text}")

    def wrong(self, key: str, problem: str) -> NoReturn:
        """Raise WorldFileError about a key of the file, with its line and a caret."""
        self._raise(key, f" {problem}")

    def _raise(self, key: str, problem: str) -> NoReturn:
        full = f"{self.name}.{key}" if self.name else key
        raise WorldFileError(
            str(
                SceneError(
                    f"{full}{problem}",
                    text=self._text,
                    offset=self._place(key),
                    source=self._source,
                )
            )
        )

    def _place(self, key: str) -> int:
        # The parser gives no positions, so the key is searched in the text.
        start, end, own = 0, len(self._text), re.escape(self.name)
        header = re.search(rf"^[ \t]*\[[ \t]*{own}[ \t]*\]", self._text, re.M)
        if self.name and header:
            start = header.end()
            following = re.compile(rf"^[ \t]*\[(?![ \t]*{own}\.)[\w.\"' -]+\][ \t]*(#.*)?$", re.M)
            after = following.search(self._text, start)
            end = after.start() if after else end
        # The key may be assigned, begin a dotted key, or be a part of a table's name.
        pattern = rf"^[ \t]*(\[([\w.]*\.)?)?(?P<key>\"?{re.escape(key)}\"?)\s*[=\].]"
        match = re.compile(pattern, re.M).search(self._text, start, end)
        return match.start("key") if match else -1


class TomlError(MinervaError):
    """A text is not TOML, or exceeds the limits of a world file.

    `offset`: its index in the text, -1 if unknown. `expected`: a phrase, empty if unknown.
    """

    def __init__(self, problem: str, offset: int = -1, expected: str = "") -> None:
        super().__init__(problem)
        self.offset = offset
        self.expected = expected


def read_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises TomlError."""
    # Dots in texts and comments are not parts of keys.
    if _LONG_KEY.search(_STRINGS.sub("s", text)):
        raise TomlError(f"a dotted key has more than {MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise TomlError("arrays or tables are nested too deeply") from None
    except tomllib.TOMLDecodeError as error:
        raise _located(str(error), text) from None
    except ValueError:  # Python limits the digits of a whole number.
        # A text or comment with as many digits keeps its length, so that the offset is right.
        blank = _STRINGS.sub(lambda match: " " * len(match[0]), text)
        match = _LONG_NUMBER.search(blank)
        problem = f"a whole number has more than {_MAX_DIGITS} digits"
        raise TomlError(problem, match.start() if match else -1) from None


def _located(message: str, text: str) -> TomlError:
    """The error of a message of the parser, which ends with the position."""
    match = _POSITION.search(message)
    if match is None:
        return TomlError(message)
    problem = message[: match.start()]
    if match[1] is None:
        # The caret points behind the last character, not into an empty last line.
        return TomlError(f"the file ends too early: {problem}", len(text.rstrip()))
    lines = text.split("\n")[: int(match[1]) - 1]
    offset = sum(len(line) + 1 for line in lines) + int(match[2]) - 1
    return TomlError(problem, offset, _EXPECTED.get(problem, ""))


def toml_value_text(value: Any) -> str:
    """A value in TOML, on one line."""
    if isinstance(value, Mapping):
        pairs = cast("Mapping[str, Any]", value).items()
        return f"{{{', '.join(f'{json.dumps(key)} = {toml_value_text(v)}' for key, v in pairs)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value_text, cast('list[Any]', value)))}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    # A string of JSON is one of TOML, but TOML also requires an escape for DEL.
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def toml_text(tables: Mapping[str, Mapping[str, Any]]) -> str:
    """Tables as a TOML text; a table of tables, as `process`, has a heading for each."""
    blocks: list[str] = []
    for name, table in tables.items():
        named = name in ("process", "norm")
        inner = {f"{name}.{key}": value for key, value in table.items()} if named else {name: table}
        for heading, pairs in inner.items():
            if pairs:
                lines = [f"{_key(key)} = {toml_value_text(value)}" for key, value in pairs.items()]
                blocks.append("\n".join([f"[{heading}]", *lines]) + "\n")
    return "\n".join(blocks)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else json.dumps(key)


# --- texts of a command line ---


def toml_value(text: str) -> Any:
    """The value of a text in TOML; any other text is returned unchanged."""
    try:
        return read_toml(f"value = {text}")["value"]
    except (TomlError, KeyError):
        return text


def typed_options(cls: type[Service], options: Mapping[str, str]) -> dict[str, Any]:
    """The options of a service, typed; `0` stays a text if the service declares a text."""
    hints = get_type_hints(cls.__init__)
    values = {key: toml_value(_given(key, text)) for key, text in options.items()}
    return {
        key: options[key] if hints.get(key) is str and not isinstance(value, str) else value
        for key, value in extended({}, values).items()
    }


def extended(table: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A table with values by key; a key such as `qos.scan` is of a table in it, as in TOML."""
    whole = dict(table)
    for key, value in values.items():
        *path, last = key.split(".", MAX_KEY_PARTS)
        inner = whole
        for name in path:
            own = inner.get(name)
            inner[name] = dict(cast("dict[str, Any]", own)) if isinstance(own, dict) else {}
            inner = inner[name]
        inner[last] = value
    return whole


def settings_by_process(settings: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Settings PROCESS.KEY=VALUE, by process and key. Raises WorldFileError.

    Settings of nodes, such as `AEgg.speed=0.3`, are left out.
    """
    values: dict[str, dict[str, Any]] = {}
    for setting in filterfalse(of_nodes, settings):
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


# --- the options of a world ---


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
            known = [f"--{name}" for name in options]
            raise UnknownOption(path.stem, f"--{key.replace('_', '-')}", known)
        _given(key, text)
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


def _given(key: str, text: str) -> str:
    """The text of an option. Raises WorldFileError if its value is missing."""
    if text == NO_VALUE:
        raise WorldFileError(f"--{key} needs a value")
    return text


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
    if "module:function" in choices and ":" in given:
        return given
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
    place, file = place_of(error), frame.f_code.co_filename
    return isinstance(error, MisuseError) and place is not None and file != place.file


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
    if alone := re.fullmatch(r"\$\{(\w+)\}", value):
        return _option(alone.group(1), options, path)
    return re.sub(r"\$\{(\w+)\}", lambda match: str(_option(match.group(1), options, path)), value)


def _option(name: str, options: Mapping[str, Any], path: Path) -> Any:
    if name not in options:
        hint = nearest(name, list(options), "declare it among the options")
        raise WorldFileError(f"{path}: ${{{name}}} is not an option{hint}")
    return options[name]


def option_text(value: Any) -> str:
    """An option as on a command line: a text is unchanged, any other value is in TOML."""
    return value if isinstance(value, str) else toml_value_text(plain_value(value))
