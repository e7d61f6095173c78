"""Normalizes what a service's methods return.

`generate` returns events, one event or None. `save` returns any plain value. On the bus and in
records that is always a mapping, so any other value is sent as the only entry of one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from types import GeneratorType
from typing import Any, Final, cast

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent, Event, Events, check_number
from minerva_bus.grammar.symbols import EventType
from minerva_bus.user_code import blamed
from minerva_bus.world.services import Service

VALUE: Final = "="
"""Key of a value that is not a mapping."""

MAX_DEPTH: Final = 100
"""Lists and mappings that may be nested in saved data."""

_SURROGATE: Final = re.compile("[\ud800-\udfff]")

NOTHING: Final[Mapping[str, Any]] = {VALUE: None}
"""Replaces a member's earlier data when it no longer saves any."""


def made_events(made: Any) -> Iterator[AnyEvent]:
    """The events in the result of `generate`: None, an event, or an iterable of both.

    Raises TypeError, and MisuseError for more than `check_number` allows.
    """
    if made is None:
        return
    # Checked before Iterable, because an event and a batch are iterable themselves.
    if isinstance(made, Event | Events):
        yield made
        return
    # A text and a mapping are iterable, but their letters and keys are not what was meant.
    # Generators and lists are found without the checks of abstract classes.
    result: object = made
    if not isinstance(result, GeneratorType | list | tuple) and (
        isinstance(result, str | bytes | Mapping) or not isinstance(result, Iterable)
    ):
        raise TypeError(f"expected events, one event or None, not {_named(made)}")
    for number, item in enumerate(cast("Iterable[object]", result)):
        check_number(number)
        if item is not None:
            if not isinstance(item, Event | Events):
                raise TypeError(f"expected events, not {_named(item)}")
            yield item


def _named(made: object) -> str:
    if isinstance(made, EventType):
        return f"the event type {made.name}; an event is {made.name}(...)"
    return f"{made!r:.100}"


def saved_by(service: Service) -> Mapping[str, Any] | None:
    """A service's saved data as a mapping, or None. Raises UserCodeError if they are not plain."""
    if getattr(service.save, "__func__", None) is Service.save:
        return None  # as most services do
    with blamed(service.save):
        saved: Any = service.save()
        _check_plain(saved, "it")
    if saved is None:
        return None
    if isinstance(saved, Mapping):
        names = cast("Mapping[str, Any]", saved)
        # A mapping that has VALUE as its only key is wrapped too, or `restore` would unwrap it.
        return {VALUE: names} if set(names) == {VALUE} else names
    return {VALUE: saved}


def restore(service: Service, saved: Mapping[str, Any]) -> None:
    """Restore a service from the data that its predecessor saved, if any. Raises UserCodeError."""
    value: Any = saved[VALUE] if set(saved) == {VALUE} else saved
    if value is None:
        return
    with blamed(service.restore):
        service.restore(value)


def figures_by(service: Service) -> dict[str, bool | int | float | str]:
    """The figures that a service reports. Raises UserCodeError for invalid ones.

    Numbers that are not finite are omitted: the protocol forbids them.
    """
    with blamed(service.report):
        returned: Any = service.report()
        if not isinstance(returned, Mapping | None):
            raise MisuseError(
                f"it returns {returned!r:.60}; figures are a mapping of names to values, such as"
                ' {"distance": 1.5}'
            )
        reported = cast("Mapping[Any, Any]", returned or {})
        named = [(name, _figure(name, value)) for name, value in reported.items()]
    return {
        name: value for name, value in named if not isinstance(value, float) or math.isfinite(value)
    }


def _figure(name: Any, value: Any) -> bool | int | float | str:
    """A figure as a value of Python. Raises MisuseError."""
    if isinstance(value, np.generic):
        value = cast("Any", value).item()
    if not isinstance(name, str) or not isinstance(value, bool | int | float | str):
        raise MisuseError(
            f"it reports {name!r:.60} as {type(value).__name__}; a figure is a boolean, a number"
            " or a text, and its name a text"
        )
    _check_scalar(name, "the name of a figure")
    _check_scalar(value, f"its figure {name!r:.60}")
    return value


def _check_plain(value: Any, where: str, depth: int = 0) -> None:
    """Raise MisuseError for a value that cannot be sent or recorded."""
    if depth > MAX_DEPTH:
        raise MisuseError(f"{where[:60]}... is nested more than {MAX_DEPTH} deep")
    if value is None or isinstance(value, bool | int | float | str | bytes):
        _check_scalar(value, where)
    elif isinstance(value, list | tuple):
        for place, item in enumerate(cast("Iterable[Any]", value)):
            _check_plain(item, f"{where}[{place}]", depth + 1)
    elif isinstance(value, Mapping):
        for key, item in cast("Mapping[object, Any]", value).items():
            if not isinstance(key, str):
                raise MisuseError(f"{where} has the key {key!r:.60}; keys are texts")
            _check_scalar(key, f"a key of {where}")
            _check_plain(item, f"{where}[{key!r}]", depth + 1)
    else:
        raise MisuseError(
            f"{where} is of type {type(value).__name__}; what is saved is None, a boolean, a"
            " number, a text, bytes, or a list or mapping of these"
        )


def _check_scalar(value: object, where: str) -> None:
    """Raise MisuseError for a number or a text that MessagePack cannot represent."""
    if isinstance(value, int) and not -(1 << 63) <= value < 1 << 64:
        raise MisuseError(f"{where} is a whole number of more than 64 bits; use a text instead")
    if isinstance(value, str) and not value.isascii() and _SURROGATE.search(value):
        raise MisuseError(f"{where} is a text with lone surrogates; expected valid Unicode")
