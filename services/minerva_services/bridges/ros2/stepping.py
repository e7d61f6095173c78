"""Commands executed step by step on a simulated clock, for simulations driven by /clock.

Such a robot's time advances only as published here, so frame and robot wait for each other: its
readings belong to exactly the pose reached by its command.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from minerva_bus import portable
from minerva_bus.semantics.poses import Pose
from minerva_services.bridges.ros2.driver import STILL, Driver, State
from minerva_services.bridges.ros2.steering import MotorLimits, Velocity
from minerva_services.bridging.bridge import log
from minerva_services.physics.body import DriveCommand

NANOSECONDS: Final = 1_000_000_000
BEGIN: Final = NANOSECONDS
"""Start of the clock; ROS interprets 0 as a missing clock."""

ROUNDING: Final = 1e-6
"""Metres and degrees below which a deviation counts as rounding."""

# 50 steps per second, where the driver steers by odometry.
_STEP_NANOSECONDS: Final = NANOSECONDS // 50
# Seconds after which a missing answer is logged.
_SILENT_AFTER: Final = 3.0


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A velocity, and the interval of the clock in nanoseconds during which it applies."""

    velocity: Velocity
    begin: int
    end: int


class Stepper:
    """Takes a robot through its commands; the link's beat publishes the step repeatedly.

    `measured` is the time, in seconds of the clock, up to which all readings have arrived; `wake`
    makes the link publish the step at once.
    """

    def __init__(
        self, driver: Driver, measured: Callable[[], float], wake: Callable[[], None], where: str
    ) -> None:
        self._driver, self._measured, self._wake, self._where = driver, measured, wake, where
        self._answered = threading.Condition()
        self.step = ClockStep(STILL, BEGIN, BEGIN)

    @property
    def now(self) -> float:
        """Seconds of the clock, bit-identical to those of a message's stamp."""
        whole, rest = divmod(self.step.end, NANOSECONDS)
        return whole + rest * 1e-9

    def notify(self) -> None:
        """Notify the stepper of an incoming message."""
        with self._answered:
            self._answered.notify()

    def carry_out(self, command: DriveCommand, seconds: float) -> float:
        """Execute a command in at least `seconds`; the distance not driven in metres."""
        driver = self._driver
        self._catch_up()
        # Without a deviation, the command's own velocities lead exactly to its end. Otherwise the
        # driver steers by odometry.
        exact = is_rounding(driver.offset)
        # The phases take the time of the command themselves, so the driver needs no minimum
        # duration.
        driver.begin(command, 0.0 if exact else seconds, self.now)
        if exact:
            for velocity, lasts in phases(command, seconds, driver.limits):
                self._advance(velocity, lasts)
        while (state := driver.state(self.now)) is not State.DONE:
            if state is State.BLOCKED:
                return driver.give_up()
            self._advance(driver.velocity(self.now) or STILL, _STEP_NANOSECONDS)
        return 0.0

    def _catch_up(self) -> None:
        """The robot's time may be ahead because of a predecessor's clock."""
        ahead = round(self._driver.track.latest * NANOSECONDS)
        if ahead > self.step.end:
            self.step = ClockStep(STILL, ahead, ahead)

    def _advance(self, velocity: Velocity, lasts: int) -> None:
        """Advance the clock, and wait until the robot has reported its state at that time."""
        self.step = ClockStep(velocity, self.step.end, self.step.end + lasts)
        self._wake()
        logged, since = False, time.monotonic()
        with self._answered:
            # Waits without limit: a slow simulator is not a failure.
            while not self._answered.wait_for(lambda: self._measured() >= self.now, _SILENT_AFTER):
                if not logged and time.monotonic() - since >= _SILENT_AFTER:
                    logged = True
                    log(f"no response from {self._where} to clock time {self.now:.3f} s; waiting")
        if logged:
            log(f"{self._where} responds again")


def phases(
    command: DriveCommand, seconds: float, limits: MotorLimits
) -> Iterator[tuple[Velocity, int]]:
    """The constant velocities of a command with durations in nanoseconds: turn, then drive.

    Together they last `seconds`, or longer if the limits of speed and turn require it.
    """
    turn = abs(command.turn_deg) / limits.turn
    drive = abs(command.forward_m) / limits.speed
    spare = max(0.0, seconds - turn - drive)
    busy = bool(command.turn_deg) + bool(command.forward_m)
    if command.turn_deg:
        lasts = _nanoseconds(turn + spare / busy)
        # From the rounded duration, so that velocity times duration is the commanded turn.
        yield Velocity(turn=command.turn_deg / (lasts / NANOSECONDS)), lasts
    if command.forward_m:
        lasts = _nanoseconds(drive + spare / busy)
        yield Velocity(speed=command.forward_m / (lasts / NANOSECONDS)), lasts
    if not busy:
        yield STILL, _nanoseconds(seconds)


def is_rounding(pose: Pose) -> bool:
    """True if a deviation is only rounding."""
    return portable.hypot(pose.x, pose.y) < ROUNDING and abs(pose.angle) < ROUNDING


def _nanoseconds(seconds: float) -> int:
    # Rounded up, because a shorter phase would exceed the limits of the motors.
    return max(1, math.ceil(seconds * NANOSECONDS))
