"""Collision events (eCollision, section 5) in one format for all services that detect collisions.

A world's event type declares the subset of the data that its agents need. An agent cannot tell
whether a physics world stopped it or the scene's geometry shows an overlap.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple
from typing import Any, Final

from minerva_bus.grammar.events import Event, Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.types import Metres
from minerva_bus.values import fast_dataclass
from minerva_bus.world.services import WorldInfo
from minerva_services.event_factory import EventFactory, event_type


@fast_dataclass
class Collision:
    """A contact, from the point of view of one agent.

    Attributes:
        shortfall: metres of its last move that were not driven; 0 where nothing stops moves.
        other: the agent that is touched; "" for scenery.
        what: the primitive that is touched.
        x: position of the contact in metres.
        y: likewise.
        nx: unit normal, pointing from the other to the agent.
        ny: likewise.
        depth: overlap in metres; 0 where moves are stopped before.
        begins: whether they did not touch in the previous frame or view.

    """

    shortfall: float = 0.0
    other: str = ""
    what: str = ""
    x: float = 0.0
    y: float = 0.0
    nx: float = 0.0
    ny: float = 0.0
    depth: float = 0.0
    begins: bool = True


_DATA: Final[Mapping[str, Any]] = {
    "shortfall": Metres,
    "other": str,
    "what": str,
    "x": Metres,
    "y": Metres,
    "nx": float,
    "ny": float,
    "depth": Metres,
    "begins": bool,
}


class CollisionEvents:
    """Creates collision events of the type that a world declares."""

    def __init__(self, service: str, world: WorldInfo, name: str, *needed: str) -> None:
        """`needed` are data that the world's type must declare.

        Raises MisuseError if the world has no such type, or its data differ.
        """
        self._type = event_type(service, world, name)
        declared = self._type.fields.names
        # Needed data count even where the type lacks them: the factory then reports what is
        # missing.
        self._wanted = [key for key in _DATA if key in declared or key in needed]
        data = {key: _DATA[key] for key in self._wanted}
        self._factory = EventFactory(service, world, name, **data)

    def event(self, collision: Collision, receiver: str) -> Event:
        """The event for one agent."""
        values = dict(zip(_DATA, astuple(collision), strict=True))
        return self._factory(*(values[key] for key in self._wanted), receivers=(receiver,))

    def events(self, data: Mapping[str, Any], receivers: Ids) -> Events:
        """Events for many agents: arrays of shape (n,), or one value for all."""
        return self._type(receivers=receivers, **{key: data[key] for key in self._wanted})
