"""Detects regions that repeat their parcels without ever sending a valid one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import Final

from minerva_bus.errors import WorldStopped
from minerva_bus.regions.attached import Replies
from minerva_bus.regions.parcel import Parcel

MAX_SECONDS: Final = 30
"""Seconds in which a region may repeat earlier parcels instead of sending a needed one.

A region that waits for another one itself, for as long as their link is cut, repeats none.
"""


class RegionRepeats:
    """The regions that have sent parcels which had arrived before, although others are needed."""

    def __init__(self) -> None:
        self._lately = set[int]()
        self._seconds: Counter[int] = Counter()

    def note(self, repeated: Parcel | Replies) -> None:
        """Note a message that had arrived before, and is older than what was requested."""
        self._lately.add(repeated.source)

    def a_second_later(self, awaited: Collection[int], frame: int) -> None:
        """Count a second in which regions are `awaited`, whose messages `frame` needs.

        Raises WorldStopped for a region that repeats itself and never sends what is needed: without
        that this region would wait for ever.
        """
        self._seconds.update(self._lately.intersection(awaited))
        self._lately.clear()
        for region, seconds in sorted(self._seconds.items()):
            if seconds > MAX_SECONDS:
                raise WorldStopped(
                    f"region {region} has sent no valid parcel for frame {frame}, but has repeated"
                    f" earlier ones for {MAX_SECONDS} s"
                )

    def clear(self) -> None:
        """A frame has begun: all that it needed has arrived."""
        self._seconds.clear()
