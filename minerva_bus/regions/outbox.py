"""Parcels that a region keeps until their receivers have them, so that it can send them again."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.regions.parcel import Parcel


class Outbox:
    """The last parcels for each other region; at most two, because none is further ahead.

    A parcel of frame t from a region shows that it has all parcels of earlier frames, because it
    could not begin frame t without them. No other acknowledgement is needed.
    """

    def __init__(self) -> None:
        self._kept: dict[int, list[Parcel]] = {}

    def keep(self, parcels: Iterable[Parcel]) -> None:
        """Keep the parcels of a frame."""
        for parcel in parcels:
            self._kept.setdefault(parcel.target, []).append(parcel)

    def acknowledge(self, received: Parcel) -> None:
        """Drop the parcels that the sender of a received parcel has."""
        kept = self._kept.get(received.source, ())
        self._kept[received.source] = [each for each in kept if each.frame >= received.frame]

    def kept_for(self, region: int) -> tuple[Parcel, ...]:
        """The parcels that a region may not have, in the order of their frames."""
        return tuple(self._kept.get(region, ()))
