"""Checks of the attributes of a service that its member reads: names, numbers and choices."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Final, TypeAlias, cast

from minerva_bus.errors import MisuseError
from minerva_bus.world.services import Device, Generator, Service, read_when
from minerva_bus.world.when import Participation, When, objection


def check_attributes(service: Service) -> When:
    """When a service takes part in frames, after a check of all attributes that its member reads.

    A constructor may overwrite them by accident, for example with an option of this name.

    Raises MisuseError for one that is not what the member expects.
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
    return when_of(service)


def when_of(service: Service) -> When:
    """When a service takes part in frames; a generator is in step unless it says otherwise.

    Raises MisuseError if it cannot take part at these times.
    """
    cls, generates = type(service), isinstance(service, Generator)
    when = read_when(cls, service.when)
    if generates and not when.asked:
        when = replace(when, asked=Participation.IN_STEP)
    if when.asked and not generates:
        raise MisuseError(f'{cls.__name__}: when = "{when}" is for generators, and it is a device')
    reason = objection(
        when,
        draws=isinstance(service, Device) and bool(service.draws),
        generates=generates,
        topics=bool(service.topics),
        publishes=bool(service.publishes),
        orders=isinstance(service, Generator) and bool(service.takes_orders()),
    )
    if reason:
        raise MisuseError(f"{cls.__name__}: {reason}")
    return when


def _check_settings(service: Service) -> None:
    for name, (is_valid, expected) in _OF_SERVICES.items():
        value = getattr(service, name)
        if not is_valid(value):
            problem = f"{type(service).__name__}: self.{name} must be {expected}, not {value!r:.60}"
            raise MisuseError(problem)


def _is_positive(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _is_amount(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and value >= 0


_Setting: TypeAlias = tuple[Callable[[Any], bool], str]

_OF_SERVICES: Final[dict[str, _Setting]] = {
    "takes": (lambda value: value in ("newest", "all"), "'newest' or 'all'"),
    "nth": (_is_positive, "a whole number from 1"),
    "pulse_every": (_is_amount, "a number of seconds from 0"),
    "when": (lambda value: isinstance(value, str), 'a text such as "freely"'),
}
