"""CARMEN logs as recordings: their lines, one message each, as CARMEN's own logger writes them.

    ODOM x y theta tv rv accel                                          TIMES
    FLASER n range*n x y theta odom_x odom_y odom_theta                 TIMES
    RAWLASER1 LASER                                                     TIMES
    ROBOTLASER1 LASER x y theta robot_x robot_y robot_theta
                tv rv forward_safety side_safety turn_axis              TIMES
    PARAM name value ...

    LASER   type start_angle fov resolution maximum_range accuracy remission_mode
            n range*n m remission*m
    TIMES   message_time host logger_time

Metres and radians; x, y, theta of a laser line is the laser's pose, which a corrected log replaces.
"""

from __future__ import annotations

import gzip
import math
import os
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import BufferedIOBase, BufferedReader
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.files import check_input
from minerva_bus.log.recordings import PassOver, Recorded, RecordingError
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Mount, Odometry, Scan
from minerva_services.sensors.clocks import FirstSkip, watched
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


NO_HIT_RANGE: Final = 80.0
"""Range in metres from which a SICK laser means no hit: it then reads about 81.9."""

_AFTER_RANGES: Final = 9
"""Words of a FLASER line after its ranges: two poses and the times."""

# No laser has as many: a larger number means a damaged line.
_MAX_BEAMS: Final = 100_000


class LineError(ValueError):
    """A line does not match its keyword."""


class OtherMessage(Exception):
    """A message of CARMEN that is no measurement of a laser or of odometry."""


@dataclass(frozen=True, slots=True)
class OdometryLine:
    """ODOM: pose, speeds in metres and degrees per second, and times."""

    pose: Pose
    speed: float
    turn: float
    time: float
    stamp: float


@dataclass(frozen=True, slots=True, eq=False)
class LaserLine:
    """A laser line: ranges in metres at `first` + i·`step` degrees, the laser's pose, and times.

    `robot` is the robot's pose, if the line states it, and `wheels` its pose by odometry, if that
    differs from the laser's.
    """

    ranges: NDArray[np.float32]
    first: float
    step: float
    range_max: float
    time: float
    stamp: float
    laser: Pose | None = None
    robot: Pose | None = None
    wheels: Pose | None = None


@dataclass(frozen=True, slots=True)
class ParameterLine:
    """PARAM: a logged setting of the robot."""

    name: str
    value: str


LogLine: TypeAlias = OdometryLine | LaserLine | ParameterLine


def read_line(line: str) -> LogLine | None:
    """Parse a line; None for an empty one or a comment. Raises LineError and OtherMessage."""
    words = line.split()
    if not words or words[0].startswith("#"):
        return None
    read = _READERS.get(words[0])
    if read is None:
        # A first word that cannot be a keyword means a damaged line, or a file of another kind.
        if not words[0].isascii() or not words[0].replace("_", "").isalnum():
            raise LineError("not a CARMEN message")
        raise OtherMessage(f"messages {words[0][:20]} are not read")
    return read(_Words(words))


def angles_of(beams: int) -> tuple[float, float]:
    """First angle and step, in degrees, of a SICK laser with a 180° field of view.

    An even number of beams lacks the last beam of the 180°, by CARMEN's convention.
    """
    return -90.0, 180.0 / max(1, beams - beams % 2)


def _advice(word: str) -> str:
    return "; write decimals with a point" if "," in word else ""


