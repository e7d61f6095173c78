"""Messages that a region keeps until their receivers have them, to send them again."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.regions.attached import Replies
from minerva_bus.regions.parcel import Parcel


class Outbox:
    """The last messages for each other region.

    They are of at most two frames, because no region is further ahead.

    A parcel of frame t from a region shows that it has everything that it needed in frame t. No
    other acknowledgement is needed.
    """

    def __init__(self) -> None:
        self._kept: dict[int, list[Parcel | Replies]] = {}

    def keep(self, messages: Iterable[Parcel | Replies]) -> None:
        """Keep the parcels of a frame, or the replies of services."""
        for message in messages:
            self._kept.setdefault(message.target, []).append(message)

    def acknowledge(self, received: Parcel) -> None:
        """Drop what the sender of a received parcel has."""
        kept = self._kept.get(received.source, ())
        self._kept[received.source] = [each for each in kept if each.needed_in > received.frame]

    def kept_for(self, region: int) -> tuple[Parcel | Replies, ...]:
        """The messages that a region may not have, in the order of their frames."""
        return tuple(self._kept.get(region, ()))
