"""A real robot in place of a simulated one: its motors execute the string's commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Metres
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.bridges.ros2.driver import DriveTolerances, MotorLimits
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.mobile_base import BaseOptions, MobileBase
from minerva_services.bridges.ros2.uses import NetworkUser
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.event_factory import EventFactory
from minerva_services.options import grouped, names_in, takes_options
from minerva_services.physics.body import DriveCommand
from minerva_services.physics.geometry import PhysicalGeometry, Robot

_WAITING_PART: Final = 0.8
"""Of the duration of a frame, the part that may pass in waiting for a robot."""

_NO_DECISIONS: Final = (
    "while its robot is missing, the agent acts, and nothing drives; set decide to the type of the"
    ' event by which it acts ("eDecide"), and remove the process that emits it'
)


class Ros2Robot(Device, Generator, NetworkUser, draws=("eRepresent",), coupled=True):
    """Drives a ROS 2 robot as the views command, and then publishes its readings.

    In a world file it replaces physics and behaves the same: a turn and a move are executed within
    a frame's `dt` of real time, or longer if the limits require it; the time that the world needs
    between two commands counts. Distance not driven is reported by `eCollision(shortfall)`. The
    robot is steered by its odometry. Scans and sightings are published relative to where the string
    has the robot: the difference to odometry at the time of measurement is in their mounts.

    While the robot is missing, frames go on without events of it. Its agent must not act then, so
    the event by which it acts is emitted here, after each command.

    Args:
        router: the endpoint of the robot's network; further options are those of `BaseOptions`,
          `Ros2Network`, `MotorLimits` and `DriveTolerances`.
        robot: the id of the agent whose body it is; optional if there is only one.
        decide: the type of the event by which the agent acts, emitted while the robot is there; no
          other process may emit it.

    """

    source_option: ClassVar[str] = "router"
    outside: ClassVar[str] = "a ROS 2 robot"
    publishes = ("scan", "sightings")

    @takes_options(BaseOptions, Ros2Network, MotorLimits, DriveTolerances)
    def __init__(self, router: str, robot: str = "", decide: str = "", **further: Any) -> None:
        groups = Ros2Network, MotorLimits, DriveTolerances, BaseOptions
        self._parts = grouped({"router": router, **further}, *groups)
        self.network, *_, options = self._parts
        self.uses = options.uses(self.network)
        self._robot, self._decide = robot, decide
        self.concerns = names_in(robot)
        self._begin()

    def _begin(self) -> None:
        self._base = MobileBase(*self._parts)
        self._ordered: Robot | None = None
        self._present: Robot | None = None
        self._start: Pose | None = None
        self._shown: int | None = None
        self._carried_out = -1
        self._collisions = 0
        self._name = self._robot

    def generates(self) -> tuple[str, ...]:
        return tuple(filter(None, ("eCollision", self._decide)))

    def check(self, world: WorldInfo) -> list[str]:
        """What fits no robot. Raises MisuseError without rosbags, or without the events."""
        messages()
        self._parts[-1].check()
        self._collision = EventFactory("ros2_robot", world, "eCollision", shortfall=Metres)
        receivers = (self._robot,) if self._robot else ()
        self._decisions: tuple[Event, ...] = ()
        if not self._decide:
            return [*self.unfit(), _NO_DECISIONS]
        self._decisions = (EventFactory("ros2_robot", world, self._decide)(receivers=receivers),)
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
        """Drive, then publish readings; neither before the first view, nor without the robot."""
        if self._shown is None:
            return self._decisions
        if not self._base.is_ready(_WAITING_PART * tick.dt):
            return ()
        if self._present is None and self._ordered is not None:
            self._present, self._start = self._ordered, self._base.driver.goal
            self._base.begin(self._present.command, tick.dt)
        # Views of meanwhile show the same command once more.
        self._ordered = None
        events: list[Event] = []
        if self._present is not None:
            shortfall = self._base.carry_out(self._present.command, tick.dt)
            if shortfall is None:
                return ()
            if shortfall:
                self._collisions += 1
                events.append(self._collision(shortfall, receivers=(self._name,)))
            self._base.place(self._present)
            self._present = None
        self._carried_out = self._shown
        if self._name:
            self._base.publish(tick, self._name)
        return [*events, *self._decisions]

    def save(self) -> Mapping[str, Any]:
        """The robot's believed pose in the odometry frame, and the last executed view."""
        # A successor begins a command again that is not done.
        goal = self._base.driver.goal if self._present is None else self._start
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
