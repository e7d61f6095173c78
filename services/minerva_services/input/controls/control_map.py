"""The events of a device's keys and buttons, prepared when a world is joined."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import WorldInfo
from minerva_services.event_factory import event_type
from minerva_services.input.controls.binding import Binding, only_datum


@dataclass(frozen=True, slots=True)
class InputRange:
    """A range of numbers from `low` to `high` in steps of `step`."""

    low: float
    high: float
    step: float

    def check(self, service: str) -> None:
        """Raise MisuseError if the range is invalid."""
        if not all(map(math.isfinite, (self.low, self.high, self.step))):
            raise MisuseError(f"{service}: low, high and step must be finite numbers")
        if self.low >= self.high or self.step <= 0:
            raise MisuseError(f"{service}: low must be below high, and step above 0")

    def bounded(self, value: float) -> float:
        """The value, clamped to the range."""
        return round(min(max(value, self.low), self.high), 9)

    def nearest(self, value: float) -> float:
        """The nearest multiple of the step within the range."""
        return self.bounded(round(value / self.step) * self.step)


class ControlMap:
    """Bindings by key or button name, and an event type whose only datum is a real number.

    `slide` is the name of that type; empty if there is none.
    """

    def __init__(self, service: str, bindings: Mapping[str, Binding], slide: str, to: str) -> None:
        self._service = service
        self._bindings = bindings
        self._slide = slide
        self._to = tuple(sorted({id.strip() for id in to.split(",") if id.strip()}))
        self._events: dict[str, Event] = {}

    def generates(self) -> tuple[str, ...]:
        """The event types that this device can emit."""
        types = {binding.type for binding in self._bindings.values()} | {self._slide}
        return tuple(sorted(types - {""}))

    def joined(self, world: WorldInfo) -> None:
        """Create the events of a world. Raises MisuseError if they do not fit it."""
        service, to = self._service, self._to
        self._events = {
            name: binding.event(service, world, to) for name, binding in self._bindings.items()
        }
        if self._slide:
            self._sliding = event_type(service, world, self._slide)
            only_datum(service, self._sliding, "real")

    def pressed(self, name: str) -> Event | None:
        """The event of a key or button, if any."""
        return self._events.get(name)

    def slid(self, value: float) -> Event:
        """The event with this number."""
        made: Event = self._sliding(value, receivers=self._to)
        return made

    def descriptions(self) -> list[str]:
        """A line of help per key or button."""
        return [f"{name} {binding}" for name, binding in self._bindings.items()]
