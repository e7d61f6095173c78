"""Common parts of services: groups of options, lists in one string, libraries, passwords."""

from __future__ import annotations

import importlib.util
import inspect
import math
import os
from collections.abc import Callable
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import read_text
from minerva_bus.wording import install
from minerva_bus.world.services import WorldInfo

_Init = TypeVar("_Init", bound=Callable[..., None])


def takes_options(*groups: type[Any], without: tuple[str, ...] = ()) -> Callable[[_Init], _Init]:
    """Decorator of a constructor whose `**` parameter holds the fields of dataclasses of options.

    The constructor's signature then lists these options with their types and defaults, except those
    of `without`, because the bus checks the options of a world file against the signature. Its
    docstring is that of the groups, for help texts.
    """

    def extended(init: _Init) -> _Init:
        signature = inspect.signature(init)
        *own, _ = signature.parameters.values()
        added = [
            inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if field.default is MISSING else field.default,
                annotation=get_type_hints(group)[field.name],
            )
            for group in groups
            for field in fields(group)
            if field.name not in (*signature.parameters, *without)
        ]
        described: Any = init  # the type of functions does not declare __signature__
        described.__signature__ = signature.replace(parameters=[*own, *added])
        described.__doc__ = "\n\n".join(group.__doc__ or "" for group in groups)
        init.__annotations__ |= {parameter.name: parameter.annotation for parameter in added}
        return init

    return extended


def grouped(given: dict[str, Any], *groups: type[Any]) -> tuple[Any, ...]:
    """The dataclasses of options, created from their fields. Raises TypeError for other options."""
    rest = dict(given)
    created = [
        group(**{field.name: rest.pop(field.name) for field in fields(group) if field.name in rest})
        for group in groups
    ]
    if rest:
        raise TypeError(f"unknown options: {', '.join(rest)}")
    return tuple(created)


def names_in(text: str) -> tuple[str, ...]:
    """The names in a comma-separated string, without duplicates."""
    return tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def event_types(service: str, text: str) -> tuple[str, ...]:
    """Visual event types from the option `draws` of a service. Raises MisuseError if empty."""
    types = names_in(text)
    if not types:
        raise MisuseError(f"{service}: draws is {text!r}; expected visual event types, as ePicture")
    return types


def check_parameter(service: str, world: WorldInfo, option: str, name: str) -> None:
    """Raise MisuseError if no view of a world has the parameter that an option names."""
    vocabulary = world.vocabulary
    symbols = (*vocabulary.primitives.values(), *vocabulary.transformations.values())
    known = sorted({name for symbol in symbols for name in symbol.fields.names})
    if name not in known:
        there = f"they have {', '.join(known)}"
        raise MisuseError(
            f"{service}: {option} is {name!r}, which no primitive and no transformation of the"
            f" world has{nearest(name, known, there)}"
        )


def check_owner(service: str, world: WorldInfo, name: str) -> None:
    """Raise MisuseError if no view has a parameter of an own name for the agents of figures."""
    # The usual name may be missing, where the views of agents say whose figures they are.
    if name != "who":
        check_parameter(service, world, "who", name)


def check_port(service: str, port: int) -> None:
    """Raise MisuseError if a port is not one, and not 0."""
    if not 0 <= port <= 65535:
        raise MisuseError(f"{service}: port is {port}; expected 1 to 65535, or 0 for a free one")


def check_rate(service: str, rate: float) -> None:
    """Raise MisuseError for a rate of views that is not possible."""
    if not 0 < rate <= 1000:
        raise MisuseError(f"{service}: rate is {rate:g}; expected up to 1000 views per second")


def check_positive(service: str, name: str, value: float) -> float:
    """The value of an option, if it is a finite number above 0. Raises MisuseError."""
    if not (math.isfinite(value) and value > 0):
        raise MisuseError(f"{service}: {name} is {value!r}; expected a number above 0")
    return float(value)


def require(service: str, module: str, library: str, extra: str) -> None:
    """Raise MisuseError, with the command that installs it, if a library is not installed.

    The library is not imported: some take seconds, too long for a frame.
    """
    try:
        missing = importlib.util.find_spec(module) is None
    except ImportError:  # not even its package
        missing = True
    if missing:
        raise MisuseError(f"{service} needs {library}: {install(extra)}")


MAX_PASSWORD_BYTES = 64 << 10


def read_password(service: str, variable: str, file: str) -> str:
    """The password in an environment variable or in a file. Raises MisuseError."""
    if variable:
        password = os.environ.get(variable)
        if password is None:
            raise MisuseError(f"{service}: environment variable {variable} is not set")
        return password
    try:
        return read_text(Path(file), MAX_PASSWORD_BYTES).rstrip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise MisuseError(f"{service}: password_file {file}: {reason}") from None
