"""Messages that a region keeps until their receivers have them, to send them again."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic, Protocol, TypeVar


class Sendable(Protocol):
    """A parcel, or replies of services, as they are or as bytes."""

    @property
    def target(self) -> int:
        """The region that receives it."""
        ...

    @property
    def needed_in(self) -> int:
        """The frame that cannot begin without it."""
        ...


K = TypeVar("K", bound=Sendable)


class Outbox(Generic[K]):
    """The last messages for each other region.

    They are of at most three frames, because no region is further ahead; see `acknowledge`.

    A request of the coordinator for frame t shows that it has the reports of frame t-1 of all
    regions, with everything that they needed until then. A process on another machine can continue
    from there. No other acknowledgement is needed.
    """

    def __init__(self) -> None:
        self._kept: dict[int, list[K]] = {}

    def keep(self, messages: Iterable[K]) -> None:
        """Keep the parcels of a frame, or the replies of services."""
        for message in messages:
            self._kept.setdefault(message.target, []).append(message)

    def acknowledge(self, frame: int) -> None:
        """Drop what no region needs any more when a frame has been requested.

        If regions run ahead, the frame is twice as many frames before it: the coordinator may lack
        as many reports, and their frames may need the parcels of as many earlier ones.
        """
        for region, kept in self._kept.items():
            self._kept[region] = [each for each in kept if each.needed_in >= frame]

    def kept_for(self, region: int) -> tuple[K, ...]:
        """The messages that a region may not have, in the order of their frames."""
        return tuple(self._kept.get(region, ()))
