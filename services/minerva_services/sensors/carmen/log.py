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
from minerva_bus.files import check_input
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Mount, Odometry, Scan
from minerva_bus.world.recordings import FirstSkip, PassOver, Recorded, RecordingError, watched
from minerva_services.sensors.carmen.lines import (
    LaserLine,
    LineError,
    OdometryLine,
    OtherMessage,
    ParameterLine,
    read_line,
)
from minerva_services.sensors.playback import MountOverride

_MAX_LINE_BYTES: Final = 1 << 20
_MAX_BYTES: Final = 4 << 30
_GZIP: Final = b"\x1f\x8b"
_FRONT_LASER: Final = "robot_frontlaser_offset"
_PASSED_OVER, _TIMELESS, _BROKEN = "lines passed over", "lines without a time", "broken off"
_OTHER: Final = "other messages"


@dataclass(frozen=True, slots=True)
class LogTopics:
    """Topics for the readings of a log; "" omits them."""

    scan: str = "scan"
    odometry: str = "odometry"
    pose: str = "pose"
    correction: str = ""


@dataclass(slots=True)
class CarmenLog:
    """A log file, plain or gzipped; `range_max` in metres, 0: as logged.

    An ODOM line with time 0 states where a correction has put the robot, not what its wheels
    measured. It is skipped, unless there is a topic for corrections. Laser lines state the odometry
    of a log that has no other ODOM lines.
    """

    path: Path
    pass_over: PassOver
    robot: str = "r1"
    mounting: MountOverride = field(default_factory=MountOverride)
    topics: LogTopics = field(default_factory=LogTopics)
    range_max: float = 0.0
    _raw: BufferedReader | None = None
    _size: int = 1
    _offset: float = 0.0
    _stamp: float = 0.0
    _has_odometry: bool = False

    @property
    def part(self) -> float:
        # The position in the raw file, because the size of an unpacked gzip file is unknown.
        return self._raw.tell() / self._size if self._raw is not None else 0.0

    def readings(self) -> Iterator[Recorded]:
        """The readings in the order of the lines. Raises RecordingError."""
        return watched(self._readings(), self.path, self.pass_over)

    def close(self) -> None:
        if self._raw is not None:
            self._raw.close()
            self._raw = None

    def _readings(self) -> Iterator[Recorded]:
        self._offset, self._has_odometry, is_empty = 0.0, False, True
        skipped = FirstSkip(self.pass_over)
        for number, text in self._lines():
            try:
                line = read_line(text)
            except OtherMessage as error:
                self.pass_over(_OTHER, f"{self.path}: line {number} skipped: {error}")
                continue
            except LineError as error:
                skipped(_PASSED_OVER, f"{self.path}: line {number} skipped: {error}")
                continue
            for reading in self._converted(line, number):
                is_empty, self._stamp = False, reading.stamp
                yield reading
        if is_empty:
            raise RecordingError(
                f"{self.path}: no readings; expected a CARMEN log with lines such as FLASER"
                f"{skipped.reason(self.path)}"
            )

    def _lines(self) -> Iterator[tuple[int, str]]:
        """The lines with their numbers from 1, as far as the file is readable."""
        number = 0
        try:
            with self._opened() as file:
                # The limit bounds the memory that a file without line ends takes.
                for line in iter(lambda: file.readline(_MAX_LINE_BYTES), b""):
                    number += 1
                    yield number, line.decode("utf-8", "replace")
        # A truncated archive fails only at its end, so the lines before remain usable.
        except (OSError, EOFError, zlib.error) as error:
            if not number:
                reason = error.strerror if isinstance(error, OSError) else None
                raise RecordingError(f"{self.path}: cannot read: {reason or error}") from None
            self.pass_over(_BROKEN, f"{self.path}: breaks off after line {number}: {error}")

    def _opened(self) -> BufferedIOBase:
        # A loop opens the file again.
        self.close()
        check_input(self.path, _MAX_BYTES)
        self._raw = self.path.open("rb")
        self._size = max(1, os.fstat(self._raw.fileno()).st_size)
        packed = self._raw.read(2) == _GZIP
        self._raw.seek(0)
        return gzip.open(self._raw) if packed else self._raw

    def _converted(
        self, line: OdometryLine | LaserLine | ParameterLine | None, number: int
    ) -> Iterator[Recorded]:
        match line:
            case OdometryLine(time=0.0) if self.topics.correction:
                # The line has no time of its own, so it belongs to the reading before it.
                yield Recorded(self._stamp, self.topics.correction, self._odometry(line))
            case OdometryLine(time=0.0):
                self.pass_over(_TIMELESS, f"{self.path}: line {number} is ODOM without a time")
            case OdometryLine() if self.topics.odometry:
                self._has_odometry = True
                yield Recorded(line.stamp, self.topics.odometry, self._odometry(line))
            case LaserLine():
                yield from self._measured(line)
            case ParameterLine(name, value) if name == _FRONT_LASER:
                self._offset = _number(value)
            case _:
                pass

    def _odometry(self, line: OdometryLine) -> Odometry:
        at = line.pose
        return Odometry(self.robot, at.x, at.y, at.angle, line.speed, line.turn, line.time)

    def _measured(self, line: LaserLine) -> Iterator[Recorded]:
        """The scan, preceded by the robot's odometry and pose."""
        mount = self.mounting.over(_mount(line, self._offset))
        if line.wheels is not None and self.topics.odometry and not self._has_odometry:
            yield Recorded(line.stamp, self.topics.odometry, self._still(line.wheels, line.time))
        if line.laser is not None and self.topics.pose:
            at = _carrier(line.laser, mount)
            yield Recorded(line.stamp, self.topics.pose, self._still(at, line.time))
        if self.topics.scan:
            yield Recorded(line.stamp, self.topics.scan, self._scan(line, mount))

    def _still(self, at: Pose, time: float) -> Odometry:
        """An odometry whose speeds the line does not state."""
        return Odometry(self.robot, at.x, at.y, at.angle, 0.0, 0.0, time)

    def _scan(self, line: LaserLine, mount: Mount) -> Scan:
        return Scan(
            self.robot,
            line.ranges,
            line.first,
            line.step,
            self.range_max or line.range_max,
            line.time,
            mount.x,
            mount.y,
            mount.angle,
        )


