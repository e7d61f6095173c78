"""Commands carried out step by step on a clock of our own: for simulations that go by /clock.

No time passes for such a robot but what is told here, so a frame waits for it and it for the
frame: what it measures is of the very pose to which its command has led.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from minerva_bus import portable
from minerva_bus.world.poses import Pose
from minerva_services.bridges.ros2.driver import STILL, Driver, State
from minerva_services.bridges.ros2.geometry import Command
from minerva_services.bridges.ros2.link import say
from minerva_services.bridges.ros2.steering import Limits, Velocity

NANO: Final = 1_000_000_000
BEGIN: Final = NANO
"""Where the clock begins: ROS takes 0 for a clock that is not there."""

ROUNDING: Final = 1e-6
"""Metres and degrees below which a robot is where it should be."""

_STEP: Final = NANO // 50
_SILENT: Final = 3.0


@dataclass(frozen=True, slots=True)
class Step:
    """A velocity, and the nanoseconds of the clock from which and until which it counts."""

    velocity: Velocity
    begin: int
    end: int


class Stepper:
    """Takes a robot through its commands; `beat` tells it the step, again and again.

    `measured` is the time, in seconds of the clock, up to which all has been heard that the robot
    measures; `nudge` makes the step be told at once.
    """

    def __init__(
        self, driver: Driver, measured: Callable[[], float], nudge: Callable[[], None], where: str
    ) -> None:
        self._driver, self._measured, self._nudge, self._where = driver, measured, nudge, where
        self._answered = threading.Condition()
        self.step = Step(STILL, BEGIN, BEGIN)

    @property
    def now(self) -> float:
        """Seconds of the clock, to the last bit as those of a message's stamp."""
        whole, rest = divmod(self.step.end, NANO)
        return whole + rest * 1e-9

    def heard(self) -> None:
        """Something has come from the robot."""
        with self._answered:
            self._answered.notify()

    def carry_out(self, command: Command, seconds: float) -> float:
        """Take the robot where a command leads, in `seconds` or more; the metres not driven."""
        driver = self._driver
        self._catch_up()
        exact = is_rounding(driver.offset)
        driver.begin(command, 0.0 if exact else seconds, self.now)
        if exact:
            for velocity, lasts in phases(command, seconds, driver.limits):
                self._advance(velocity, lasts)
        while (state := driver.state(self.now)) is not State.DONE:
            if state is State.BLOCKED:
                return driver.give_up()
            self._advance(driver.velocity(self.now) or STILL, _STEP)
        return 0.0

    def _catch_up(self) -> None:
        """The robot's time may be ahead: of a predecessor's clock."""
        ahead = round(self._driver.track.latest * NANO)
        if ahead > self.step.end:
            self.step = Step(STILL, ahead, ahead)

    def _advance(self, velocity: Velocity, lasts: int) -> None:
        """Let time pass, and wait until the robot has told how it is then."""
        self.step = Step(velocity, self.step.end, self.step.end + lasts)
        self._nudge()
        said, since = False, time.monotonic()
        with self._answered:
            while not self._answered.wait_for(lambda: self._measured() >= self.now, _SILENT):
                if not said and time.monotonic() - since >= _SILENT:
                    said = True
                    say(f"no answer to {self.now:.3f} s on the clock from {self._where}; waiting")
        if said:
            say(f"{self._where} answers again")


def phases(command: Command, seconds: float, limits: Limits) -> Iterator[tuple[Velocity, int]]:
    """The constant velocities, each for so many nanoseconds, that make a command: turn, then drive.

    Together they last `seconds`, or as long as the limits of speed and turn ask for.
    """
    turn = abs(command.turn) / limits.turn
    drive = abs(command.forward) / limits.speed
    spare = max(0.0, seconds - turn - drive)
    busy = bool(command.turn) + bool(command.forward)
    if command.turn:
        lasts = _nanoseconds(turn + spare / busy)
        yield Velocity(turn=command.turn / (lasts / NANO)), lasts
    if command.forward:
        lasts = _nanoseconds(drive + spare / busy)
        yield Velocity(speed=command.forward / (lasts / NANO)), lasts
    if not busy:
        yield STILL, _nanoseconds(seconds)


def is_rounding(pose: Pose) -> bool:
    """Whether so small a difference is rounding, and the robot where it should be."""
    return portable.hypot(pose.x, pose.y) < ROUNDING and abs(pose.angle) < ROUNDING


def _nanoseconds(seconds: float) -> int:
    return max(1, math.ceil(seconds * NANO))
