"""People and their orders, as pages show them: JSON objects with the colour of the person."""

from __future__ import annotations

from typing import Any

from minerva_bus.world.operator import OrderStatus
from minerva_services.views.palette import person_colour


def shown_person(name: str) -> dict[str, str]:
    """A person by name."""
    return {"name": name, "colour": person_colour(name)}


def shown_order(order: OrderStatus) -> dict[str, Any]:
    """An order with its fate."""
    person = order.person or "somebody"
    return {
        "number": order.number,
        "person": person,
        "colour": person_colour(person),
        "event": order.event,
        "state": order.state,
        "fate": order.fate,
    }
