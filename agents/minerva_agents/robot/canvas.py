"""The grid that a map is drawn into; it grows with the observed area."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from minerva_agents.robot.knowledge import clearing_part
from minerva_agents.robot.motion import at_distances
from minerva_agents.robot.posing import Posed, Unposed
from minerva_agents.robot.scans import mark_scan
from minerva_bus import Cells
from minerva_bus.errors import MisuseError
from minerva_bus.world.beams import hits
from minerva_bus.world.recordings import RecordingError

# 200 MB of 16-bit cells.
_MAX_CELLS: Final = 100_000_000
_MARGIN: Final = 2


@dataclass(slots=True)
class MapExtent:
    """Bounding box of the robot's path and of all hits, in metres."""

    low_x: float = math.inf
    low_y: float = math.inf
    high_x: float = -math.inf
    high_y: float = -math.inf
    unposed: int = 0

    def take(self, posed: Posed | Unposed) -> None:
        if isinstance(posed, Unposed):
            self.unposed += 1
            return
        dist, angle = hits(posed.scan)
        xs, ys = at_distances(posed.x, posed.y, posed.angle + angle, dist)
        self.low_x = min(self.low_x, posed.x, *xs.tolist())
        self.high_x = max(self.high_x, posed.x, *xs.tolist())
        self.low_y = min(self.low_y, posed.y, *ys.tolist())
        self.high_y = max(self.high_y, posed.y, *ys.tolist())

    def wider(self, metres: float) -> MapExtent:
        """A copy, enlarged by `metres` on each side."""
        low = self.low_x - metres, self.low_y - metres
        return MapExtent(*low, self.high_x + metres, self.high_y + metres)


def canvas_of(extent: MapExtent, cell: float) -> Canvas:
    """An empty grid that covers the extent, with cell borders at multiples of `cell`."""
    if extent.low_x > extent.high_x and extent.unposed:
        raise RecordingError(
            f"the recording gives no pose for any of its {extent.unposed} scans; a map needs"
            " odometry or a pose in each scan, or --poses matched, which estimates the poses by"
            " the scans"
        )
    if extent.low_x > extent.high_x:
        raise RecordingError("the recording has no scans to draw a map from")
    first = [math.floor(low / cell) - _MARGIN for low in (extent.low_x, extent.low_y)]
    last = [math.floor(high / cell) + _MARGIN for high in (extent.high_x, extent.high_y)]
    rows, columns = (end - begin + 1 for begin, end in zip(first, last, strict=True))
    if rows * columns > _MAX_CELLS:
        raise MisuseError(
            f"the map would have {rows} x {columns} cells; the limit is {_MAX_CELLS}."
            " Use larger cells (--cell) or a shorter range (--range)"
        )
    return Canvas(np.zeros((rows, columns), np.int16), cell, first[0] * cell, first[1] * cell)


class Canvas:
    """An occupancy grid under construction, with its origin in metres and the robot's path."""

    def __init__(self, grid: Cells, cell: float, x: float, y: float) -> None:
        self.grid, self.cell, self.x, self.y = grid, cell, x, y
        self.way: list[tuple[float, float]] = []
        self.first_angle = 0.0

    def make_room(self, extent: MapExtent) -> None:
        """Grow to cover `extent`, with 50 % spare space.

        Raises MisuseError if it gets too large.
        """
        high, wide = self.grid.shape
        low = extent.low_x >= self.x and extent.low_y >= self.y
        far = self.x + high * self.cell, self.y + wide * self.cell
        if low and extent.high_x < far[0] and extent.high_y < far[1]:
            return
        # Growth in proportion to the size keeps the number of copies logarithmic.
        more = (extent.high_x - extent.low_x + extent.high_y - extent.low_y) / 4
        other = canvas_of(extent.wider(more), self.cell)
        # Cell borders of both canvases are multiples of `cell`, so the offset is a whole number
        # except for rounding.
        row, column = (round((self.x - other.x) / self.cell), round((self.y - other.y) / self.cell))
        other.grid[row : row + high, column : column + wide] = self.grid
        self.grid, self.x, self.y = other.grid, other.x, other.y

    def draw(self, posed: Posed) -> None:
        """Add a scan to the grid, exactly as `ARobot.sense_obstacle` does."""
        grid, cell = self.grid, self.cell
        # Each scan is a frame.
        part = clearing_part(len(self.way))
        if not self.way:
            self.first_angle = posed.angle
        self.way.append((posed.x, posed.y))
        row, column = (posed.x - self.x) / cell, (posed.y - self.y) / cell
        dist, angle = hits(posed.scan)
        ends = at_distances(row, column, posed.angle + angle, dist / cell)
        mark_scan(grid, row, column, *ends, part)
