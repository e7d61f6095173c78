"""What a service's methods return, in whichever form its author writes it.

`generate` gives events, one event or None. `save` gives any plain value: on the bus and in records
it is always a mapping, so any other value travels as the only entry of one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, cast

from minerva_bus.blame import blamed
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.symbols import EventType
from minerva_bus.world.services import Service

VALUE: Final = "="
"""The name under which a value that is no mapping travels."""

NOTHING: Final[Mapping[str, Any]] = {VALUE: None}
"""What is kept of a member that saves nothing any more, instead of what it saved before."""


def made_events(made: Any) -> Iterator[AnyEvent]:
    """The events of what `generate` returned: None, an event, or an iterable of both.

    Raises TypeError.
    """
    if made is None:
        return
    if isinstance(made, Event | Events):
        yield made
        return
    if not isinstance(made, Iterable):
        raise TypeError(f"it makes events, one event or None, not {_named(made)}")
    for item in cast("Iterable[object]", made):
        if item is not None:
            if not isinstance(item, Event | Events):
                raise TypeError(f"it makes events, not {_named(item)}")
            yield item


def _named(made: object) -> str:
    if isinstance(made, EventType):
        return f"the event type {made.name}; an event is {made.name}(...)"
    return f"{made!r:.100}"


def saved_by(service: Service) -> Mapping[str, Any] | None:
    """What a service saves, as it travels. Raises UserCodeError for what is no plain value."""
    with blamed(service.save):
        saved: Any = service.save()
        _check_plain(saved, "it")
    if saved is None:
        return None
    if isinstance(saved, Mapping):
        names = cast("Mapping[str, Any]", saved)
        return {VALUE: names} if set(names) == {VALUE} else names
    return {VALUE: saved}


def restore(service: Service, saved: Mapping[str, Any]) -> None:
    """Give a service what its predecessor saved, if that is anything. Raises UserCodeError."""
    value: Any = saved[VALUE] if set(saved) == {VALUE} else saved
    if value is None:
        return
    with blamed(service.restore):
        service.restore(value)


def _check_plain(value: Any, where: str) -> None:
    """Whether a value can travel and be recorded. Raises MisuseError."""
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return
    if isinstance(value, list | tuple):
        for place, item in enumerate(cast("Iterable[Any]", value)):
            _check_plain(item, f"{where}[{place}]")
        return
    if isinstance(value, Mapping):
        for key, item in cast("Mapping[object, Any]", value).items():
            if not isinstance(key, str):
                raise MisuseError(f"{where} has the key {key!r:.60}; keys are texts")
            _check_plain(item, f"{where}[{key!r}]")
        return
    raise MisuseError(
        f"{where} is of type {type(value).__name__}; what is saved is None, a boolean, a number,"
        " a text, bytes, or a list or mapping of these"
    )
