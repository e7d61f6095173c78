"""What the agents of one region send across borders in a world with a lag counts later."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.description import World
from minerva_bus.frame.inbox import FrameInbox
from minerva_bus.frame.lag import Homes, homes_at, saved_homes, saved_strays
from minerva_bus.grammar.scene import Scene
from minerva_bus.regions.merging import PlacedEvent, in_order
from minerva_bus.regions.parcel import Parcel


class PostponedEvents:
    """Divides and queues the events of a region by the lag of its world; without one, none wait."""

    def __init__(self, world: World, own: Scene) -> None:
        """`own` is the region's string in the first frame, and `world` as of this frame."""
        self._lag = world.lag
        self._homes = Homes(own, saved_strays(world.past.saved))

    def enter(self, frame: int, string: Composition) -> None:
        """Note the region's string with which a frame begins."""
        self._homes = homes_at(self._lag, frame, self._homes, string)

    def saved(self, frame: int, string: Composition) -> dict[str, dict[str, int]]:
        """Where agents are at home in the frame that begins, as saved data of a checkpoint."""
        return saved_homes(self._lag, frame, self._homes, string)

    def queue(self, inbox: FrameInbox, sent: Mapping[int, Sequence[Parcel]]) -> None:
        """Queue the events that all regions have postponed in these frames."""
        if self._lag is None:
            return
        for frame, parcels in sent.items():
            events = in_order(event for each in parcels for event in each.postponed)
            inbox.postpone(frame + 1 + self._lag.frames, events)

    def crossing(self, sent: Sequence[PlacedEvent]) -> Sequence[NDArray[np.bool_]]:
        """For each event, or batch, of a frame, which of its rows wait."""
        if self._lag is None or not sent:
            return [np.zeros(len(each.places), np.bool_) for each in sent]
        return self._lag.crossing([each.event for each in sent], self._homes)

    def divided(
        self, sent: Sequence[PlacedEvent]
    ) -> tuple[Sequence[PlacedEvent], Sequence[PlacedEvent]]:
        """What agents have sent in a frame: events for the next one, and those that wait."""
        if self._lag is None or not sent:
            return sent, ()
        rows = [*zip(sent, self.crossing(sent), strict=True)]
        near = [each.take(np.flatnonzero(~crosses)) for each, crosses in rows]
        late = [each.take(np.flatnonzero(crosses)) for each, crosses in rows]
        return [each for each in near if each.places], [each for each in late if each.places]
