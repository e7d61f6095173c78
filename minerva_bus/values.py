"""Values: the checks of those that callers pass to public functions, and classes of them.

Annotations do not check values that notebooks and scripts pass. A value of a wrong type is a
MisuseError that names the argument.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar, cast, dataclass_transform

from minerva_bus.errors import MisuseError, whole

_T = TypeVar("_T")


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def fast_dataclass(cls: type[_T]) -> type[_T]:
    """Make a class an immutable dataclass with slots; the type checker refuses to change objects.

    Python does not: a class that is frozen at run time sets each field by a call, which takes five
    times as long, and a frame makes a dozen of these objects. Its methods but the constructor are
    shared, because `dataclass` compiles six for each class, which takes 0.3 ms: a start makes 200
    such classes. Classes of objects that users hold are `dataclass(frozen=True, slots=True)`.
    """
    made: Any = dataclass(slots=True, eq=False, repr=False)(cls)
    # With the class, because a getter of a single name would return no tuple.
    made._compared = attrgetter("__class__", *[of.name for of in fields(made) if of.compare])
    for name, method in _SHARED.items():
        if made.__dict__.get(name) is None:
            setattr(made, name, method)
    return made


def _equal(self: Any, other: Any) -> bool:
    same = other.__class__ is self.__class__
    return self._compared(self) == self._compared(other) if same else NotImplemented


def _hash(self: Any) -> int:
    return hash(self._compared(self))


def _shown(self: Any) -> str:
    shown = [f"{of.name}={getattr(self, of.name)!r}" for of in fields(self) if of.repr]
    return f"{type(self).__qualname__}({', '.join(shown)})"


_SHARED = {"__eq__": _equal, "__hash__": _hash, "__repr__": _shown}


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
