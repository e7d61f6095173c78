"""Velocities that take a robot along a command: pure functions of poses.

The robot is steered from its odometry pose to the end of its command, never faster than it can
brake. Line tracking follows Kanayama, Kimura, Miyazaki and Noguchi (1990, "A stable tracking
control method for an autonomous mobile robot").
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

from minerva_bus import portable
from minerva_bus.errors import MisuseError
from minerva_bus.semantics.poses import Pose
from minerva_services.physics.body import DriveCommand

_SPEED_GAIN: Final = 8.0
"""Speed per metre of remaining distance, 1/s, where braking allows more."""

_TURN_GAIN: Final = 9.0
"""The same for turns."""

_LATERAL_GAIN: Final = 12.0
"""Turn per metre of lateral error, 1/m²."""

_MAX_HEADING_ERROR: Final = 12.0
"""Heading error in degrees above which the robot turns before driving."""

_CORNER_RADIUS: Final = 0.015
"""Distance in metres from a corner at which the robot may turn."""


def check_positive(name: str, value: float) -> float:
    """The value of an option, if it is a finite number above 0. Raises MisuseError."""
    if not (math.isfinite(value) and value > 0):
        raise MisuseError(f"ros2: {name} is {value!r}; expected a number above 0")
    return float(value)


@dataclass(frozen=True, slots=True)
class Velocity:
    """Metres per second along the heading, degrees per second counter-clockwise."""

    speed: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, slots=True)
class MotorLimits:
    """Limits of the motors. Raises MisuseError unless all are above 0.

    Args:
        speed: maximum in m/s.
        turn: maximum in degrees/s.
        acceleration: maximum in m/s².
        turn_acceleration: maximum in degrees/s².

    """

    speed: float = 0.3
    turn: float = 90.0
    acceleration: float = 1.0
    turn_acceleration: float = 360.0

    def __post_init__(self) -> None:
        for field in fields(self):
            check_positive(field.name, getattr(self, field.name))

    def clipped(self, wanted: Velocity) -> Velocity:
        """The velocity, limited to the maximum."""
        return Velocity(_clip(wanted.speed, self.speed), _clip(wanted.turn, self.turn))

    def slewed(self, before: Velocity, wanted: Velocity, seconds: float) -> Velocity:
        """The velocity closest to the wanted one that is reachable within `seconds`."""
        speed, turn = self.acceleration * seconds, self.turn_acceleration * seconds
        return Velocity(
            before.speed + _clip(wanted.speed - before.speed, speed),
            before.turn + _clip(wanted.turn - before.turn, turn),
        )


@dataclass(frozen=True, slots=True)
class CommandPath:
    """A command from a pose: a turn at `start`, then a straight line to `end`."""

    start: Pose
    command: DriveCommand

    @property
    def end(self) -> Pose:
        """Where the command leads."""
        turned = self.start.compose(Pose(angle=self.command.turn_deg))
        return turned.compose(Pose(x=self.command.forward_m))

    def reached(self, pose: Pose) -> bool:
        """True if a robot that arrives from behind may turn here."""
        if not self.command.turn_deg:
            return True
        missing = pose.seen(self.start)
        return abs(missing.x) <= _CORNER_RADIUS


def steer(pose: Pose, wanted: Pose, limits: MotorLimits) -> Velocity:
    """The velocity towards a pose from which the robot can still stop there."""
    missing = pose.seen(wanted)
    off = missing.angle
    # In the frame of the wanted pose: x is the error along the line, y the error across it.
    straight = wanted.seen(pose)
    speed = _braking(-straight.x, _SPEED_GAIN, limits.speed, limits.acceleration)
    # Slow down with the heading error, or the robot would leave its line in a curve.
    speed *= max(0.0, 1.0 - abs(off) / _MAX_HEADING_ERROR)
    aside = math.degrees(speed * _LATERAL_GAIN * -straight.y)
    turn = _braking(off, _TURN_GAIN, limits.turn, limits.turn_acceleration)
    return limits.clipped(Velocity(speed, turn + aside))


def _braking(missing: float, gain: float, most: float, acceleration: float) -> float:
    """The fastest speed that still allows stopping within the missing distance."""
    stoppable = math.sqrt(2 * acceleration * abs(missing))
    return math.copysign(min(most, stoppable, gain * abs(missing)), missing)


def driven(pose: Pose, velocity: Velocity, seconds: float) -> Pose:
    """The pose after driving at a constant velocity, along an arc."""
    angle, dist = velocity.turn * seconds, velocity.speed * seconds
    half = math.radians(angle) / 2
    # The chord of an arc points in the direction that the arc has halfway.
    chord = dist * (portable.sin(half) / half if half else 1.0)
    return pose.compose(Pose(angle=angle / 2)).compose(Pose(x=chord)).compose(Pose(angle=angle / 2))


def _clip(value: float, most: float) -> float:
    return min(most, max(-most, value))
