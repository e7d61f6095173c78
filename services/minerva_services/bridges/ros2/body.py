"""A real robot in the place of the simulated one: its motors carry out what the string commands."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Metres
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.poses import Pose
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.bridges.ros2.driver import STILL, Care, Driver, State
from minerva_services.bridges.ros2.geometry import Command, MotorGeometry, Ordered
from minerva_services.bridges.ros2.link import Link, say
from minerva_services.bridges.ros2.messages import messages
from minerva_services.bridges.ros2.motors import Motors
from minerva_services.bridges.ros2.mounts import mount_of
from minerva_services.bridges.ros2.network import Network, Tls
from minerva_services.bridges.ros2.rhythm import Rhythm
from minerva_services.bridges.ros2.senses import Senses
from minerva_services.bridges.ros2.session import Session
from minerva_services.bridges.ros2.steering import Limits, driven
from minerva_services.bridges.ros2.stepping import Stepper
from minerva_services.bridges.ros2.telling import Teller
from minerva_services.event_factory import EventFactory
from minerva_services.sensors.playing import checked_offset

_GLANCE: Final = 0.005
_SILENT: Final = 3.0


@dataclass(frozen=True, slots=True)
class _Topics:
    scan: str
    odometry: str
    detections: str
    cmd_vel: str
    clock: str


class Ros2Robot(Device, Generator, draws=("eRepresent",), coupled=True, events=("eCollision",)):
    """Drives a ROS 2 robot as the views command, and publishes what it measures after that.

    It stands in a world file where physics would, and to the world it is the same: a turn and a
    move are carried out within a frame's `dt` of real time, or as much longer as the limits make
    of it; the time that the world needs between two commands is part of it. What the robot is
    short of is told by `eCollision(shortfall)`. The robot is steered by its odometry. Scans and
    sightings are told as from where the string has the robot: what is between that and where
    odometry had it when they were taken is in their mounts.

    Args:
        router: the endpoint of the robot's Zenoh router or zenoh-bridge-ros2dds.
        robot: the id of the agent whose body it is; may be left out where there is one only.
        layout: "rmw_zenoh", or "dds" for a zenoh-bridge-ros2dds.
        domain: the ROS domain, for rmw_zenoh.
        namespace: what stands before all topics that do not begin with a slash.
        humble: the robot runs ROS 2 Humble, which has no type hashes.
        scan: topic of LaserScan messages.
        odometry: topic of Odometry messages; "": the motors are believed to do what they are told.
        detections: topic of Detection3DArray messages, whose classes are markers.
        cmd_vel: topic of the velocities.
        stamped: velocities are TwistStamped messages, not Twist.
        base: the robot's own frame.
        mount: "x, y, degrees" of the laser on the robot; "": as /tf_static has it.
        time_offset: seconds that are added to the times of scans, where the lidar's clock is not
            that of the odometry.
        map_frame: if it is given, the transform from it to the frame of odometry is on /tf.
        speed: m/s at most.
        turn: degrees/s at most.
        acceleration: m/s² at most.
        turn_acceleration: degrees/s² at most.
        near: metres that may be missing when the next command begins.
        aligned: degrees that may be missing then.
        patience: seconds without progress after which a command is taken to be blocked.
        silence: seconds without odometry after which the robot stops, and the world waits.
        dead_man: seconds without a command after which the robot stops.
        rate: velocities in a second.
        clock: topic of Clock messages, for a simulation that goes by them: it is told how time
            passes, and must answer each time with all that it measures, of that time.
        authority: for tls/: the certificate of who has signed the router's, a PEM file.
        certificate: our own, where the router asks for one.
        key: and its private key.

    """

    source_option: ClassVar[str] = "router"
    publishes = ("scan", "sightings")

    def __init__(
        self,
        router: str,
        robot: str = "",
        layout: str = "rmw_zenoh",
        domain: int = 0,
        namespace: str = "",
        humble: bool = False,
        scan: str = "scan",
        odometry: str = "odom",
        detections: str = "detections",
        cmd_vel: str = "cmd_vel",
        stamped: bool = False,
        base: str = "base_link",
        mount: str = "",
        time_offset: float = 0.0,
        map_frame: str = "",
        speed: float = 0.3,
        turn: float = 90.0,
        acceleration: float = 1.0,
        turn_acceleration: float = 360.0,
        near: float = 0.1,
        aligned: float = 10.0,
        patience: float = 1.5,
        silence: float = 0.5,
        dead_man: float = 0.5,
        rate: float = 20.0,
        clock: str = "",
        authority: str = "",
        certificate: str = "",
        key: str = "",
    ) -> None:
        tls = Tls(authority, certificate, key)
        self._network = Network(router, layout, domain, namespace, humble, tls)
        self._topics = _Topics(scan, odometry, detections, cmd_vel, clock)
        if clock and not odometry:
            raise MisuseError("ros2_robot: a robot that goes by a clock tells its odometry")
        for topic in (scan, odometry, detections, clock):
            if topic:
                self._network.name(topic)
        self._network.name(cmd_vel)
        self._robot, self._stamped, self._base = robot, stamped or bool(clock), base
        self._mount, self._map_frame = mount_of(mount), map_frame
        self._time_offset = checked_offset(time_offset)
        self._limits = Limits(speed, turn, acceleration, turn_acceleration)
        self._care = Care(
            _positive("near", near), _positive("aligned", aligned),
            _positive("patience", patience), _positive("silence", silence),
            _positive("dead_man", dead_man),
        )  # fmt: skip
        self._rate = _positive("rate", rate)
        self._link: Link | None = None
        self._begin()

    def _begin(self) -> None:
        self._driver = Driver(self._limits, self._care)
        self._rhythm = Rhythm()
        self._ordered: Ordered | None = None
        self._shown: int | None = None
        self._carried_out = -1
        self._collisions = 0
        self._stepper = self._stepped() if self._topics.clock else None
        heard = self._stepper.heard if self._stepper else lambda: None
        self._senses = Senses(self._base, self._mount, self._moved, heard, self._time_offset)
        self._teller = Teller(self._driver, self._senses)
        self._motors = Motors(
            self._topics.cmd_vel, self._topics.clock, self._map_frame, self._base,
            stamped=self._stamped,
        )  # fmt: skip
        self._told = STILL, _now()
        self._name = self._robot

    def _stepped(self) -> Stepper:
        def measured() -> float:
            topics = self._topics
            senses = self._senses.measured(
                scan=bool(topics.scan), detections=bool(topics.detections)
            )
            return min(self._driver.track.latest, senses)

        def nudge() -> None:
            if self._link is not None:
                self._link.nudge()

        return Stepper(self._driver, measured, nudge, self._network.router)

    # --- the world's side ---

    def joined(self, world: WorldInfo) -> None:
        """Raises MisuseError where rosbags is missing, or the world has no such event."""
        messages()
        self._collision = EventFactory("ros2_robot", world, "eCollision", shortfall=Metres)
        self._begin()
        period = 1.0 / self._rate
        self._link = Link(self._network, "minerva_motors", self._declare, self._beat, period)
        self._link.start()

    def show(self, view: View) -> None:
        """φ of the view: the robot's command, for the next tick. Raises MisuseError."""
        seen = MotorGeometry()
        interpret(view.scene, seen)
        self._shown = view.frame
        # A successor is shown the last view again, which its predecessor may have carried out.
        new = view.frame > self._carried_out
        ordered = self._mine(seen.robots) if new else None
        halted = ordered is not None and self._name in view.halted
        self._ordered = replace(ordered, command=Command()) if ordered and halted else ordered

    def generate(self, tick: Tick) -> Iterable[Event]:
        """Drive, then tell what was measured; before the first view there is nothing to do."""
        if self._shown is None:
            return ()
        self._wait_until_heard()
        ordered, self._ordered = self._ordered, None
        events: list[Event] = []
        if ordered is not None:
            shortfall = self._carry_out(ordered.command, tick.dt)
            if shortfall:
                self._collisions += 1
                events.append(self._collision(shortfall, receivers=(self._name,)))
            self._place(ordered)
        self._carried_out = self._shown
        if self._name:
            self._teller.tell(tick, self._name)
        return events

    def save(self) -> Mapping[str, Any]:
        """Where the robot is believed to be in its odometry's frame, and which view that was."""
        goal = self._driver.goal
        pose = [] if goal is None else [goal.x, goal.y, goal.angle]
        return {"goal": pose, "carried_out": self._carried_out}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from there. Raises MisuseError where the value is not what `save` returns."""
        try:
            self._carried_out = int(saved["carried_out"])
            if saved["goal"]:
                self._driver.set_goal(Pose(*map(float, saved["goal"])))
        except (KeyError, TypeError, ValueError) as error:
            raise MisuseError(f"ros2: not the saved state of a robot: {error!r}") from error

    def report(self) -> Mapping[str, bool | int | float | str]:
        """How the link is, and what was counted."""
        state = self._link.state if self._link is not None else "not open yet"
        if state == "open" and self._topics.odometry and not self._driver.listening(self._now()):
            state = "open, but no odometry"
        return {
            **self._senses.counts,
            "collisions": self._collisions,
            "odometry jumps": self._driver.jumps + self._driver.track.restarts,
            "source": state,
        }

    def close(self) -> None:
        """Stop the motors and leave the network."""
        self._driver.stop()
        if self._link is not None:
            self._link.close()

    # --- a frame ---

    def _mine(self, robots: Mapping[str, Ordered]) -> Ordered | None:
        names = sorted(robots)
        if not self._robot and len(names) > 1:
            raise MisuseError(
                f"ros2_robot: there are {', '.join(names[:5])} in the view, and one body;"
                f' say whose it is (robot = "{names[0]}")'
            )
        self._name = self._robot or (names[0] if names else self._name)
        return robots.get(self._name)

    def _wait_until_heard(self) -> None:
        """Nothing is driven blindly: before it there are odometry and a scan."""
        said, since = False, _now()
        while not self._ready():
            if not said and _now() - since > _SILENT:
                said = True
                say(f"no {' and no '.join(self._missing())} from {self._network.router} yet")
            time.sleep(_GLANCE)

    def _ready(self) -> bool:
        return self._driver.goal is not None and (self._senses.scanned or not self._topics.scan)

    def _missing(self) -> list[str]:
        odometry = self._topics.odometry or "link"
        missing = [] if self._driver.goal is not None else [odometry]
        return missing if self._senses.scanned or not self._topics.scan else [*missing, "scan"]

    def _carry_out(self, command: Command, seconds: float) -> float:
        """Drive; the metres that were not driven, once nothing more comes of it."""
        if self._stepper is not None:
            return self._stepper.carry_out(command, seconds)
        now = _now()
        self._driver.begin(command, self._rhythm.begin(seconds, now), now)
        if self._link is not None:
            self._link.nudge()
        lost = False
        while (state := self._driver.state(_now())) is not State.DONE:
            if state is State.BLOCKED:
                return self._driver.give_up()
            if state is State.LOST and not lost:
                lost = True
                say(f"no odometry from {self._network.router}; stopped until it is back")
            elif lost and state is State.DRIVING:
                lost = False
                say(f"odometry from {self._network.router} is back")
            time.sleep(_GLANCE)
        return 0.0

    def _place(self, ordered: Ordered) -> None:
        """Tell /tf where odometry's frame lies on the map."""
        goal, command = self._driver.goal, ordered.command
        world = ordered.believed.then(Pose(angle=command.turn)).then(Pose(x=command.forward))
        if goal is not None:
            self._motors.place(self._senses.odometry_frame, world.then(goal.seen(Pose())))

    # --- the robot's side, in threads of its link ---

    def _declare(self, session: Session) -> None:
        topics = self._topics
        self._senses.listen(session, topics.scan, topics.odometry, topics.detections)
        self._motors.declare(session)

    def _beat(self) -> None:
        """Tell the motors how fast, if anybody wants them to move."""
        if self._stepper is not None:
            self._motors.step(self._stepper.step)
            return
        now = _now()
        velocity = self._driver.velocity(now)
        if velocity is not None:
            self._motors.go(velocity)
        if not self._topics.odometry:
            pose, elapsed = self._driver.track.newest or Pose(), now - self._told[1]
            self._driver.heard(now, driven(pose, self._told[0], elapsed), now)
        self._told = velocity or STILL, now

    def _now(self) -> float:
        """Seconds of the clock by which the robot drives."""
        return _now() if self._stepper is None else self._stepper.now

    def _moved(self, time: float, pose: Pose) -> None:
        jumps = self._driver.jumps
        self._driver.heard(time, pose, _now() if self._stepper is None else time)
        if self._driver.jumps > jumps:
            say(f"odometry from {self._network.router} has jumped; the robot is taken to stand")


def _now() -> float:
    return time.monotonic()


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise MisuseError(f"ros2: {name} is {value!r}; expected a number above 0")
    return float(value)
