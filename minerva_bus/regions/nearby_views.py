"""The views of services with a halo, from the figures of the regions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from minerva_bus.frame import messages as m
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.grammar.slots import fill
from minerva_bus.regions.halo import scenery_of
from minerva_bus.regions.halo_part import NO_HALO, Figures, HaloPart
from minerva_bus.regions.kept import texts_of
from minerva_bus.regions.merging import Units, merged
from minerva_bus.regions.showing import NOBODY, figures_of, showing, within
from minerva_bus.world.halo import AGENTS, Halo, OwnFigures


class NearbyViews:
    """What the services of a region see: its agents, and those of others near its cell.

    `frame` is that of the latest views, -1 before any. `own` are the agents of the region for which
    services answer; None if no view shows any. `kept_of_all` is what services had saved of all
    agents, until a run that continues has views of its own.
    """

    def __init__(
        self,
        number: int,
        halos: Mapping[str, Halo],
        last: Sequence[m.ViewShown],
        own: Units | None,
        kept: Mapping[str, str],
    ) -> None:
        """`halos` are those of the services, by visual event type.

        `last` are the last views of a run that continues, with the region's `own` part, and `kept`
        is what services had saved of all agents then.
        """
        self.frame: int = -1
        self._number, self._halos = number, halos
        self._unseen = [view for view in last if view.event_type in halos]
        self._sequence = max([view.sequence for view in self._unseen], default=0)
        # Views that no region has divided show all agents; those of this region are its own.
        self.own = within(own) if own is not None and self._unseen else None
        self._scenery: dict[int, dict[str, Units]] = {}
        self._shown: Mapping[int, HaloPart] = {}
        self.kept_of_all: Mapping[str, str] = kept if self._unseen else {}

    def take(self, frame: int, parts: Mapping[int, HaloPart]) -> None:
        """Assemble the views of a frame from what each region shows."""
        self.frame, self._shown = frame, parts
        shown = {source: part.figures for source, part in parts.items()}
        for source, figures in shown.items():
            changed = {name: of for name, of in figures.items() if name not in self._halos}
            self._scenery.setdefault(source, {}).update(changed)
        own = shown.get(self._number, {})
        # A process may continue from a frame in which no view was due, with the scenery alone.
        if own.keys().isdisjoint(self._halos):
            self.own = self.own if self._unseen else None
            return
        self.own = showing(own, self._halos)
        self.kept_of_all = {}
        halted = tuple(sorted({who for part in parts.values() for who in part.halted}))
        self._unseen = [*self._assembled(shown, own.keys() & self._halos.keys(), halted)]

    def _assembled(
        self, shown: Mapping[int, Figures], event_types: Collection[str], halted: tuple[str, ...]
    ) -> Iterator[m.ViewShown]:
        scenery = [of for _, of in sorted(self._scenery.items())]
        for event_type in sorted(event_types):
            parts = [of[event_type] for _, of in sorted(shown.items()) if event_type in of]
            name = scenery_of(event_type)
            parts += [of[name] for of in scenery if name in of]
            self._sequence += 1
            scene = merged(parts).scene
            yield m.ViewShown(event_type, self.frame, self._sequence, {}, scene, halted=halted)

    def unseen(self, event_types: Collection[str]) -> Iterator[tuple[m.ViewShown, OwnFigures]]:
        """The views of these types that no service has seen, with the figures to answer for."""
        for view in self._unseen:
            if view.event_type in event_types:
                yield view, self._own_figures(view)

    def kept(self, service: str) -> dict[str, str]:
        """What a service had saved, by agent, before it sees these views; as far as is known."""
        texts: dict[str, str] = {}
        for kept in (self.kept_of_all, *(part.kept for part in self._shown.values())):
            texts |= texts_of({AGENTS: kept.get(service, "")})
        return texts

    def all_seen(self) -> None:
        """Note that the services have seen their views."""
        self._unseen = []

    def _own_figures(self, view: m.ViewShown) -> OwnFigures:
        own = self.own or NOBODY
        if view.event_type in own.figures:
            return own.figures[view.event_type]
        # A view of all agents, by which a run continues.
        scene = fill(view.skeleton or EMPTY, view.parts)
        every = figures_of(scene.pieces, self._halos[view.event_type])
        rows = np.flatnonzero(own.ids.rows_of(every.ids) >= 0)
        return OwnFigures(every.ids.take(rows), every.x[rows], every.y[rows])

    @property
    def latest(self) -> Mapping[int, Mapping[int, HaloPart]]:
        """The latest figures by frame and region: `take` continues with them elsewhere."""
        shown = self._shown
        sources = shown.keys() | self._scenery.keys()
        parts = {source: shown.get(source, NO_HALO) for source in sorted(sources)}
        whole = {
            source: replace(part, figures={**self._scenery.get(source, {}), **part.figures})
            for source, part in parts.items()
        }
        return {self.frame: whole} if whole else {}
