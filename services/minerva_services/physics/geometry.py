"""The physical geometric system G (3.1.1): what a string means to walls, markers and bodies.

PMap           walls around its free cells
PMarker        a marker at its position
TPlace(...)    the position of its scope
TRotate(...)   turn command for the body within
TMove(...)     drive command for the body within
PRobot         a body at the innermost TPlace, with the commands within that TPlace
"""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.semantics.geometry import Geometry
from minerva_bus.semantics.poses import Pose
from minerva_bus.values import fast_dataclass
from minerva_services.physics.body import DriveCommand
from minerva_services.physics.encounters import Point
from minerva_services.physics.errors import PhysicsError


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """An occupancy matrix and the pose of its lower-left corner.

    Attributes:
        cells: rows along x, columns along y; 0 is free.
        resolution: side of a cell in metres.
        corner: pose of the lower-left corner.

    """

    cells: NDArray[np.int16]
    resolution: float
    corner: Pose

    def same_as(self, other: FloorPlan) -> bool:
        """True if both have the same walls; fast if they share the matrix."""
        if (self.resolution, self.corner) != (other.resolution, other.corner):
            return False
        return self.cells is other.cells or np.array_equal(self.cells, other.cells)


@fast_dataclass
class Robot:
    """A body as shown by a string.

    Attributes:
        believed: its pose according to the string; used only for new bodies.
        radius: in metres.
        command: its next command.

    """

    believed: Pose
    radius: float
    command: DriveCommand


class PhysicalGeometry(Geometry):
    """Contents of one string, collected by φ.

    Attributes:
        floors: in the order of the string.
        markers: positions in metres by name.
        robots: by name.

    """

    def __init__(self) -> None:
        self.floors: list[FloorPlan] = []
        self.markers: dict[str, Point] = {}
        self.robots: dict[str, Robot] = {}
        self._place = Pose(0.0, 0.0, 0.0)
        self._command = DriveCommand()

    def PMap(
        self, cells: NDArray[np.int16], resolution: float, x: float, y: float, angle: float
    ) -> None:
        """α: walls."""
        self.floors.append(FloorPlan(cells, resolution, _within(self._here(), x, y, angle)))

    def PMarker(self, name: str) -> None:
        """α: a marker."""
        if name in self.markers:
            raise PhysicsError(f"marker {name!r} appears twice in the view; make the names unique")
        here = self._here()
        self.markers[name] = here.x, here.y

    def PRobot(self, name: str, radius: float) -> None:
        """α: a body and its command."""
        if not name or "\n" in name or "\t" in name:
            raise PhysicsError(f"a body is called {name!r}; give it the id of its agent")
        if name in self.robots:
            raise PhysicsError(f"body {name!r} appears twice in the view; make the names unique")
        # Not at `_here()`: moves around a body are its command, not its position.
        self.robots[name] = Robot(self._place, radius, self._command)

    @contextmanager
    def TPlace(self, x: float, y: float, angle: float) -> Generator[None]:
        """β: set the position and reset commands; δ: restore both."""
        outside = self._place, self._command
        self._place, self._command = _within(self._here(), x, y, angle), DriveCommand()
        # Without `finally`: an error ends the interpretation, and this geometry is not used again.
        yield
        self._place, self._command = outside

    @contextmanager
    def TRotate(self, angle: float) -> Generator[None]:
        """β: add a turn in degrees, counter-clockwise; δ: restore."""
        outside = self._command
        if angle and outside.forward_m:
            raise PhysicsError(
                f"TRotate<angle={angle:g}> within TMove<dist={outside.forward_m:g}>: in one frame"
                " a body first turns, then drives; put TMove within TRotate"
            )
        self._command = DriveCommand(outside.turn_deg + angle, outside.forward_m)
        yield
        self._command = outside

    @contextmanager
    def TMove(self, dist: float) -> Generator[None]:
        """β: add a distance in metres along the heading; δ: restore."""
        outside = self._command
        self._command = DriveCommand(outside.turn_deg, outside.forward_m + dist)
        yield
        self._command = outside

    def _here(self) -> Pose:
        """Pose of anything that is not a body: moves around it only position it."""
        turned = _within(self._place, 0.0, 0.0, self._command.turn_deg)
        return _within(turned, self._command.forward_m, 0.0, 0.0)


def _within(outer: Pose, x: float, y: float, angle: float) -> Pose:
    """World pose of a pose given relative to another."""
    # Cosine and sine of 0 keep its sign, which a cache would not.
    cos, sin = _direction(outer.angle) if outer.angle else (1.0, outer.angle)
    return Pose(outer.x + (x * cos - y * sin), outer.y + (x * sin + y * cos), outer.angle + angle)


@lru_cache(maxsize=1024)
def _direction(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle in degrees; most poses of a frame are those of the last."""
    return portable.cos_sin(math.radians(angle))
