"""Arguments of public functions: a value of a wrong type is a MisuseError that names the argument.

Annotations do not check values that notebooks and scripts pass.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from minerva_bus.errors import MisuseError, whole


def whole_number(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """A whole number from `least` to `most`. Raises MisuseError."""
    if not whole(value, least) or (most is not None and value > most):
        upper = "" if most is None else f" to {most:,}"
        raise MisuseError(f"{name} must be a whole number from {least}{upper}, not {value!r:.60}")
    return int(value)


def text(name: str, value: Any) -> str:
    """A text. Raises MisuseError."""
    if not isinstance(value, str):
        raise MisuseError(f"{name} must be a text, not {value!r:.60}")
    return value


def text_list(name: str, values: Any) -> tuple[str, ...]:
    """Several texts. Raises MisuseError, also for a single text, whose letters would be taken."""
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise MisuseError(f"{name} must be a list of texts, not {values!r:.60}")
    return tuple([text(f"each of {name}", value) for value in cast("Iterable[Any]", values)])


def named(name: str, values: Any) -> dict[str, Any]:
    """A mapping with texts as keys. Raises MisuseError."""
    if not isinstance(values, Mapping):
        raise MisuseError(f"{name} must be a dictionary of values by name, not {values!r:.60}")
    return {text(f"a key of {name}", key): each for key, each in cast("Any", values).items()}


def path_of(name: str, value: Any) -> Path:
    """The path of a file or folder. Raises MisuseError, also for a name that no file can have."""
    given = os.fspath(cast("os.PathLike[Any]", value)) if hasattr(value, "__fspath__") else value
    if not isinstance(given, str):
        raise MisuseError(f"{name} must be a path, not {value!r:.60}")
    try:
        valid = b"\0" not in os.fsencode(given)
    except UnicodeEncodeError:
        valid = False
    if not valid:
        raise MisuseError(f"{name} cannot name a file: {given!r:.60}")
    return Path(given)
