"""A real robot in place of a simulated one: its motors execute the string's commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Metres
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.bridges.ros2.driver import DriveTolerances, MotorLimits
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.mobile_base import BaseOptions, MobileBase, Topics
from minerva_services.bridges.ros2.uses import NetworkUser
from minerva_services.bridges.ros_messages.frames import mount_of
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.event_factory import EventFactory
from minerva_services.options import check_positive, grouped, takes_options
from minerva_services.physics.body import DriveCommand
from minerva_services.physics.geometry import PhysicalGeometry, Robot
from minerva_services.sensors.playback import checked_offset


class Ros2Robot(
    Device, Generator, NetworkUser, draws=("eRepresent",), coupled=True, events=("eCollision",)
):
    """Drives a ROS 2 robot as the views command, and then publishes its readings.

    In a world file it replaces physics and behaves the same: a turn and a move are executed within
    a frame's `dt` of real time, or longer if the limits require it; the time that the world needs
    between two commands counts. Distance not driven is reported by `eCollision(shortfall)`. The
    robot is steered by its odometry. Scans and sightings are published relative to where the string
    has the robot: the difference to odometry at the time of measurement is in their mounts.

    Args:
        router: the endpoint of the robot's network; further options are those of
          `Ros2Network`, `MotorLimits` and `DriveTolerances`.
        robot: the id of the agent whose body it is; optional if there is only one.
        scan: topic of LaserScan messages.
        odometry: topic of Odometry messages; "": the motors are assumed to do what they are sent.
        detections: topic of Detection3DArray messages, whose classes are markers.
        cmd_vel: topic of the velocities.
        stamped: velocities are TwistStamped messages, not Twist.
        base: the robot's base frame.
        mount: "x, y, degrees" of the laser on the robot; "": from /tf_static.
        time_offset: seconds added to the times of scans if the lidar's clock differs from that of
            odometry.
        map_frame: if set, the transform from it to the odometry frame is published on /tf.
        rate: velocities per second.
        clock: topic of Clock messages, for a simulation driven by them: it receives the time, and
            must answer each step with all its readings of that time.
        qos: the quality of service of topics, by option: {scan = "sensor_data"}.

    """

    source_option: ClassVar[str] = "router"
    publishes = ("scan", "sightings")

    @takes_options(Ros2Network, MotorLimits, DriveTolerances)
    def __init__(
        self,
        router: str,
        robot: str = "",
        scan: str = "scan",
        odometry: str = "odom",
        detections: str = "detections",
        cmd_vel: str = "cmd_vel",
        stamped: bool = False,
        base: str = "base_link",
        mount: str = "",
        time_offset: float = 0.0,
        map_frame: str = "",
        rate: float = 20.0,
        clock: str = "",
        qos: Mapping[str, Any] | None = None,
        **further: Any,
    ) -> None:
        options = {"router": router, **further}
        network, limits, tolerances = grouped(options, Ros2Network, MotorLimits, DriveTolerances)
        self._options = BaseOptions(
            network,
            Topics(scan, odometry, detections, cmd_vel, clock),
            # A simulation needs the time from which a velocity applies.
            stamped or bool(clock),
            base,
            mount_of(mount),
            map_frame,
            checked_offset(time_offset),
            limits,
            tolerances,
            check_positive("ros2", "rate", rate),
            qos,
        )
        topics = self._options.topics
        network.name(topics.cmd_vel)
        if topics.clock and not topics.odometry:
            raise MisuseError("ros2_robot: a robot driven by a clock must publish odometry")
        self.network, self.uses = network, self._options.uses()
        self._robot = robot
        self._begin()

    def _begin(self) -> None:
        self._base = MobileBase(self._options)
        self._ordered: Robot | None = None
        self._shown: int | None = None
        self._carried_out = -1
        self._collisions = 0
        self._name = self._robot

    def check(self, world: WorldInfo) -> list[str]:
        """What fits no robot. Raises MisuseError without rosbags, or without the event."""
        messages()
        self._collision = EventFactory("ros2_robot", world, "eCollision", shortfall=Metres)
        return self.unfit()

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        self._begin()
        self._base.connect()

    def show(self, view: View) -> None:
        """φ of the view: the robot's command, for the next tick. Raises MisuseError."""
        seen = PhysicalGeometry()
        interpret(view.scene, seen)
        self._shown = view.frame
        # A successor receives the last view again, which its predecessor may have executed.
        new = view.frame > self._carried_out
        ordered = self._own(seen.robots) if new else None
        halted = ordered is not None and self._name in view.halted
        # An empty command instead of none: a halted robot still has a place on the map.
        self._ordered = replace(ordered, command=DriveCommand()) if ordered and halted else ordered

    def generate(self, tick: Tick) -> Iterable[Event]:
        """Drive, then publish readings; nothing before the first view."""
        if self._shown is None:
            return ()
        self._base.wait_until_ready()
        ordered, self._ordered = self._ordered, None
        events: list[Event] = []
        if ordered is not None:
            shortfall = self._base.carry_out(ordered.command, tick.dt)
            if shortfall:
                self._collisions += 1
                events.append(self._collision(shortfall, receivers=(self._name,)))
            self._base.place(ordered)
        self._carried_out = self._shown
        if self._name:
            self._base.publish(tick, self._name)
        return events

    def save(self) -> Mapping[str, Any]:
        """The robot's believed pose in the odometry frame, and the last executed view."""
        goal = self._base.driver.goal
        pose = [] if goal is None else [goal.x, goal.y, goal.angle]
        return {"goal": pose, "carried_out": self._carried_out}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Continue from a saved state. Raises MisuseError for other values."""
        try:
            self._carried_out = int(saved["carried_out"])
            if saved["goal"]:
                self._base.driver.set_goal(Pose(*map(float, saved["goal"])))
        except (KeyError, TypeError, ValueError) as error:
            raise MisuseError(f"ros2: not the saved state of a robot: {error!r}") from error

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Counts, and the state of the link."""
        counts = self._base.counts
        return {**counts, "collisions": self._collisions, "source": self._base.state}

    def close(self) -> None:
        """Stop the motors and leave the network."""
        self._base.close()

    def _own(self, robots: Mapping[str, Robot]) -> Robot | None:
        names = sorted(robots)
        if not self._robot and len(names) > 1:
            raise MisuseError(
                f"ros2_robot: the view shows {', '.join(names[:5])}, but there is one body;"
                f' name its agent (robot = "{names[0]}")'
            )
        self._name = self._robot or (names[0] if names else self._name)
        return robots.get(self._name)
