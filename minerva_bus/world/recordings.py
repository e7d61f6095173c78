"""Readings that were recorded: what a log or a bag is to those who play it or draw its map."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, TypeAlias

from minerva_bus.errors import MinervaError, MisuseError, nearest
from minerva_bus.world.readings import Reading

PassOver: TypeAlias = Callable[[str, str], None]
"""Told of what is passed over: what kind of thing it is, and where and why in a line."""

Progress: TypeAlias = Callable[[float], None]
"""Told now and then how much of some work is done, from 0 to 1."""


POSE: Final = "pose"
CORRECTION: Final = "correction"
"""Topics of a recording on which an `Odometry` is not what wheels measured; see `Recording`."""


class RecordingError(MinervaError):
    """A recording cannot be read, or has not what is wanted of it."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A reading, the sensor topic that it belongs on, and when it was recorded, in seconds.

    `stamp` is by the clock of whoever recorded, which may jump; the reading's own `time` is by
    its sensor's.
    """

    stamp: float
    topic: str
    reading: Reading


class Recording(Protocol):
    """A file of readings.

    The topic `pose` has an `Odometry` for each scan of which the recording knows where the robot
    was, right before that scan. The topic `correction` has one where the readings of odometry after
    it begin anew: whoever recorded has moved what they had reached to there.
    """

    @property
    def part(self) -> float:
        """How much of it has been read since `readings` was last called, from 0 to 1."""
        ...

    def readings(self) -> Iterator[Recorded]:
        """All of it from the beginning, in the order of the file; raises RecordingError."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


POSES: Final = ("published", "odometry", "matched")


@dataclass(frozen=True, slots=True)
class MapChoice:
    """What of a recording a map is drawn from, and how finely. Raises MisuseError.

    `cell` is the side of a cell and `farthest` the longest range that counts (0: as recorded), in
    metres; `begin` and `end` are seconds after the first reading. `poses` says which places of
    the robot count: those that are `published` in it, those of the `odometry` alone, or those
    that scans `matched` to the map correct. `time_offset` is added to the times of scans, in
    seconds: the lidar's clock and that of the odometry may differ.
    """

    cell: float = 0.05
    farthest: float = 0.0
    begin: float = 0.0
    end: float = math.inf
    poses: str = "published"
    time_offset: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.cell < math.inf:
            raise MisuseError(f"the cell is {self.cell:g} m; expected metres above 0")
        if not 0 <= self.farthest < math.inf:
            raise MisuseError(f"the range is {self.farthest:g} m; expected metres, or 0 for all")
        if not 0 <= self.begin < self.end:
            raise MisuseError(
                f"from {self.begin:g} to {self.end:g} s there is nothing; expected from < to,"
                " seconds after the beginning"
            )
        if not math.isfinite(self.time_offset):
            raise MisuseError(f"the time offset is {self.time_offset:g} s; expected seconds")
        if self.poses not in POSES:
            raise MisuseError(
                f"there are no poses {self.poses!r}{nearest(self.poses, [*POSES])}; expected"
                f" {', '.join(POSES)}"
            )


class Mapper(Protocol):
    """Draws the map of a recording into files."""

    def __call__(
        self, open: Callable[[], Recording], into: Path, choice: MapChoice, progress: Progress
    ) -> list[str]:
        """Lines that say what was drawn. `open` may be called several times.

        Raises MinervaError.
        """
        ...
