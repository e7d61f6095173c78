"""Parcels: what one region sends to another after a frame."""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.regions.halo_part import NO_HALO, HaloPart
from minerva_bus.regions.merging import PlacedEvent, Units
from minerva_bus.regions.norms import NO_NORMS, NormPart
from minerva_bus.regions.views import NO_VIEWS, ViewPart


@dataclass(frozen=True, slots=True)
class Parcel:
    """The message of one region to another after a frame; empty ones are not sent.

    `units` become part of the receiver's string, and `events` belong to the next frame and
    `postponed` ones, with a lag, to a later one, unless the world ends before. `views` are only for
    the region of attached services. `halo` has the figures near the receiver's cell; in the parcel
    of a region to itself all of its agents' figures.
    """

    frame: int
    source: int
    target: int
    units: Units
    events: tuple[PlacedEvent, ...]
    views: ViewPart = NO_VIEWS
    norms: NormPart = NO_NORMS
    postponed: tuple[PlacedEvent, ...] = ()
    halo: HaloPart = NO_HALO

    def __bool__(self) -> bool:
        """Whether it is not empty."""
        has_events = bool(self.events or self.postponed)
        return bool(self.units or has_events or self.norms or self.views or self.halo)

    @property
    def for_next_frame(self) -> bool:
        """Whether it has more than postponed events."""
        return bool(self.units or self.events or self.norms or self.views or self.halo)

    @property
    def needed_in(self) -> int:
        """The frame that cannot begin without it."""
        return self.frame + 1
