"""The physical geometric system G (3.1.1): what a string means to walls, markers and bodies.

PMap           walls round its free cells
PMarker        a marker, where it stands
TPlace(...)    where its scope stands
TRotate(...)   the command to turn, for the body within
TMove(...)     the command to drive, for the body within
PRobot         a body, where the innermost TPlace says, with the commands within that TPlace
"""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.semantics.geometry import Geometry
from minerva_services.physics.body import Command, Pose
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.sweep import Point

_NONE = Command(0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """An occupancy matrix with its lower-left corner at a place in the world.

    Attributes:
        cells: rows along x, columns along y; 0 is free.
        resolution: side of a cell in metres.
        corner: place of the lower-left corner, and the turn of the matrix about it.

    """

    cells: NDArray[np.int16]
    resolution: float
    corner: Pose

    def same_as(self, other: Floor) -> bool:
        """Whether both have the same walls; quick where the matrix is the very same."""
        if (self.resolution, self.corner) != (other.resolution, other.corner):
            return False
        return self.cells is other.cells or np.array_equal(self.cells, other.cells)


@dataclass(frozen=True, slots=True)
class Robot:
    """A body as a string has it.

    Attributes:
        believed: where the string says that it is; true only while the body is new.
        radius: in metres.
        command: what it is to do next.

    """

    believed: Pose
    radius: float
    command: Command


class PhysicalGeometry(Geometry):
    """What one string holds; φ of the string fills it.

    Attributes:
        floors: in the order of the string.
        markers: places in metres by name.
        robots: by name.

    """

    def __init__(self) -> None:
        self.floors: list[Floor] = []
        self.markers: dict[str, Point] = {}
        self.robots: dict[str, Robot] = {}
        self._place = Pose(0.0, 0.0, 0.0)
        self._command = _NONE

    def PMap(
        self, cells: NDArray[np.int16], resolution: float, x: float, y: float, angle: float
    ) -> None:
        """α: walls."""
        self.floors.append(Floor(cells, resolution, _within(self._here(), x, y, angle)))

    def PMarker(self, name: str) -> None:
        """α: a marker."""
        if name in self.markers:
            raise PhysicsError(f"marker {name!r} stands twice in the view; give each its own name")
        here = self._here()
        self.markers[name] = here.x, here.y

    def PRobot(self, name: str, radius: float) -> None:
        """α: a body and its command."""
        if name in self.robots:
            raise PhysicsError(f"body {name!r} stands twice in the view; give each its own name")
        self.robots[name] = Robot(self._place, radius, self._command)

    @contextmanager
    def TPlace(self, x: float, y: float, angle: float) -> Generator[None]:
        """β: what follows is here, and commands begin anew; δ: as before."""
        outside = self._place, self._command
        self._place, self._command = _within(self._here(), x, y, angle), _NONE
        yield
        self._place, self._command = outside

    @contextmanager
    def TRotate(self, angle: float) -> Generator[None]:
        """β: turn by degrees counter-clockwise; δ: as before."""
        outside = self._command
        if angle and outside.forward_m:
            raise PhysicsError(
                f"TRotate<angle={angle:g}> within TMove<dist={outside.forward_m:g}>: in one frame"
                " a body turns first and then drives; put TMove within TRotate"
            )
        self._command = Command(outside.turn_deg + angle, outside.forward_m)
        yield
        self._command = outside

    @contextmanager
    def TMove(self, dist: float) -> Generator[None]:
        """β: drive metres along the heading; δ: as before."""
        outside = self._command
        self._command = Command(outside.turn_deg, outside.forward_m + dist)
        yield
        self._command = outside

    def _here(self) -> Pose:
        """The place at which a thing that is no body stands: moves around it only place it."""
        turned = _within(self._place, 0.0, 0.0, self._command.turn_deg)
        return _within(turned, self._command.forward_m, 0.0, 0.0)


def _within(outer: Pose, x: float, y: float, angle: float) -> Pose:
    """The world pose of a pose that is given in the coordinates of another."""
    heading = math.radians(outer.angle)
    cos, sin = portable.cos(heading), portable.sin(heading)
    return Pose(outer.x + (x * cos - y * sin), outer.y + (x * sin + y * cos), outer.angle + angle)
