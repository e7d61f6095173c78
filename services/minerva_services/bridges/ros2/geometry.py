"""The geometric system G of a real robot: what a string means to its motors.

TPlace(...)    the position of its scope; commands start over
TRotate(...)   turn command for the robot within
TMove(...)     drive command for the robot within
PRobot         a named robot, with the commands within the innermost TPlace
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

from minerva_bus.errors import MisuseError
from minerva_bus.semantics.geometry import Geometry
from minerva_bus.world.poses import Pose


@dataclass(frozen=True, slots=True)
class MotorCommand:
    """A robot's command for one frame: turn by degrees on the spot, then drive metres."""

    turn: float = 0.0
    forward: float = 0.0


@dataclass(frozen=True, slots=True)
class OrderedRobot:
    """A robot as shown by a string: its believed pose and its next command."""

    believed: Pose
    command: MotorCommand


class MotorGeometry(Geometry):
    """The robots of one string, by name; filled by φ."""

    def __init__(self) -> None:
        self.robots: dict[str, OrderedRobot] = {}
        self._place = Pose()
        self._command = MotorCommand()

    def PRobot(self, name: str, **_: object) -> None:
        """α: a robot and its command."""
        if name in self.robots:
            raise MisuseError(f"ros2: robot {name!r} appears twice in the view")
        self.robots[name] = OrderedRobot(self._place, self._command)

    @contextmanager
    def TPlace(self, x: float, y: float, angle: float) -> Generator[None]:
        """β: set the position and reset commands; δ: restore both."""
        outside = self._place, self._command
        self._place, self._command = self._place.then(Pose(x, y, angle)), MotorCommand()
        yield
        self._place, self._command = outside

    @contextmanager
    def TRotate(self, angle: float) -> Generator[None]:
        """β: add a turn in degrees, counter-clockwise; δ: restore."""
        outside = self._command
        if angle and outside.forward:
            raise MisuseError(
                f"ros2: TRotate<angle={angle:g}> within TMove<dist={outside.forward:g}>: in one"
                " frame a robot first turns, then drives; put TMove within TRotate"
            )
        self._command = MotorCommand(outside.turn + angle, outside.forward)
        yield
        self._command = outside

    @contextmanager
    def TMove(self, dist: float) -> Generator[None]:
        """β: add a distance in metres along the heading; δ: restore."""
        outside = self._command
        self._command = MotorCommand(outside.turn, outside.forward + dist)
        yield
        self._command = outside
