"""When regions need the parcels of others, if they run ahead of them."""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.frame.lag import Lag


@dataclass(frozen=True, slots=True)
class Schedule:
    """How far regions run ahead between the frames that are multiples of `every`.

    A frame needs the parcels of frames that are more than `ahead` before it. Frames that are
    multiples of `every`, before which agents move, need those of all earlier ones; without `ahead`,
    all frames do.
    """

    every: int = 1
    ahead: int = 0

    @staticmethod
    def of(lag: Lag | None, ahead: int) -> Schedule:
        """The schedule of regions of a world with this lag, which run ahead by so many frames."""
        return Schedule(1 if lag is None else lag.every, ahead)

    def moves(self, frame: int) -> bool:
        """Whether agents move to other regions before a frame."""
        return frame % self.every == 0

    def waits(self, frame: int) -> bool:
        """Whether a frame needs the parcels of all earlier ones."""
        return not self.ahead or self.moves(frame)

    def needs(self, frame: int) -> int:
        """The number below which a frame needs the parcels of all frames."""
        if self.waits(frame):
            return frame
        return max(frame - frame % self.every, frame - self.ahead)

    def new(self, frame: int) -> range:
        """The frames whose parcels a frame needs, and the one before it did not."""
        return range(self.needs(frame - 1), self.needs(frame)) if frame else range(0)

    def last(self, frame: int) -> int:
        """The last frame that can run before all regions have finished `frame`."""
        return min(frame + self.ahead, frame - frame % self.every + self.every - 1)