class _Words:
    """The words of a line, read sequentially."""

    def __init__(self, words: Sequence[str]) -> None:
        self._words = words
        self._at = 1

    def text(self) -> str:
        if self._at >= len(self._words):
            raise LineError(f"line ends after {len(self._words)} words")
        self._at += 1
        return self._words[self._at - 1]

    def number(self) -> float:
        word = self.text()
        try:
            number = float(word)
        except ValueError:
            raise LineError(f"{word[:20]!r} is not a number{_advice(word)}") from None
        if not math.isfinite(number):
            raise LineError(f"{word[:20]!r} is not finite")
        return number

    def count(self) -> int:
        word = self.text()
        if not word.isdecimal() or int(word) > _MAX_BEAMS:
            raise LineError(f"{word[:20]!r} is not a number of beams")
        return int(word)

    @property
    def left(self) -> int:
        """Number of unread words."""
        return len(self._words) - self._at

    def ranges(self, count: int) -> NDArray[np.float32]:
        """The next `count` ranges, including infinite ones.

        `nan` becomes 0, no hit.
        """
        words = [self.text() for _ in range(count)]
        try:
            ranges = np.array([float(word) for word in words], np.float32)
        except ValueError as error:
            text = str(error)[-30:]
            raise LineError(f"invalid range: {text}{_advice(text)}") from None
        ranges[np.isnan(ranges)] = 0.0
        return ranges

    def pose(self) -> Pose:
        return Pose(self.number(), self.number(), math.degrees(self.number()))

    def times(self) -> tuple[float, float]:
        """When the message was sent, and when it was logged."""
        sent, _ = self.number(), self.text()
        return sent, self.number()


def _wheels(words: _Words) -> OdometryLine:
    pose, speed, turn, _ = words.pose(), words.number(), words.number(), words.number()
    return OdometryLine(pose, speed, math.degrees(turn), *words.times())


def _front_laser(words: _Words) -> LaserLine:
    announced, beams = words.count(), words.left - _AFTER_RANGES
    # With a wrong number, ranges would be read as the pose.
    if beams >= 0 and beams != announced:
        raise LineError(f"{announced} beams announced, {beams} found")
    ranges = words.ranges(announced)
    if not len(ranges):
        raise LineError("no beams")
    laser, second = words.pose(), words.pose()
    # Tools that correct a log change the first pose only, or both: then the odometry is lost.
    wheels = None if second == laser else second
    first, step = angles_of(len(ranges))
    times = words.times()
    return LaserLine(ranges, first, step, NO_HIT_RANGE, *times, laser, wheels=wheels)


@dataclass(frozen=True, slots=True)
class _Laser:
    ranges: NDArray[np.float32]
    first: float
    step: float
    range_max: float


def _laser(words: _Words, after: int) -> _Laser:
    """The laser of a line that has this number of words after it."""
    words.number()
    first, _, step = words.number(), words.number(), words.number()
    range_max, *_ = words.number(), words.number(), words.number()
    announced = words.count()
    ranges = words.ranges(announced)
    try:
        remissions = words.count()
    except LineError:
        raise LineError(
            f"{announced} beams announced, which no number of remissions follows"
        ) from None
    words.ranges(remissions)
    if words.left != after and words.left >= 0:
        raise LineError(
            f"{announced} beams and {remissions} remissions announced, but {words.left} words"
            f" follow them; expected {after}"
        )
    if not len(ranges):
        raise LineError("no beams")
    if not step and len(ranges) > 1:
        raise LineError(f"the resolution is 0, with {len(ranges)} beams")
    # A larger maximum would turn readings that mean no hit into hits.
    range_max = min(range_max, NO_HIT_RANGE) if range_max > 0 else NO_HIT_RANGE
    return _Laser(ranges, math.degrees(first), math.degrees(step), range_max)


def _raw_laser(words: _Words) -> LaserLine:
    laser = _laser(words, 3)
    return LaserLine(laser.ranges, laser.first, laser.step, laser.range_max, *words.times())


def _robot_laser(words: _Words) -> LaserLine:
    laser, pose, robot = _laser(words, 14), words.pose(), words.pose()
    # tv, rv, forward_safety, side_safety and turn_axis, which no reading needs.
    for _ in range(5):
        words.number()
    beams = (laser.ranges, laser.first, laser.step, laser.range_max)
    return LaserLine(*beams, *words.times(), pose, robot)


def _parameter(words: _Words) -> ParameterLine:
    return ParameterLine(words.text(), words.text())


_READERS: Final = {
    "ODOM": _wheels,
    "FLASER": _front_laser,
    "RAWLASER1": _raw_laser,
    "ROBOTLASER1": _robot_laser,
    "PARAM": _parameter,
}
