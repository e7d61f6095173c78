"""The last orders of all people with their fates, as windows and pages show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.world.operator import Operator, OrderStatus
from minerva_services.views.palette import person_colour

SOMEBODY: Final = "somebody"
"""A person without a name."""

_LONG = 44


def _cut(text: str) -> str:
    return text if len(text) <= _LONG else f"{text[: _LONG - 1]}…"


@dataclass(frozen=True, slots=True)
class OrderEntry:
    """An order with the colour of its person, `#rrggbb`, and its fate in words."""

    person: str
    colour: str
    event: str
    state: str
    fate: str

    @classmethod
    def of(cls, order: OrderStatus) -> OrderEntry:
        """The entry of an order."""
        person = order.person or SOMEBODY
        return cls(person, person_colour(person), order.event, order.state, order.fate)

    @property
    def short(self) -> tuple[str, str]:
        """The texts of the order and of its fate, cut off if they are long."""
        return _cut(self.event), _cut(self.fate)


def shown_person(name: str) -> dict[str, str]:
    """A person by name, as a JSON object."""
    return {"name": name, "colour": person_colour(name)}


class LatestOrders:
    """The orders of all people whose fates have changed last.

    Args:
        most: how many to keep.

    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._last_change = 0
        self._entries: dict[int, OrderEntry] = {}

    @property
    def entries(self) -> tuple[OrderEntry, ...]:
        """The orders, the last change last."""
        return tuple(self._entries.values())

    def plain(self) -> list[dict[str, Any]]:
        """The orders as JSON objects."""
        return [
            {
                "number": number,
                "person": entry.person,
                "colour": entry.colour,
                "event": entry.event,
                "state": entry.state,
                "fate": entry.fate,
            }
            for number, entry in self._entries.items()
        ]

    def update(self, operator: Operator) -> bool:
        """Ask for changes; returns whether there are any. Raises BusError and MisuseError."""
        changed = operator.orders(self._last_change)
        for order in changed:
            self._last_change = order.change
            self._entries.pop(order.number, None)
            self._entries[order.number] = OrderEntry.of(order)
        while len(self._entries) > self._most:
            del self._entries[next(iter(self._entries))]
        return bool(changed)
