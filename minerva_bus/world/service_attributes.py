"""Checks of the attributes of a service that its member reads: names, numbers and choices."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, Final, TypeAlias, cast

from minerva_bus.errors import MisuseError
from minerva_bus.world.services import Device, Generator, Service


def check_attributes(service: Service) -> None:
    """Raise MisuseError for an attribute that is not what the service's member expects.

    A constructor may overwrite them by accident, for example with an option of this name.
    """
    names = ["topics", "publishes"]
    # A class with its own `generates` does not use the attribute.
    if isinstance(service, Generator) and type(service).generates is Generator.generates:
        names.append("events")
    if isinstance(service, Device):
        names.append("draws")
    for name in names:
        declared = getattr(service, name)
        names_only = isinstance(declared, tuple | list) and all(
            isinstance(event, str) for event in cast("Iterable[Any]", declared)
        )
        if not names_only:
            raise MisuseError(
                f"{type(service).__name__}: self.{name} must be a tuple of names, not"
                f" {declared!r:.60};"
                " call an attribute for something else, as an option's value, otherwise"
            )
    _check_settings(service)


def _check_settings(service: Service) -> None:
    settings = _OF_SERVICES | (_OF_DEVICES if isinstance(service, Device) else {})
    for name, (is_valid, expected) in settings.items():
        value = getattr(service, name)
        if not is_valid(value):
            problem = f"{type(service).__name__}: self.{name} must be {expected}, not {value!r:.60}"
            raise MisuseError(problem)


def _is_count(value: Any, least: int = 0) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def _is_amount(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and value >= 0


_Setting: TypeAlias = tuple[Callable[[Any], bool], str]

_OF_SERVICES: Final[dict[str, _Setting]] = {
    "takes": (lambda value: value in ("newest", "all"), "'newest' or 'all'"),
    "nth": (lambda value: _is_count(value, 1), "a whole number from 1"),
    "pulse_every": (_is_amount, "a number of seconds from 0"),
}
_OF_DEVICES: Final[dict[str, _Setting]] = {
    "every": (_is_count, "a whole number of frames from 0"),
    "rate": (_is_amount, "a number of events per second from 0"),
}
