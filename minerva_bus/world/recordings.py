"""Recordings of readings: interface of logs and bags for playback and mapping."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, TypeAlias

from minerva_bus.errors import MinervaError, MisuseError, nearest
from minerva_bus.world.readings import Reading

PassOver: TypeAlias = Callable[[str, str], None]
"""Called with skipped data: its kind, and a line with position and reason."""

Progress: TypeAlias = Callable[[float], None]
"""Called occasionally with the progress of a task, from 0 to 1."""


POSE: Final = "pose"
CORRECTION: Final = "correction"
"""Topics of a recording on which an `Odometry` is not what wheels measured; see `Recording`."""


class FirstSkip:
    """Passes skipped data on, and keeps the first reason for an error if nothing remains."""

    def __init__(self, pass_over: PassOver) -> None:
        self._pass_over = pass_over
        self._line = ""

    def __call__(self, what: str, line: str) -> None:
        """Skip data (a `PassOver`)."""
        self._line = self._line or line
        self._pass_over(what, line)

    def reason(self, path: Path) -> str:
        """The end of an error about a file: why its first data were skipped, if any were."""
        return f"; {self._line.removeprefix(f'{path}: ')}" if self._line else ""


class RecordingError(MinervaError):
    """A recording cannot be read, or lacks the requested data."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A reading, its sensor topic, and the time of recording in seconds.

    `stamp` is from the clock of the recorder, which may jump; the reading's `time` is from the
    clock of its sensor.
    """

    stamp: float
    topic: str
    reading: Reading


class Recording(Protocol):
    """A file of readings.

    The topic `pose` has an `Odometry` right before each scan for which the recording has a pose of
    the robot. The topic `correction` has one where the recorder has reset the odometry: later
    readings of odometry continue from the pose in it.
    """

    @property
    def part(self) -> float:
        """The part that has been read since the last call of `readings`, from 0 to 1."""
        ...

    def readings(self) -> Iterator[Recorded]:
        """All readings in the order of the file. Raises RecordingError."""
        ...

    def close(self) -> None:
        """Release the file."""
        ...


POSES: Final = ("published", "odometry", "matched")


@dataclass(frozen=True, slots=True)
class MapChoice:
    """Options of a map of a recording. Raises MisuseError.

    `cell` is the side of a cell and `farthest` the longest range to use (0: as recorded), in
    metres; `begin` and `end` are seconds after the first reading. `poses` selects the poses of the
    robot: those `published` in the recording, those of the `odometry`, or those corrected by scans
    `matched` to the map. `time_offset`, in seconds, is added to the times of scans, because the
    clocks of lidar and odometry may differ.
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
            known = f"expected {', '.join(POSES)}"
            raise MisuseError(
                f"there are no poses {self.poses!r}{nearest(self.poses, [*POSES], known)}"
            )


class Mapper(Protocol):
    """Writes the map of a recording to files."""

    def __call__(
        self, open: Callable[[], Recording], into: Path, choice: MapChoice, progress: Progress
    ) -> list[str]:
        """Lines that describe the map. `open` may be called several times.

        Raises MinervaError.
        """
        ...
