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

Metres and radians; x, y, theta of a laser line is where the laser was, in a corrected log as
somebody has corrected it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

NOTHING_HIT: Final = 80.0
"""Metres from which on a SICK laser means that nothing was hit: it reads about 81.9 then."""

_MOST_BEAMS: Final = 100_000


class LineError(ValueError):
    """A line is not what its first word says."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where something is: metres, and degrees counter-clockwise."""

    x: float
    y: float
    angle: float


@dataclass(frozen=True, slots=True)
class Wheels:
    """ODOM: where the wheels believe to be, metres and degrees a second, and when."""

    pose: Pose
    speed: float
    turn: float
    time: float
    stamp: float


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """A laser line: ranges in metres at `first` + i·`step` degrees, where the laser was, when.

    `robot` is where the robot was, if the line has it for certain.
    """

    ranges: NDArray[np.float32]
    first: float
    step: float
    range_max: float
    time: float
    stamp: float
    laser: Pose | None = None
    robot: Pose | None = None


@dataclass(frozen=True, slots=True)
class Parameter:
    """PARAM: a setting of the robot that was logged."""

    name: str
    value: str


Line: TypeAlias = Wheels | Beams | Parameter


def read_line(line: str) -> Line | None:
    """What a line says; None where it is a comment or a message of another kind.

    Raises LineError.
    """
    words = line.split()
    if not words or words[0].startswith("#"):
        return None
    read = _READERS.get(words[0])
    if read is None:
        if not words[0].isascii() or not words[0].replace("_", "").isalnum():
            raise LineError("no message of CARMEN")
        return None
    return read(_Words(words))


def angles_of(beams: int) -> tuple[float, float]:
    """The first angle and the step, in degrees, of a SICK laser that looks 180° wide ahead.

    An even number of beams lacks the last one of the 180°, as CARMEN takes it.
    """
    return -90.0, 180.0 / max(1, beams - beams % 2)


class _Words:
    """The words of a line, taken one after another."""

    def __init__(self, words: Sequence[str]) -> None:
        self._words = words
        self._at = 1

    def text(self) -> str:
        if self._at >= len(self._words):
            raise LineError(f"it breaks off after {len(self._words)} words")
        self._at += 1
        return self._words[self._at - 1]

    def number(self) -> float:
        word = self.text()
        try:
            number = float(word)
        except ValueError:
            raise LineError(f"{word[:20]!r} is no number") from None
        if not math.isfinite(number):
            raise LineError(f"{word[:20]!r} is no finite number")
        return number

    def count(self) -> int:
        word = self.text()
        if not word.isdecimal() or int(word) > _MOST_BEAMS:
            raise LineError(f"{word[:20]!r} is no number of beams")
        return int(word)

    def ranges(self) -> NDArray[np.float32]:
        """So many ranges as the next word says, also infinite ones; `nan` is 0, no hit."""
        words = [self.text() for _ in range(self.count())]
        try:
            ranges = np.array([float(word) for word in words], np.float32)
        except ValueError as error:
            raise LineError(f"a range is no number: {str(error)[-30:]}") from None
        ranges[np.isnan(ranges)] = 0.0
        return ranges

    def pose(self) -> Pose:
        return Pose(self.number(), self.number(), math.degrees(self.number()))

    def times(self) -> tuple[float, float]:
        """When the message was sent, and when it was logged."""
        sent, _ = self.number(), self.text()
        return sent, self.number()


def _wheels(words: _Words) -> Wheels:
    pose, speed, turn, _ = words.pose(), words.number(), words.number(), words.number()
    return Wheels(pose, speed, math.degrees(turn), *words.times())


def _front_laser(words: _Words) -> Beams:
    ranges = words.ranges()
    if not len(ranges):
        raise LineError("it has no beams")
    laser, _ = words.pose(), words.pose()  # the second is never corrected in some logs
    first, step = angles_of(len(ranges))
    return Beams(ranges, first, step, NOTHING_HIT, *words.times(), laser)


@dataclass(frozen=True, slots=True)
class _Laser:
    ranges: NDArray[np.float32]
    first: float
    step: float
    range_max: float


def _laser(words: _Words) -> _Laser:
    words.number()
    first, _, step = words.number(), words.number(), words.number()
    range_max, *_ = words.number(), words.number(), words.number()
    ranges, _ = words.ranges(), words.ranges()
    if not len(ranges):
        raise LineError("it has no beams")
    range_max = min(range_max, NOTHING_HIT) if range_max > 0 else NOTHING_HIT
    return _Laser(ranges, math.degrees(first), math.degrees(step), range_max)


def _raw_laser(words: _Words) -> Beams:
    laser = _laser(words)
    return Beams(laser.ranges, laser.first, laser.step, laser.range_max, *words.times())


def _robot_laser(words: _Words) -> Beams:
    laser, pose, robot = _laser(words), words.pose(), words.pose()
    for _ in range(5):
        words.number()
    made = (laser.ranges, laser.first, laser.step, laser.range_max)
    return Beams(*made, *words.times(), pose, robot)


def _parameter(words: _Words) -> Parameter:
    return Parameter(words.text(), words.text())


_READERS: Final = {
    "ODOM": _wheels,
    "FLASER": _front_laser,
    "RAWLASER1": _raw_laser,
    "ROBOTLASER1": _robot_laser,
    "PARAM": _parameter,
}
