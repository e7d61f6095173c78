"""Services of worlds in Python: their classes or installed names, with options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from minerva_bus.arguments import text
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.symbols import EventType
from minerva_bus.world.services import Service

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, slots=True)
class ServiceSpec:
    """A generator or device of a world: its class or installed name, and its options."""

    service: str | type[Service]
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    name: str = ""


def service(service: str | type[Service], name: str = "", **options: Any) -> ServiceSpec:
    """A generator or device for `World(services=[...])`.

    Args:
        service: an installed name, such as "neighbours", or a class.
        name: of its process; default: that of the service.
        options: arguments of its constructor. An event type is replaced by its name.

    Example:
        `service("neighbours", radius=2.0, event=eNear)`

    """
    plain = {key: plain_setting(value) for key, value in options.items()}
    return ServiceSpec(service, plain, name)


def each(event: EventType | str, every: int = 1, name: str = "") -> ServiceSpec:
    """A generator of one event without data, in each `every`-th frame, beginning with frame 0.

    Raises MisuseError if it has data.

    Example:
        `World(..., services=[each(eDay), each(eRain, every=7)])`

    """
    if isinstance(event, Event):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(
            f"each({event}): expected an event type, such as each({event.type}); its data are the"
            f" defaults of the type: EventType({event.type!r}, amount=Default(float, 0.5))"
        )
    event_type = text("event", plain_setting(event))
    return ServiceSpec("each", {"event": event_type, "every": every}, name or event_type)


def plain_setting(value: Any) -> Any:
    """A setting or option as in a world file: event types by their names, paths as texts."""
    if isinstance(value, EventType):
        return value.name
    if isinstance(value, list | tuple):
        return [plain_setting(item) for item in cast("list[Any]", value)]
    if isinstance(value, Path):
        return str(value)
    return value
