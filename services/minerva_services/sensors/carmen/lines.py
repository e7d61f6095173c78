"""The lines of a CARMEN log, one message each, as CARMEN's own logger writes them.

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

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.poses import Pose

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
