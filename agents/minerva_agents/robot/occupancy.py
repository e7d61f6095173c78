"""Occupancy maps of floors: cells, markers and clearance."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.distances import clearance
from minerva_bus import portable

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1

Point: TypeAlias = tuple[float, float]
MapPose: TypeAlias = tuple[float, float, float]
Numbers = TypeVar("Numbers", float, NDArray[np.float64])


@dataclass(frozen=True, slots=True)
class Marker:
    """A named position on a floor, in metres of the world."""

    name: str
    x: float
    y: float


# Without slots, because `room` is cached in the instance.
@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A floor, cell by cell, as in nav_msgs/OccupancyGrid.

    `cells` is int16, read-only, [row, column]; rows grow along the map's x, columns along its y; 0
    is free, 100 occupied, -1 unknown. A cell's side is `resolution` metres. The outer corner of
    cell (0, 0) lies at (`x`, `y`) metres in the world, and the map's x axis is rotated `angle`
    degrees counter-clockwise from the world's. `start` is (x, y, degrees), or None if not given.
    """

    cells: NDArray[np.int16]
    resolution: float
    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0
    markers: tuple[Marker, ...] = ()
    start: MapPose | None = None

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """True where a robot must not be: every cell not known to be free."""
        return self.cells != FREE

    @cached_property
    def room(self) -> NDArray[np.float64]:
        """Clearance in cells; everything outside the map counts as an obstacle.

        Cached and read-only.
        """
        room = clearance(np.pad(self.obstacles, 1, constant_values=True))[1:-1, 1:-1]
        room.setflags(write=False)
        return room

    def equals(self, other: "OccupancyMap") -> bool:
        """True if both describe the same floor with the same cells."""
        own, theirs = self._frame(), other._frame()
        return own == theirs and np.array_equal(self.cells, other.cells)

    def holds(self, x: float, y: float) -> bool:
        """True if a world position in metres lies on the map."""
        # Not by `cell_at`: a finite position may be infinitely many cells away.
        row, column = self._cells_to(x, y)
        return 0 <= row < self.cells.shape[0] and 0 <= column < self.cells.shape[1]

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """Cell of a world position in metres; it may lie outside the map."""
        row, column = self._cells_to(x, y)
        return math.floor(row), math.floor(column)

    def centre_of(self, cell: tuple[int, int]) -> Point:
        """World position of a cell's centre, in metres."""
        return self.point(cell[0] + 0.5, cell[1] + 0.5)

    def corner_of(self, cell: tuple[int, int]) -> Point:
        """World position of the corner of a cell nearest to cell (0, 0), in metres."""
        return self.point(float(cell[0]), float(cell[1]))

    def point(self, row: Numbers, column: Numbers) -> tuple[Numbers, Numbers]:
        """World position in metres of rows and columns from the map's origin, with fractions."""
        cos, sin = self._heading()
        along, across = row * self.resolution, column * self.resolution
        return self.x + cos * along - sin * across, self.y + sin * along + cos * across

    def _cells_to(self, x: float, y: float) -> Point:
        """The rows and columns from the origin of the map to a world position, as fractions."""
        cos, sin = self._heading()
        east, north = x - self.x, y - self.y
        along, across = cos * east + sin * north, cos * north - sin * east
        return along / self.resolution, across / self.resolution

    def _frame(self) -> tuple[object, ...]:
        return self.resolution, self.x, self.y, self.angle, self.markers, self.start

    def _heading(self) -> Point:
        return portable.cos_sin(math.radians(self.angle))
