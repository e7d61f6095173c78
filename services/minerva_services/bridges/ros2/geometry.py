"""The geometric system G of a real robot: what a string means to its motors.

TPlace(...)    where its scope stands; commands begin anew
TRotate(...)   the command to turn, for the robot within
TMove(...)     the command to drive, for the robot within
PRobot         a robot of a name, with the commands within the innermost TPlace
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

from minerva_bus.errors import MisuseError
from minerva_bus.semantics.geometry import Geometry
from minerva_bus.world.poses import Pose


@dataclass(frozen=True, slots=True)
class Command:
    """What a robot is to do in one frame: turn by degrees on the spot, then drive metres."""

    turn: float = 0.0
    forward: float = 0.0


@dataclass(frozen=True, slots=True)
class Ordered:
    """A robot as a string has it: where it is believed to be, and what it is to do next."""

    believed: Pose
    command: Command


class MotorGeometry(Geometry):
    """The robots of one string, by name; φ of the string fills it."""

    def __init__(self) -> None:
        self.robots: dict[str, Ordered] = {}
        self._place = Pose()
        self._command = Command()

    def PRobot(self, name: str, **_: object) -> None:
        """α: a robot and its command."""
        if name in self.robots:
            raise MisuseError(f"ros2: robot {name!r} stands twice in the view; it has one body")
        self.robots[name] = Ordered(self._place, self._command)

    @contextmanager
    def TPlace(self, x: float, y: float, angle: float) -> Generator[None]:
        """β: what follows is here, and commands begin anew; δ: as before."""
        outside = self._place, self._command
        self._place, self._command = self._place.then(Pose(x, y, angle)), Command()
        yield
        self._place, self._command = outside

    @contextmanager
    def TRotate(self, angle: float) -> Generator[None]:
        """β: turn by degrees counter-clockwise; δ: as before."""
        outside = self._command
        if angle and outside.forward:
            raise MisuseError(
                f"ros2: TRotate<angle={angle:g}> within TMove<dist={outside.forward:g}>: in one"
                " frame a robot turns first and then drives; put TMove within TRotate"
            )
        self._command = Command(outside.turn + angle, outside.forward)
        yield
        self._command = outside

    @contextmanager
    def TMove(self, dist: float) -> Generator[None]:
        """β: drive metres along the heading; δ: as before."""
        outside = self._command
        self._command = Command(outside.turn, outside.forward + dist)
        yield
        self._command = outside
