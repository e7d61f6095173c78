"""Lag between the regions of a partition: which events cross a border.

An event crosses if it may be for an agent of another region than that of its sender, by the homes
of both. Only the region of the sender then has to know who is where. A receiver that was not in the
string when agents could last move, because it was not born yet, is elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.lag import NOWHERE, Homes
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.regions.partition import Partition, regions_of
from minerva_bus.regions.reach import reach_of


@dataclass(frozen=True, slots=True)
class RegionLag:
    """Events across borders of a partition, whose borders do not move, count `frames` later.

    Agents change regions before the frames that are multiples of `every`.
    """

    frames: int
    partition: Partition
    every: int = 1

    def crossing(self, sent: Sequence[AnyEvent], homes: Homes) -> list[NDArray[np.bool_]]:
        """For each event, or batch, which of its rows cross a border.

        `homes` may be those of the agents in the region of the senders only.
        """
        reach, regions = reach_of(self.partition), _Regions(self.partition, homes)

        def crosses(event: AnyEvent) -> NDArray[np.bool_]:
            if isinstance(event, Event):
                own, receivers = regions.of(Ids.of([event.sender])), event.receivers
                to = regions.of(Ids.of(receivers)) if receivers else _only(reach(event.condition))
                return np.array([_apart(own, to).any()])
            assert event.senders is not None  # Agents send in their own name.
            own, to = regions.of(event.senders), _only(reach(event.condition))
            return _apart(own, to if event.receivers is None else regions.of(event.receivers))

        return [crosses(event) for event in sent]

    def strays(self, homes: Homes, scene: Scene) -> dict[str, int]:
        """The agents of homes and a later string whose home is not where they are, with it."""
        at_home, now = _Regions(self.partition, homes), _Regions(self.partition, Homes(scene))
        return {**at_home.unlike(now), **now.unlike(at_home, of_other=True)}


def _apart(homes: NDArray[np.intp], others: NDArray[np.intp]) -> NDArray[np.bool_]:
    # Two agents born since agents could last move need not be in the same region.
    return (homes != others) | (homes == NOWHERE)


def _only(reached: Sequence[int]) -> NDArray[np.intp]:
    """The region that an event without receivers reaches; `NOWHERE` if it is not the only one."""
    return np.array([reached[0] if len(reached) == 1 else NOWHERE])


class _Regions:
    """The homes of agents by id."""

    def __init__(self, partition: Partition, homes: Homes) -> None:
        self._known: list[tuple[Ids, NDArray[np.intp]]] = []
        single: dict[str, int] = {}
        for piece in homes.scene.pieces:
            regions = regions_of(partition, piece)
            if regions is None:
                continue
            if piece.ids is not None:
                self._known.append((piece.ids, regions))
            else:  # All agents of a transformation move with its first one.
                names = (agent.id for agent in agents(Scene((piece,))))
                single |= dict.fromkeys(names, int(regions[0]))
        single |= homes.strays
        if single:
            self._known.append((Ids.of([*single]), np.array([*single.values()], np.intp)))

    def of(self, ids: Ids) -> NDArray[np.intp]:
        """The home of each of these agents, shape (n,), or `NOWHERE`."""
        made = np.full(len(ids), NOWHERE, np.intp)
        for known, regions in self._known:
            rows = known.rows_of(ids)
            made[rows >= 0] = regions[rows[rows >= 0]]
        return made

    def unlike(self, other: _Regions, *, of_other: bool = False) -> dict[str, int]:
        """The agents known here whose home is another one there, with their home here, or there."""
        unlike: dict[str, int] = {}
        for ids, _ in self._known:
            homes, others = self.of(ids), other.of(ids)
            rows = np.flatnonzero(homes != others)
            to = (others if of_other else homes)[rows].tolist()
            unlike |= dict(zip(ids.take(rows).texts(), to, strict=True))
        return unlike
