"""Parcels: what one region sends to another after a frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from minerva_bus.regions.merging import PlacedEvent, Units
from minerva_bus.regions.norms import NO_NORMS, NormPart
from minerva_bus.regions.views import NO_VIEWS, ViewPart


@dataclass(frozen=True, slots=True)
class Progress:
    """What every region has to know of another one's frame to end the world in the same frame.

    `empty`: its string is ε. `resting`: its next frame would change nothing. `reached`: its agents
    that have sent `until` in this frame. `given_up`: those that have sent `give_up`, with the event
    as text, or "" after `until`. `striving`: the kinds of both. `left`: the number of its agents of
    each kind that have sent neither.
    """

    empty: bool
    resting: bool
    reached: frozenset[str]
    striving: frozenset[str]
    given_up: Mapping[str, str]
    left: Mapping[str, int]


NO_PROGRESS: Final = Progress(False, False, frozenset(), frozenset(), {}, {})


@dataclass(frozen=True, slots=True)
class Parcel:
    """The message of one region to another after a frame.

    `units` become part of the receiver's string, and `events` belong to the next frame, unless
    `frame` is the last one. `views` are only for the region of attached services.
    """

    frame: int
    source: int
    target: int
    units: Units
    events: tuple[PlacedEvent, ...]
    progress: Progress
    views: ViewPart = NO_VIEWS
    norms: NormPart = NO_NORMS

    @property
    def needed_in(self) -> int:
        """The frame that cannot begin without it."""
        return self.frame + 1
