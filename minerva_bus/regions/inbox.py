"""Parcels that have arrived for a region's frames, in any order and more than once."""

from __future__ import annotations

from minerva_bus.errors import ProtocolError
from minerva_bus.regions.parcel import Parcel


class ParcelInbox:
    """The parcels for frames that have not been entered.

    `entered` is the number of the first such frame. A parcel of frame t is for frame t+1.
    `expected` are the regions whose parcels the next frame needs.
    """

    def __init__(self, entered: int) -> None:
        self.entered = entered
        self.expected = frozenset[int]()
        self._parcels: dict[int, dict[int, Parcel]] = {}

    def add(self, parcel: Parcel) -> bool:
        """Keep a parcel; returns False if it has arrived before."""
        if parcel.frame + 1 < self.entered or parcel.source in self._of(parcel.frame):
            return False
        self._parcels.setdefault(parcel.frame, {})[parcel.source] = parcel
        return True

    def missing(self, frame: int) -> list[int]:
        """The regions whose parcels for a frame have not arrived."""
        return sorted(self.expected.difference(self._of(frame - 1)))

    def enter(self, frame: int) -> list[Parcel]:
        """Remove and return the parcels with which a frame begins, in the order of regions.

        Raises ProtocolError for one that its sender has not reported: it would count only here if
        it arrives in time.
        """
        arrived = self._parcels.pop(frame - 1, {})
        self.entered = frame + 1
        for source in sorted(arrived.keys() - self.expected):
            raise ProtocolError(
                f"region {source} has sent a parcel of frame {frame - 1} that it has not reported"
            )
        return [parcel for _, parcel in sorted(arrived.items())]

    @property
    def kept(self) -> list[Parcel]:
        """The parcels, in the order of their arrival within a frame."""
        return [parcel for arrived in self._parcels.values() for parcel in arrived.values()]

    def _of(self, frame: int) -> dict[int, Parcel]:
        return self._parcels.get(frame, {})
