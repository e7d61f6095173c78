"""Parcels that have arrived for a region's frames, in any order and more than once."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from minerva_bus.errors import ProtocolError
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.schedule import Schedule


@dataclass(frozen=True, slots=True)
class Arrived:
    """What a frame begins with, each in the order of regions.

    `present`: the parcels of the frame before. `later`: by frame, the parcels whose postponed
    events are complete now.
    """

    present: list[Parcel]
    later: Mapping[int, list[Parcel]]


class ParcelInbox:
    """The parcels of a region that its frames have not taken; it takes its own ones in time.

    `entered` is the number of the first frame that has not been entered.
    """

    def __init__(self, number: int, frame: int, schedule: Schedule) -> None:
        """`number` is the region's, and `frame` the one that it has entered last."""
        self.entered: int = frame + 1
        self._number = number
        self._schedule = schedule
        self._expected: dict[int, frozenset[int]] = {}
        self._parcels: dict[int, dict[int, Parcel]] = {}

    def add(self, parcel: Parcel) -> bool:
        """Keep a parcel; returns False if it has arrived before.

        Raises ProtocolError for a parcel that a frame needs which does not wait for it.
        """
        needed = parcel.source == self._number or self._schedule.waits(parcel.frame + 1)
        if parcel.for_next_frame and not needed:
            raise ProtocolError(f"it is for frame {parcel.frame + 1}, which does not wait for it")
        taken = parcel.frame < self._schedule.needs(self.entered - 1)
        if taken or parcel.source in self._of(parcel.frame):
            return False
        self._parcels.setdefault(parcel.frame, {})[parcel.source] = parcel
        return True

    def expect(self, sources: Mapping[int, Collection[int]]) -> None:
        """Note which regions have sent parcels of a frame: others have sent none."""
        self._expected |= {frame: frozenset(each) for frame, each in sources.items()}

    def missing(self, frame: int) -> list[int]:
        """The regions whose parcels for a frame have not arrived."""
        missing = {self._number}.difference(self._of(frame - 1))
        for past in self._schedule.new(frame):
            missing |= self._expected.get(past, frozenset()).difference(self._of(past))
        return sorted(missing)

    def enter(self, frame: int) -> Arrived:
        """Remove and return the parcels with which a frame begins.

        Raises ProtocolError for one that its sender has not reported: it would count only here if
        it arrives in time.
        """
        of_last, own, later = self._of(frame - 1), self._number, dict[int, list[Parcel]]()
        present = of_last if self._schedule.waits(frame) else {own: of_last[own]}
        for past in self._schedule.new(frame):
            arrived = self._parcels.pop(past, {})
            expected = self._expected.pop(past, frozenset())
            for source in sorted(arrived.keys() - expected - {own}):
                raise ProtocolError(
                    f"region {source} has sent a parcel of frame {past} that it has not reported"
                )
            later[past] = [parcel for _, parcel in sorted(arrived.items())]
        self.entered = frame + 1
        return Arrived([parcel for _, parcel in sorted(present.items())], later)

    @property
    def has_own_events(self) -> bool:
        """Whether events of this region's agents wait for those of other regions."""
        return any(each.postponed for each in self.kept if each.source == self._number)

    @property
    def kept(self) -> list[Parcel]:
        """The parcels, in the order of their arrival within a frame."""
        return [parcel for arrived in self._parcels.values() for parcel in arrived.values()]

    def _of(self, frame: int) -> dict[int, Parcel]:
        return self._parcels.get(frame, {})
