"""All that the keys or buttons of one device give, made ready for a world when it is joined."""

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
class Range:
    """The numbers that can be given: from `low`, by `step`, to `high`."""

    low: float
    high: float
    step: float

    def check(self, service: str) -> None:
        """Raises MisuseError where there are no such numbers."""
        if not all(map(math.isfinite, (self.low, self.high, self.step))):
            raise MisuseError(f"{service}: low, high and step must be finite numbers")
        if self.low >= self.high or self.step <= 0:
            raise MisuseError(f"{service}: low must be below high, and step above 0")

    def bounded(self, value: float) -> float:
        """The number itself, or the bound that it is beyond."""
        return round(min(max(value, self.low), self.high), 9)

    def nearest(self, value: float) -> float:
        """The nearest of these numbers, in whole steps from 0."""
        return self.bounded(round(value / self.step) * self.step)


class Wiring:
    """Bindings by the names of keys or buttons, and a type whose only datum is a real number.

    `slide` is the name of that type; empty where there is none.
    """

    def __init__(self, service: str, bindings: Mapping[str, Binding], slide: str, to: str) -> None:
        self._service = service
        self._bindings = bindings
        self._slide = slide
        self._to = tuple(sorted({one.strip() for one in to.split(",") if one.strip()}))
        self._events: dict[str, Event] = {}

    def generates(self) -> tuple[str, ...]:
        """The event types that can come of it."""
        types = {one.type for one in self._bindings.values()} | {self._slide}
        return tuple(sorted(types - {""}))

    def joined(self, world: WorldInfo) -> None:
        """Make the events of a world. Raises MisuseError where they do not fit it."""
        service, to = self._service, self._to
        self._events = {name: one.event(service, world, to) for name, one in self._bindings.items()}
        if self._slide:
            self._sliding = event_type(service, world, self._slide)
            only_datum(service, self._sliding, "real")

    def pressed(self, name: str) -> Event | None:
        """What a key or button gives, if anything."""
        return self._events.get(name)

    def slid(self, value: float) -> Event:
        """The event with this number."""
        made: Event = self._sliding(value, receivers=self._to)
        return made

    def told(self) -> list[str]:
        """What each key or button gives, for people."""
        return [f"{name} {one}" for name, one in self._bindings.items()]
