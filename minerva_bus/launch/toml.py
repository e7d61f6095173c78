"""TOML from untrusted sources: parsed in bounded time, or rejected with a reason."""

from __future__ import annotations

import re
import tomllib
from typing import Any, Final

from minerva_bus.errors import MinervaError

MAX_KEY_PARTS: Final = 64
"""Limit for the parts of a dotted key: the parser of the standard library is quadratic in them."""

_STRINGS: Final = re.compile(
    r'"""[\s\S]*?"""|' r"'''[\s\S]*?'''|" r'"(?:[^"\\\n]|\\.)*"|' r"'[^'\n]*'|" r"#[^\n]*"
)
_PART: Final = r"[ \t]*+\.[ \t]*+[\w-]++"
_LONG_KEY: Final = re.compile(rf"(?<![\w-])[\w-]++(?:{_PART}){{{MAX_KEY_PARTS},}}")


class TomlError(MinervaError):
    """A text is not TOML, or exceeds the limits of a world file."""


def read_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises TomlError."""
    if _LONG_KEY.search(_STRINGS.sub("s", text)):
        raise TomlError(f"a dotted key has more than {MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise TomlError("arrays or tables are nested too deeply") from None
    except ValueError as error:  # Invalid TOML, or a number with thousands of digits.
        raise TomlError(str(error)) from None
