"""Draw a map from a recording, into the robot's own kind of grid.

Each scan is a frame, each beam that hit something an `eLaser` of the robot: the cells change as in
`ARobot.sense_obstacle`. The first pass determines the size of the grid, the second draws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.canvas import MapExtent, canvas_of
from minerva_agents.robot.doubling import doubling_notes
from minerva_agents.robot.drift import Drift, TrajectoryPoint
from minerva_agents.robot.knowledge import free, obstacles
from minerva_agents.robot.locating import (
    NO_MOTION,
    Located,
    ScanMotion,
    located_scans,
    place_of,
    shortened,
)
from minerva_agents.robot.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from minerva_agents.robot.posing import Posed, Unposed, posed_scans
from minerva_bus import Cells
from minerva_bus.semantics.poses import Pose
from minerva_bus.wording import install
from minerva_bus.world.clock_steps import RecordingClock
from minerva_bus.world.compensation import Compensator, needs_path
from minerva_bus.world.readings import Displacement
from minerva_bus.world.recordings import MapChoice, Progress, Recorded, Recording


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A finished map: grid, path in metres (n, 2), and what was skipped.

    The outer corner of cell (0, 0) of `grid` lies at (`x`, `y`) metres. `drift` compares the path
    with the published one if both exist and differ. `uncorrected` counts scans drawn as if all
    beams had been measured at once, for lack of odometry. `notes` are lines on loops and double
    walls.
    """

    grid: Cells
    cell: float
    x: float
    y: float
    way: NDArray[np.float64]
    angle: float
    left_out: int
    uncorrected: int
    drift: Drift | None = None
    notes: tuple[str, ...] = ()

    @property
    def map(self) -> OccupancyMap:
        """The map in the map_server's form, with the robot's first pose as `start`."""
        grid = self.grid
        known = np.where(obstacles(grid), OCCUPIED, np.where(free(grid), FREE, UNKNOWN))
        start = float(self.way[0, 0]), float(self.way[0, 1]), self.angle
        return OccupancyMap(known.astype(np.int16), self.cell, self.x, self.y, start=start)


def draw_map(open: Callable[[], Recording], choice: MapChoice, progress: Progress) -> Drawn:
    """Draw the map of a recording, which is opened twice. Raises MinervaError."""
    extent, located, uncorrected = MapExtent(), _Trajectory(), 0
    posed_all: list[Posed] = []
    # First pass: estimate the poses, and find the extent of the map.
    with closing(open()) as recording:
        for posed in located.first(recording, choice, lambda part: progress(part / 2)):
            extent.take(posed)
            if isinstance(posed, Posed):
                posed_all.append(posed)
            uncorrected += needs_path(posed.scan)
    canvas = canvas_of(extent, choice.cell)
    # Second pass: draw, now that the size of the grid is known.
    with closing(open()) as recording:
        for posed in located.again(recording, choice, lambda part: progress(0.5 + part / 2)):
            if isinstance(posed, Posed):
                canvas.draw(posed)
    progress(1.0)
    way, angle = np.array(canvas.way), canvas.first_angle
    left_out, drift = extent.unposed, located.drift
    scans, places = [item.scan for item in posed_all], [place_of(item) for item in posed_all]
    notes = (*located.notes, *doubling_notes(scans, places, choice.poses))
    return Drawn(
        canvas.grid,
        choice.cell,
        canvas.x,
        canvas.y,
        way,
        angle,
        left_out,
        uncorrected,
        drift,
        notes,
    )


class _Trajectory:
    """Scans with estimated poses; the second pass reuses the first one's."""

    def __init__(self) -> None:
        self._taken: list[tuple[Pose | None, tuple[Displacement, ...]]] = []
        self._points: list[TrajectoryPoint] = []
        self.notes: list[str] = []

    @property
    def drift(self) -> Drift | None:
        """Errors of the estimated poses."""
        return Drift.of(self._points) if self._points else None

    def first(
        self, recording: Recording, choice: MapChoice, progress: Progress
    ) -> Iterator[Posed | Unposed]:
        if choice.poses == "published":
            yield from _published(recording, choice, progress)
            return
        located = list(_located(recording, choice, lambda part: progress(0.6 * part), NO_MOTION))
        if choice.poses == "matched":
            # The matched poses give the motion by which a second round corrects its scans.
            if any(needs_path(scan.scan) for scan in located):
                located = list(
                    _located(recording, choice, lambda part: None, ScanMotion.of(located))
                )
            located = self._closed(located, lambda part: progress(0.6 + 0.4 * part))
        for scan in located:
            self._remember(scan)
            yield scan.posed

    def _closed(self, located: list[Located], progress: Progress) -> list[Located]:
        """The scans at their poses after loop closure."""
        try:
            from minerva_agents.robot.loops import closed_loops  # late: needs scipy
        except ImportError:
            self.notes.append(
                f"loops are not closed because scipy is missing; install it with: {install('maps')}"
            )
            return located
        known = [scan for scan in located if scan.taken is not None]
        places = [scan.taken for scan in known if scan.taken is not None]
        closed = closed_loops([item.scan for item in known], places, progress)
        if closed.closures or closed.rejected:
            self.notes.append(str(closed))
        at = iter(closed.places)
        return [item if item.taken is None else replace(item, taken=next(at)) for item in located]

    def again(
        self, recording: Recording, choice: MapChoice, progress: Progress
    ) -> Iterator[Posed | Unposed]:
        published = _published(recording, choice, progress)
        if choice.poses == "published":
            yield from published
            return
        for posed, (at, path) in zip(published, self._taken, strict=True):
            yield Located(replace(posed.scan, path=path), at, None, None).posed

    def _remember(self, located: Located) -> None:
        self._taken.append((located.taken, located.scan.path))
        if located.taken is not None and located.published is not None:
            self._points.append(
                TrajectoryPoint(
                    located.scan.time, located.published, located.taken, located.chained
                )
            )


def _located(
    recording: Recording, choice: MapChoice, progress: Progress, motion: ScanMotion
) -> Iterator[Located]:
    """The scans at estimated poses."""
    return located_scans(
        _between(recording, choice, progress),
        cell=choice.cell,
        farthest=choice.farthest,
        matched=choice.poses == "matched",
        motion=motion,
    )


def _published(
    recording: Recording, choice: MapChoice, progress: Progress
) -> Iterator[Posed | Unposed]:
    """The scans to draw, at the recording's own poses."""
    for posed in posed_scans(_between(recording, choice, progress)):
        yield replace(posed, scan=shortened(posed.scan, choice.farthest))


def _between(recording: Recording, choice: MapChoice, progress: Progress) -> Iterator[Recorded]:
    """The readings between the chosen start and end times."""
    clock = RecordingClock()
    for recorded in Compensator(choice.time_offset).all(recording.readings()):
        progress(recording.part)
        clock.advance(recorded.stamp)
        if clock.seconds > choice.end:
            return
        if clock.seconds >= choice.begin:
            yield recorded