def open_log(path: Path, pass_over: PassOver) -> CarmenLog:
    """Open a log for its readings alone, including corrections."""
    return CarmenLog(path, pass_over, topics=LogTopics(correction="correction"))


def _mount(line: LaserLine, offset: float) -> Mount:
    """The laser's mount: from a parameter, or from both poses of a line."""
    if line.laser is None or line.robot is None:
        return Mount(offset)
    cos, sin = portable.cos_sin(math.radians(line.robot.angle))
    east, north = line.laser.x - line.robot.x, line.laser.y - line.robot.y
    ahead, left = cos * east + sin * north, cos * north - sin * east
    angle = (line.laser.angle - line.robot.angle + 180.0) % 360.0 - 180.0
    # The difference of two large coordinates is noisy in its last bits; rounded, the mount is the
    # same for every scan. Adding 0.0 turns -0.0 into 0.0.
    return Mount(*[round(value, 6) + 0.0 for value in (ahead, left, angle)])


def _carrier(laser: Pose, mount: Mount) -> Pose:
    """The robot's pose for a pose of its laser."""
    angle = laser.angle - mount.angle
    cos, sin = portable.cos_sin(math.radians(angle))
    x = laser.x - (cos * mount.x - sin * mount.y)
    y = laser.y - (sin * mount.x + cos * mount.y)
    return Pose(x, y, angle)


def _number(word: str) -> float:
    try:
        number = float(word)
    except ValueError:
        return 0.0
    return number if math.isfinite(number) else 0.0
