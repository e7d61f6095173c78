"""What a former process of a region has run: the frames that the next process repeats first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from minerva_bus.frame import messages as m
from minerva_bus.runtime.region_links import ParcelArrived


@dataclass(slots=True)
class RegionPast:
    """The `entries` of the journal that are left to repeat; None before the region has joined.

    What arrives too `early` waits until all frames have been repeated.
    """

    entries: Iterator[ParcelArrived] | None = None
    early: list[ParcelArrived | m.RegionRequest] = field(
        default_factory=list[ParcelArrived | m.RegionRequest]
    )
