"""A CARMEN log as a recording: its lines as readings."""

from __future__ import annotations

import gzip
import math
import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BufferedIOBase, BufferedReader
from pathlib import Path
from typing import Final

from minerva_bus import portable
from minerva_bus.world.readings import Mount, Odometry, Scan
from minerva_bus.world.recordings import PassOver, Recorded, RecordingError
from minerva_services.sensors.carmen.lines import (
    Beams,
    LineError,
    Parameter,
    Pose,
    Wheels,
    read_line,
)
from minerva_services.sensors.playing import Mounting

_LONGEST: Final = 1 << 20
_GZIP: Final = b"\x1f\x8b"
_FRONT_LASER: Final = "robot_frontlaser_offset"
_PASSED_OVER, _TIMELESS, _BROKEN = "lines passed over", "lines without a time", "broken off"


@dataclass(frozen=True, slots=True)
class Topics:
    """Where the readings of a log go; "" leaves them out."""

    scan: str = "scan"
    odometry: str = "odometry"
    pose: str = "pose"
    correction: str = ""


@dataclass(slots=True)
class CarmenLog:
    """A log file, plain or gzipped; `range_max` in metres, 0: as the log says.

    An ODOM line with the time 0 says where a correction has put the robot, not what its wheels
    measured: it is passed over, unless there is a topic for corrections.
    """

    path: Path
    pass_over: PassOver
    robot: str = "r1"
    mounting: Mounting = field(default_factory=Mounting)
    topics: Topics = field(default_factory=Topics)
    range_max: float = 0.0
    _raw: BufferedReader | None = None
    _size: int = 1
    _offset: float = 0.0
    _stamp: float = 0.0

    @property
    def part(self) -> float:
        return self._raw.tell() / self._size if self._raw is not None else 0.0

    def readings(self) -> Iterator[Recorded]:
        """The readings in the order of the lines. Raises RecordingError."""
        self._offset, some = 0.0, False
        for number, line in self._lines():
            try:
                said = read_line(line)
            except LineError as error:
                self.pass_over(_PASSED_OVER, f"{self.path}: line {number} is passed over: {error}")
                continue
            for one in self._said(said, number):
                some, self._stamp = True, one.stamp
                yield one
        if not some:
            raise RecordingError(
                f"{self.path}: has no reading; expected a CARMEN log with lines such as FLASER"
            )

    def close(self) -> None:
        if self._raw is not None:
            self._raw.close()
            self._raw = None

    def _lines(self) -> Iterator[tuple[int, str]]:
        """The lines with their numbers from 1, as far as the file can be read."""
        number = 0
        try:
            with self._opened() as file:
                for line in iter(lambda: file.readline(_LONGEST), b""):
                    number += 1
                    yield number, line.decode("utf-8", "replace")
        except (OSError, EOFError, zlib.error) as error:
            if not number:
                raise RecordingError(f"{self.path}: cannot be read: {error}") from None
            self.pass_over(_BROKEN, f"{self.path}: breaks off after line {number}: {error}")

    def _opened(self) -> BufferedIOBase:
        self.close()
        self._raw = self.path.open("rb")
        self._size = max(1, os.fstat(self._raw.fileno()).st_size)
        packed = self._raw.read(2) == _GZIP
        self._raw.seek(0)
        return gzip.open(self._raw) if packed else self._raw

    def _said(self, said: Wheels | Beams | Parameter | None, number: int) -> Iterator[Recorded]:
        match said:
            case Wheels(time=0.0) if self.topics.correction:
                yield Recorded(self._stamp, self.topics.correction, self._odometry(said))
            case Wheels(time=0.0):
                self.pass_over(_TIMELESS, f"{self.path}: line {number} is ODOM without a time")
            case Wheels() if self.topics.odometry:
                yield Recorded(said.stamp, self.topics.odometry, self._odometry(said))
            case Beams():
                yield from self._measured(said)
            case Parameter(name, value) if name == _FRONT_LASER:
                self._offset = _number(value)
            case _:
                pass

    def _odometry(self, said: Wheels) -> Odometry:
        at = said.pose
        return Odometry(self.robot, at.x, at.y, at.angle, said.speed, said.turn, said.time)

    def _measured(self, said: Beams) -> Iterator[Recorded]:
        """The scan, and before it where the robot was."""
        mount = self.mounting.over(_mount(said, self._offset))
        if said.laser is not None and self.topics.pose:
            at = _carrier(said.laser, mount)
            pose = Odometry(self.robot, at.x, at.y, at.angle, 0.0, 0.0, said.time)
            yield Recorded(said.stamp, self.topics.pose, pose)
        if self.topics.scan:
            yield Recorded(said.stamp, self.topics.scan, self._scan(said, mount))

    def _scan(self, said: Beams, mount: Mount) -> Scan:
        return Scan(
            self.robot,
            said.ranges,
            said.first,
            said.step,
            self.range_max or said.range_max,
            said.time,
            mount.x,
            mount.y,
            mount.angle,
        )


def open_log(path: Path, pass_over: PassOver) -> CarmenLog:
    """A log as it is, for whoever wants its readings alone, also where it was corrected."""
    return CarmenLog(path, pass_over, topics=Topics(correction="correction"))


def _mount(said: Beams, offset: float) -> Mount:
    """Where the laser sits: so far ahead as a parameter says, or as both poses of a line say."""
    if said.laser is None or said.robot is None:
        return Mount(offset)
    turn = math.radians(said.robot.angle)
    east, north = said.laser.x - said.robot.x, said.laser.y - said.robot.y
    ahead = portable.cos(turn) * east + portable.sin(turn) * north
    left = portable.cos(turn) * north - portable.sin(turn) * east
    angle = (said.laser.angle - said.robot.angle + 180.0) % 360.0 - 180.0
    return Mount(*[round(one, 6) + 0.0 for one in (ahead, left, angle)])


def _carrier(laser: Pose, mount: Mount) -> Pose:
    """Where the robot is whose laser is there."""
    angle = laser.angle - mount.angle
    cos, sin = portable.cos(math.radians(angle)), portable.sin(math.radians(angle))
    x = laser.x - (cos * mount.x - sin * mount.y)
    y = laser.y - (sin * mount.x + cos * mount.y)
    return Pose(x, y, angle)


def _number(word: str) -> float:
    try:
        number = float(word)
    except ValueError:
        return 0.0
    return number if math.isfinite(number) else 0.0
