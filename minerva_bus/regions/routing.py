"""Routing: which regions need the events of a region's agents."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.regions.merging import PlacedEvent
from minerva_bus.regions.partition import Partition
from minerva_bus.regions.reach import reach_of

ELSEWHERE: Final = -1


class Routing:
    """Routes the events of one frame.

    An event without receivers goes to all regions, or to those where its condition can hold. One
    for an agent of this region stays here, or follows the agent. One for an agent that is elsewhere
    goes to all regions: only the region that has an agent can find it, and the agent may be on its
    way to this region. What goes to all regions is no parcel for each, but part of a report: see
    `for_all`.
    """

    def __init__(
        self,
        number: int,
        partition: Partition,
        composition: Composition,
        moving: Mapping[str, int],
    ) -> None:
        """`composition` includes the agents `moving`, which have the region to which they go."""
        self._number = number
        self._regions = range(partition.count)
        self._reach = reach_of(partition)
        self._composition = composition
        self._moving = moving
        self._moving_ids = Ids.of(list(moving)) if moving else None
        self._targets = np.array(list(moving.values()), np.intp)

    def route(
        self, placed: Iterable[PlacedEvent], *, late: bool = False
    ) -> dict[int, list[PlacedEvent]]:
        """The events for each region that gets some, in their order.

        `late`: they count some frames later, and their receivers may move until then.
        """
        routed = dict[int, list[PlacedEvent]]()
        for each in placed:
            event = each.event
            if isinstance(event, Events) and event.receivers is not None and not late:
                self._divide(each, event.receivers, routed)
                continue
            for region in self._regions_for(event, late=late):
                routed.setdefault(region, []).append(each)
        return routed

    def for_all(
        self, placed: Sequence[PlacedEvent]
    ) -> tuple[list[PlacedEvent], Sequence[PlacedEvent]]:
        """The events that all regions need, and the others.

        Events of one type and one sender stay together, because their order counts.
        """
        needed = [self._needed_by_all(each) for each in placed] if len(self._regions) > 1 else []
        if not any(rows.any() for rows in needed):
            return [], placed
        senders = {
            (each.event.type, each.places[row])
            for each, rows in zip(placed, needed, strict=True)
            for row in np.flatnonzero(rows).tolist()
        }
        together = [
            np.array([(each.event.type, place) in senders for place in each.places], np.bool_)
            for each in placed
        ]
        rows = [*zip(placed, together, strict=True)]
        common = [each.take(np.flatnonzero(of)) for each, of in rows if of.any()]
        others = [each.take(np.flatnonzero(~of)) for each, of in rows if not of.all()]
        return common, others

    def _needed_by_all(self, each: PlacedEvent) -> NDArray[np.bool_]:
        event = each.event
        if isinstance(event, Events) and event.receivers is not None:
            return self._homes(event.receivers) == ELSEWHERE
        regions = self._regions_for(event, late=False)
        return np.full(len(each.places), len(regions) == len(self._regions))

    def keep(self, placed: Iterable[PlacedEvent]) -> dict[int, list[PlacedEvent]]:
        """Events for agents that are here, or gone: all of them for this region."""
        return {self._number: [*placed]}

    def _regions_for(self, event: AnyEvent, *, late: bool) -> Collection[int]:
        if not event.receivers:
            return self._reach(event.condition)
        return self._regions if late else self._regions_of(event)

    def _regions_of(self, event: AnyEvent) -> set[int]:
        regions = set[int]()
        for receiver in event.receivers or ():
            if receiver in self._moving:
                regions.add(self._moving[receiver])
            elif self._composition.home(receiver) is not None:
                regions.add(self._number)
            else:
                regions.update(self._regions)
        return regions

    def _divide(
        self, batch: PlacedEvent, receivers: Ids, routed: dict[int, list[PlacedEvent]]
    ) -> None:
        homes = self._homes(receivers)
        present = {*np.unique(homes).tolist()}
        for region in self._regions if ELSEWHERE in present else sorted(present):
            rows = np.flatnonzero((homes == region) | (homes == ELSEWHERE))
            if len(rows):
                routed.setdefault(region, []).append(batch.take(rows))

    def _homes(self, receivers: Ids) -> NDArray[np.intp]:
        """The region of each receiver, shape (n,), or `ELSEWHERE`."""
        homes = np.full(len(receivers), ELSEWHERE, np.intp)
        homes[self._composition.kinds(receivers) != ""] = self._number
        if self._moving_ids is not None:
            rows = self._moving_ids.rows_of(receivers)
            homes[rows >= 0] = self._targets[rows[rows >= 0]]
        return homes
