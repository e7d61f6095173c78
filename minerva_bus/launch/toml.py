"""TOML from untrusted sources: parsed in bounded time, or rejected with a reason."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Mapping
from typing import Any, Final, cast

from minerva_bus.errors import MinervaError

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
