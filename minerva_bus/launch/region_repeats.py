"""What repeated parcels show: who lacks those of this region, and who never sends a valid one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import Final

from minerva_bus.errors import WorldStopped
from minerva_bus.regions.attached import Replies
from minerva_bus.regions.parcel import Parcel

MAX_SECONDS: Final = 30
"""Seconds in which a region may repeat earlier parcels instead of sending a needed one."""


class RegionRepeats:
    """The regions that have sent parcels which had arrived before.

    A region repeats its parcels while it waits, so it may lack one that was lost or not accepted.
    """

    def __init__(self) -> None:
        self._latest: dict[int, int] = {}
        self._seconds: Counter[int] = Counter()

    def note(self, repeated: Parcel | Replies) -> None:
        """Note a message that had arrived before."""
        # A region repeats several frames, and only the latest shows how far it is.
        source = repeated.source
        self._latest[source] = max(repeated.frame, self._latest.get(source, repeated.frame))

    def a_second_later(self, awaited: Collection[int], frame: int) -> list[int]:
        """The regions to send parcels to again; `awaited` are those needed for `frame`.

        Raises WorldStopped for a region that repeats itself and never sends what is needed: without
        that this region would wait for ever.
        """
        self._seconds.update(self._latest.keys() & set(awaited))
        # Its own next parcel would have acknowledged the last one of this region.
        lacking = [region for region, latest in self._latest.items() if latest < frame - 1]
        again = sorted({*lacking, *awaited})
        self._latest = {}
        for region, seconds in sorted(self._seconds.items()):
            if seconds > MAX_SECONDS:
                raise WorldStopped(
                    f"region {region} has sent no valid parcel for frame {frame}, but has repeated"
                    f" earlier ones for {MAX_SECONDS} s"
                )
        return again

    def clear(self) -> None:
        """A frame has begun: all that it needed has arrived."""
        self._seconds.clear()
