"""What an agent is told of a collision, whoever finds it: the data of eCollision (section 5).

A world's event type has those of them that its agents want. So an agent cannot tell whether a
physics world has stopped it, or a look at the scene's geometry has found it to touch something.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import Any, Final

from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.types import Metres
from minerva_bus.world.services import WorldInfo
from minerva_services.making import Maker, event_type


@dataclass(frozen=True, slots=True)
class Collision:
    """An agent touches something, as that agent sees it.

    Attributes:
        shortfall: metres of its last move that were not driven; 0 where nothing stops moves.
        other: the agent that is touched; "" for scenery.
        what: the primitive that is touched.
        x: metres, where.
        y: metres.
        nx: of the normal, which has length 1 and points from the other to the agent.
        ny: likewise.
        depth: metres by which the two overlap; 0 where moves are stopped before.
        begins: whether they did not touch in the frame, or view, before.

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


class Teller:
    """Makes collisions of the event type that a world has for them."""

    def __init__(self, service: str, world: WorldInfo, name: str, *needed: str) -> None:
        """`needed` are data that the world's type must have.

        Raises MisuseError where the world has no such type, or it has other data.
        """
        self._type = event_type(service, world, name)
        declared = self._type.fields.names
        self._wanted = [one for one in _DATA if one in declared or one in needed]
        data = {one: _DATA[one] for one in self._wanted}
        self._maker = Maker(service, world, name, **data)

    def one(self, collision: Collision, receiver: str) -> Event:
        """The event that tells one agent."""
        values = dict(zip(_DATA, astuple(collision), strict=True))
        return self._maker(*(values[one] for one in self._wanted), receivers=(receiver,))

    def many(self, data: Mapping[str, Any], receivers: Ids) -> Events:
        """The events that tell many agents: arrays of shape (n,), or one value for all."""
        return self._type(receivers=receivers, **{one: data[one] for one in self._wanted})
