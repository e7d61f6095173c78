"""gObjective and gSpeed of Table 4: orders of people, as events."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.event_factory import event_type


class Orders(Generator, when="on orders"):
    """Forwards orders of one event type, optionally with an initial order of its own.

    Args:
        event: the event type.
        first: data of an event in frame 0, for all agents that respond to its type, unless its
          `receivers` name agents.

    """

    def __init__(self, event: str, first: Mapping[str, Any] | None = None) -> None:
        self._type = event
        self._data = first
        self._first: tuple[AnyEvent, ...] = ()

    def generates(self) -> tuple[str, ...]:
        return (self._type,)

    def takes_orders(self) -> tuple[str, ...]:
        return (self._type,)

    def check(self, world: WorldInfo) -> None:
        declared = event_type("orders", world, self._type)
        if self._data is None:
            return
        try:
            self._first = (declared(**self._data),)
        except MisuseError as error:
            raise MisuseError(f"orders: first does not fit {self._type}: {error}") from None

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        return (*self._first, *tick.orders) if tick.number == 0 else tick.orders
