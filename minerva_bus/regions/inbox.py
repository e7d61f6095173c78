"""Parcels that have arrived for a region's frames, in any order and more than once."""

from __future__ import annotations

from minerva_bus.regions.parcel import Parcel


class ParcelInbox:
    """The parcels for frames that have not been entered.

    `entered` is the number of the first such frame. A parcel of frame t is for frame t+1.
    """

    def __init__(self, entered: int) -> None:
        self.entered = entered
        self._parcels: dict[int, dict[int, Parcel]] = {}

    def add(self, parcel: Parcel) -> bool:
        """Keep a parcel; returns False if it has arrived before."""
        if parcel.frame + 1 < self.entered or parcel.source in self.sources(parcel.frame):
            return False
        self._parcels.setdefault(parcel.frame, {})[parcel.source] = parcel
        return True

    def sources(self, frame: int) -> frozenset[int]:
        """The regions whose parcels of a frame have arrived."""
        return frozenset(self._parcels.get(frame, ()))

    def enter(self, frame: int) -> list[Parcel]:
        """Remove and return the parcels with which a frame begins, in the order of regions."""
        arrived = self._parcels.pop(frame - 1)
        self.entered = frame + 1
        return [parcel for _, parcel in sorted(arrived.items())]

    @property
    def kept(self) -> list[Parcel]:
        """The parcels, in the order of their arrival within a frame."""
        return [parcel for arrived in self._parcels.values() for parcel in arrived.values()]
