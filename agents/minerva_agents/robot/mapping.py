"""A map drawn from a recording: the robot's own grid, with the poses of the recording.

Each scan is a frame, each beam that hit something an `eLaser` of the robot: the cells change as in
`ARobot.sense_obstacle`. A first pass finds out how large the grid must be, a second one draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import (
    at_distance,
    clear_beam,
    free,
    mark_obstacle,
    obstacles,
    part_that_counts,
)
from minerva_agents.robot.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from minerva_agents.robot.posing import Posed, Unposed, posed_scans
from minerva_bus import Cells
from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Scan
from minerva_bus.world.recordings import (
    MapChoice,
    Progress,
    Recorded,
    Recording,
    RecordingError,
)

_MOST_CELLS: Final = 100_000_000
_MARGIN: Final = 2


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A map that was drawn: what the robot knows, its way in metres (n, 2), what was left out.

    The outer corner of cell (0, 0) of `grid` lies at (`x`, `y`) metres.
    """

    grid: Cells
    cell: float
    x: float
    y: float
    way: NDArray[np.float64]
    angle: float
    left_out: int

    @property
    def map(self) -> OccupancyMap:
        """The map as a map_server knows it, with the place where the robot was first."""
        grid = self.grid
        known = np.where(obstacles(grid), OCCUPIED, np.where(free(grid), FREE, UNKNOWN))
        start = float(self.way[0, 0]), float(self.way[0, 1]), self.angle
        return OccupancyMap(known.astype(np.int16), self.cell, self.x, self.y, start=start)


def draw_map(open: Callable[[], Recording], choice: MapChoice, progress: Progress) -> Drawn:
    """Draw the map of a recording, which is opened twice. Raises MinervaError."""
    extent = _Extent()
    with closing(open()) as recording:
        for posed in _chosen(recording, choice, lambda part: progress(part / 2)):
            extent.take(posed)
    canvas = _canvas(extent, choice.cell)
    with closing(open()) as recording:
        for posed in _chosen(recording, choice, lambda part: progress(0.5 + part / 2)):
            if isinstance(posed, Posed):
                canvas.draw(posed)
    progress(1.0)
    way, angle = np.array(canvas.way), canvas.first_angle
    return Drawn(canvas.grid, choice.cell, canvas.x, canvas.y, way, angle, extent.unposed)


def hits(scan: Scan) -> Iterator[tuple[float, float]]:
    """Each beam that hit something: metres from the robot's centre, degrees from its heading."""
    ranges = scan.ranges
    beams = np.flatnonzero((ranges > 0) & (ranges < np.float32(scan.range_max)))
    x, y, turn = scan.mount_x, scan.mount_y, scan.mount_angle
    for beam, dist in zip(beams.tolist(), ranges[beams].tolist(), strict=True):
        angle = scan.first + beam * scan.step + turn
        if x or y:
            heading = math.radians(angle)
            ahead, left = x + dist * math.cos(heading), y + dist * math.sin(heading)
            yield math.hypot(ahead, left), math.degrees(math.atan2(left, ahead))
        else:
            yield dist, angle


def _chosen(
    recording: Recording, choice: MapChoice, progress: Progress
) -> Iterator[Posed | Unposed]:
    """The scans that are drawn, with their places."""
    for posed in posed_scans(_between(recording, choice, progress)):
        scan = posed.scan
        if choice.farthest and choice.farthest < scan.range_max:
            posed = replace(posed, scan=replace(scan, range_max=choice.farthest))
        yield posed


def _between(recording: Recording, choice: MapChoice, progress: Progress) -> Iterator[Recorded]:
    """The readings from the one second to the other."""
    readings = recording.readings()
    first = next(readings, None)
    if first is None:
        return
    begin, end = first.stamp + choice.begin, first.stamp + choice.end
    if begin <= first.stamp:
        yield first
    for one in takewhile(lambda one: one.stamp <= end, readings):
        progress(recording.part)
        if one.stamp >= begin:
            yield one


@dataclass(slots=True)
class _Extent:
    """How far the robot came and saw, in metres."""

    low_x: float = math.inf
    low_y: float = math.inf
    high_x: float = -math.inf
    high_y: float = -math.inf
    unposed: int = 0

    def take(self, posed: Posed | Unposed) -> None:
        if isinstance(posed, Unposed):
            self.unposed += 1
            return
        self._reach(posed.x, posed.y)
        for dist, angle in hits(posed.scan):
            self._reach(*at_distance(posed.x, posed.y, posed.angle + angle, dist))

    def _reach(self, x: float, y: float) -> None:
        self.low_x, self.high_x = min(self.low_x, x), max(self.high_x, x)
        self.low_y, self.high_y = min(self.low_y, y), max(self.high_y, y)


def _canvas(extent: _Extent, cell: float) -> _Canvas:
    """An empty grid that holds an extent, its cells on a raster through (0, 0)."""
    if extent.low_x > extent.high_x and extent.unposed:
        raise RecordingError(
            f"where the robot was is not known of any of its {extent.unposed} scans; a map needs"
            " odometry beside them, or poses in their lines"
        )
    if extent.low_x > extent.high_x:
        raise RecordingError("there are no scans in it from which to draw a map")
    first = [math.floor(low / cell) - _MARGIN for low in (extent.low_x, extent.low_y)]
    last = [math.floor(high / cell) + _MARGIN for high in (extent.high_x, extent.high_y)]
    rows, columns = (end - begin + 1 for begin, end in zip(first, last, strict=True))
    if rows * columns > _MOST_CELLS:
        raise MisuseError(
            f"the map would have {rows} x {columns} cells, over {_MOST_CELLS}; take larger cells"
            " (--cell) or a shorter range (--range)"
        )
    return _Canvas(np.zeros((rows, columns), np.int16), cell, first[0] * cell, first[1] * cell)


class _Canvas:
    """The grid, as it is drawn."""

    def __init__(self, grid: Cells, cell: float, x: float, y: float) -> None:
        self.grid, self.cell, self.x, self.y = grid, cell, x, y
        self.way: list[tuple[float, float]] = []
        self.first_angle = 0.0

    def draw(self, posed: Posed) -> None:
        """Take a scan into the grid, as the robot does in a frame."""
        grid, cell = self.grid, self.cell
        part = part_that_counts(len(self.way))
        if not self.way:
            self.first_angle = posed.angle
        self.way.append((posed.x, posed.y))
        row, column = (posed.x - self.x) / cell, (posed.y - self.y) / cell
        for dist, angle in hits(posed.scan):
            to = at_distance(row, column, posed.angle + angle, dist / cell)
            clear_beam(grid, row, column, *to, part)
            mark_obstacle(grid, *to)
