"""Lag between the regions of a partition: which events cross a border.

An event crosses if it may be for an agent of another region than that of its sender, in the string
with which the frame began. Only the region of the sender then has to know who is where. A receiver
that is not in this string, because it is not born yet, is elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.regions.partition import Partition, regions_of
from minerva_bus.regions.reach import reach_of

ELSEWHERE: Final = -1


@dataclass(frozen=True, slots=True)
class RegionLag:
    """Events across borders of a partition, whose borders do not move, count `frames` later."""

    frames: int
    partition: Partition

    def crossing(self, sent: Sequence[AnyEvent], before: Scene) -> list[NDArray[np.bool_]]:
        """For each event, or batch, which of its rows cross a border.

        `before` is the string with which their frame began, or the part of it that is the region of
        their senders.
        """
        reach, regions = reach_of(self.partition), _Regions(self.partition, before)

        def crosses(event: AnyEvent) -> NDArray[np.bool_]:
            if isinstance(event, Event):
                own, receivers = regions.of(Ids.of([event.sender])), event.receivers
                to = regions.of(Ids.of(receivers)) if receivers else _only(reach(event.condition))
                return np.array([(to != own).any()])
            assert event.senders is not None  # Agents send in their own name.
            own, to = regions.of(event.senders), _only(reach(event.condition))
            return own != (to if event.receivers is None else regions.of(event.receivers))

        return [crosses(event) for event in sent]


def _only(reached: Sequence[int]) -> NDArray[np.intp]:
    """The region that an event without receivers reaches; `ELSEWHERE` if it is not the only one."""
    return np.array([reached[0] if len(reached) == 1 else ELSEWHERE])


class _Regions:
    """The regions of a string's agents by id."""

    def __init__(self, partition: Partition, scene: Scene) -> None:
        self._known: list[tuple[Ids, NDArray[np.intp]]] = []
        single: dict[str, int] = {}
        for piece in scene.pieces:
            regions = regions_of(partition, piece)
            if regions is None:
                continue
            if piece.ids is not None:
                self._known.append((piece.ids, regions))
            else:  # All agents of a transformation move with its first one.
                names = (agent.id for agent in agents(Scene((piece,))))
                single |= dict.fromkeys(names, int(regions[0]))
        if single:
            self._known.append((Ids.of([*single]), np.array([*single.values()], np.intp)))

    def of(self, ids: Ids) -> NDArray[np.intp]:
        """The region of each of these agents, shape (n,), or `ELSEWHERE`."""
        made = np.full(len(ids), ELSEWHERE, np.intp)
        for known, regions in self._known:
            rows = known.rows_of(ids)
            made[rows >= 0] = regions[rows[rows >= 0]]
        return made
