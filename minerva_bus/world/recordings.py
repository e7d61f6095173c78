"""Readings that were recorded: what a log or a bag is to those who play it or draw its map."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from minerva_bus.errors import MinervaError
from minerva_bus.world.readings import Reading

PassOver: TypeAlias = Callable[[str, str], None]
"""Told of what is passed over: what kind of thing it is, and where and why in a line."""


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
    was, right before that scan.
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
