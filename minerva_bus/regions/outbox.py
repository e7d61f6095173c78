"""Messages that a region keeps until their receivers have them, to send them again."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.regions.attached import Replies
from minerva_bus.regions.parcel import Parcel


class Outbox:
    """The last messages for each other region.

    They are of at most three frames, because no region is further ahead.

    A parcel of frame t from a region shows that the coordinator has requested frame t, hence that
    it has that region's report of frame t-1, with everything that the region needed until then. A
    process on another machine can continue from there. No other acknowledgement is needed. The
    latest parcel is always among the messages: repeated, it shows that this region waits.
    """

    def __init__(self) -> None:
        self._kept: dict[int, list[Parcel | Replies]] = {}
        self._acknowledged: dict[int, int] = {}

    def keep(self, messages: Iterable[Parcel | Replies]) -> None:
        """Keep the parcels of a frame, or the replies of services."""
        for message in messages:
            self._kept[message.target] = [*self._needed(message.target), message]

    def acknowledge(self, received: Parcel) -> None:
        """Drop what the sender of a received parcel does not need any more."""
        region = received.source
        self._acknowledged[region] = max(received.frame, self._acknowledged.get(region, -1))
        self._kept[region] = self._needed(region)

    def _needed(self, region: int) -> list[Parcel | Replies]:
        acknowledged = self._acknowledged.get(region, -1)
        return [each for each in self._kept.get(region, ()) if each.needed_in >= acknowledged]

    def kept_for(self, region: int) -> tuple[Parcel | Replies, ...]:
        """The messages that a region may not have, in the order of their frames."""
        return tuple(self._kept.get(region, ()))
