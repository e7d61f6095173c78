"""A ROS 2 robot as hardware: its link, motors and sensors, and the execution of commands."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final

from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Mount
from minerva_bus.world.recordings import ClockWatch
from minerva_bus.world.services import Tick
from minerva_services.bridges.ros2.buffers import ReadingPublisher, SensorBuffers
from minerva_services.bridges.ros2.driver import STILL, Driver, DriveTolerances, State
from minerva_services.bridges.ros2.link import NetworkLink
from minerva_services.bridges.ros2.motors import Motors
from minerva_services.bridges.ros2.network import Ros2Network
from minerva_services.bridges.ros2.session import Ros2Session
from minerva_services.bridges.ros2.steering import MotorLimits, driven
from minerva_services.bridges.ros2.stepping import Stepper
from minerva_services.bridging.bridge import log
from minerva_services.physics.body import DriveCommand
from minerva_services.physics.geometry import Robot

_MAX_DELAY_FRAMES: Final = 5.0
"""Delay in frames up to which the schedule is kept; beyond it, it restarts."""


@dataclass(slots=True)
class FramePacer:
    """When the current command should end.

    The time that the world needs between two commands, to measure, decide and distribute, counts
    towards the second: meanwhile the robot still drives towards the end of the first.
    """

    due: float = -math.inf

    def begin(self, seconds: float, now: float) -> float:
        """The time left for a command that begins now, of its nominal duration."""
        late = now - self.due
        # A late command gets the rest of its time, at least 0 s; a pause starts a new schedule.
        self.due = (
            max(self.due + seconds, now) if late < _MAX_DELAY_FRAMES * seconds else now + seconds
        )
        return self.due - now


_POLL_SECONDS: Final = 0.005
_SILENT_SECONDS: Final = 3.0


@dataclass(frozen=True, slots=True)
class Topics:
    """ROS topics of a robot; an empty name means that the topic is not used."""

    scan: str
    odometry: str
    detections: str
    cmd_vel: str
    clock: str


@dataclass(frozen=True, slots=True)
class BaseOptions:
    """Configuration of a robot: its network, topics, frames, mount, limits and rates."""

    network: Ros2Network
    topics: Topics
    stamped: bool
    base: str
    mount: Mount | None
    map_frame: str
    time_offset: float
    limits: MotorLimits
    tolerances: DriveTolerances
    rate: float


class MobileBase:
    """Drives a robot by its odometry, and buffers its readings.

    A world's frames call `carry_out` and `publish`; the link's thread calls `_declare` and `_beat`.
    """

    def __init__(self, options: BaseOptions) -> None:
        self._options = options
        topics = options.topics
        self.driver = Driver(options.limits, options.tolerances)
        self._pacer = FramePacer()
        self._stepper = self._new_stepper() if topics.clock else None
        notify = self._stepper.notify if self._stepper else lambda: None
        self._sensors = SensorBuffers(
            options.base, options.mount, self._moved, notify, options.time_offset
        )
        self._publisher = ReadingPublisher(self.driver, self._sensors)
        self._motors = Motors(
            topics.cmd_vel, topics.clock, options.map_frame, options.base, stamped=options.stamped
        )
        self._sent = STILL, time.monotonic()
        self._clock = ClockWatch()
        self._link: NetworkLink | None = None

    def connect(self) -> None:
        """Start connecting to the robot, in a thread of the link."""
        period = 1.0 / self._options.rate
        network = self._options.network
        self._link = NetworkLink(network, "minerva_motors", self._declare, self._beat, period)
        self._link.start()

    def close(self) -> None:
        """Stop the motors and leave the network."""
        self.driver.stop()
        if self._link is not None:
            self._link.close()

    @property
    def counts(self) -> dict[str, int]:
        """Skipped messages by reason, and jumps of odometry."""
        jumps = self.driver.jumps + self.driver.track.restarts
        return {**self._sensors.counts, "odometry jumps": jumps}

    @property
    def state(self) -> str:
        """State of the link, as reported to people."""
        state = self._link.state if self._link is not None else "not open yet"
        has_odometry = not self._options.topics.odometry or self.driver.has_odometry(self._now())
        return state if state != "open" or has_odometry else "open, but no odometry"

    # --- called by the world's frames ---

    def wait_until_ready(self) -> None:
        """Wait for the first odometry and scan: nothing is driven blindly."""
        logged, since = False, time.monotonic()
        while missing := self._missing():
            if not logged and time.monotonic() - since > _SILENT_SECONDS:
                logged = True
                log(f"no {' and no '.join(missing)} from {self._router} yet")
            time.sleep(_POLL_SECONDS)

    def carry_out(self, command: DriveCommand, seconds: float) -> float:
        """Execute a command; the distance not driven in metres, once there is no more progress."""
        if self._stepper is not None:
            return self._stepper.carry_out(command, seconds)
        now = time.monotonic()
        self.driver.begin(command, self._pacer.begin(seconds, now), now)
        # Otherwise the first velocity of the command would wait for the next beat.
        self._wake()
        lost = False
        while (state := self.driver.state(time.monotonic())) is not State.DONE:
            if state is State.BLOCKED:
                return self.driver.give_up()
            if state is State.LOST and not lost:
                lost = True
                log(f"no odometry from {self._router}; stopped until it returns")
            elif lost and state is State.DRIVING:
                lost = False
                log(f"odometry from {self._router} has returned")
            time.sleep(_POLL_SECONDS)
        return 0.0

    def place(self, ordered: Robot) -> None:
        """Publish the pose of the odometry frame on the map, given the string's robot."""
        goal, command = self.driver.goal, ordered.command
        turned = Pose().compose(ordered.believed).compose(Pose(angle=command.turn_deg))
        world = turned.compose(Pose(x=command.forward_m))
        if goal is not None:
            self._motors.place(self._sensors.odometry_frame, world.compose(goal.seen(Pose())))

    def publish(self, tick: Tick, robot: str) -> None:
        """Publish the readings of this tick."""
        self._publisher.publish(tick, robot)

    @property
    def _router(self) -> str:
        return self._options.network.router

    def _missing(self) -> list[str]:
        topics = self._options.topics
        missing = [] if self.driver.goal is not None else [topics.odometry or "link"]
        return missing if self._sensors.scanned or not topics.scan else [*missing, "scan"]

    # --- called by threads of the link and of Zenoh ---

    def _declare(self, session: Ros2Session) -> None:
        topics = self._options.topics
        self._sensors.listen(session, topics.scan, topics.odometry, topics.detections)
        self._motors.declare(session)

    def _beat(self) -> None:
        """Send the current velocity, or the current step of the simulation."""
        if self._stepper is not None:
            self._motors.step(self._stepper.step)
            return
        now = time.monotonic()
        velocity = self.driver.velocity(now)
        if velocity is not None:
            self._motors.go(velocity)
        if not self._options.topics.odometry:
            # Without odometry the motors are assumed to do exactly what was sent.
            pose, elapsed = self.driver.track.newest or Pose(), now - self._sent[1]
            self.driver.update(now, driven(pose, self._sent[0], elapsed), now)
        self._sent = velocity or STILL, now

    def _moved(self, stamp: float, pose: Pose) -> None:
        if step := self._clock.step("odometry", stamp):
            log(f"{self._router}: {step}")
        jumps = self.driver.jumps
        self.driver.update(stamp, pose, time.monotonic() if self._stepper is None else stamp)
        if self.driver.jumps > jumps:
            log(f"odometry from {self._router} jumped; assuming that the robot has not moved")

    def _now(self) -> float:
        """Seconds of the clock by which the robot drives."""
        return time.monotonic() if self._stepper is None else self._stepper.now

    def _wake(self) -> None:
        if self._link is not None:
            self._link.wake()

    def _new_stepper(self) -> Stepper:
        topics = self._options.topics

        def measured() -> float:
            sensors = self._sensors.measured(
                scan=bool(topics.scan), detections=bool(topics.detections)
            )
            return min(self.driver.track.latest, sensors)

        return Stepper(self.driver, measured, self._wake, self._router)
