"""A map drawn from a recording: the robot's own grid, at the places that the choice says.

Each scan is a frame, each beam that hit something an `eLaser` of the robot: the cells change as in
`ARobot.sense_obstacle`. A first pass finds out how large the grid must be, a second one draws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.canvas import Extent, canvas_of
from minerva_agents.robot.doubling import doubling_told
from minerva_agents.robot.drift import Drift, Gone
from minerva_agents.robot.knowledge import free, obstacles
from minerva_agents.robot.locating import (
    NO_MOTION,
    Located,
    Motion,
    located_scans,
    place_of,
    shortened,
)
from minerva_agents.robot.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from minerva_agents.robot.posing import Posed, Unposed, posed_scans
from minerva_bus import Cells
from minerva_bus.world.compensation import Compensator, needs_path
from minerva_bus.world.poses import Pose
from minerva_bus.world.readings import Displacement
from minerva_bus.world.recordings import MapChoice, Progress, Recorded, Recording


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A map that was drawn: what the robot knows, its way in metres (n, 2), what was left out.

    The outer corner of cell (0, 0) of `grid` lies at (`x`, `y`) metres. `drift` compares the way
    with the one that was published, if it is another and there is one. `uncorrected` counts scans
    that are drawn as if their beams had been measured at once, for want of odometry. `notes` are
    lines on loops and on walls that are drawn twice.
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
        """The map as a map_server knows it, with the place where the robot was first."""
        grid = self.grid
        known = np.where(obstacles(grid), OCCUPIED, np.where(free(grid), FREE, UNKNOWN))
        start = float(self.way[0, 0]), float(self.way[0, 1]), self.angle
        return OccupancyMap(known.astype(np.int16), self.cell, self.x, self.y, start=start)


def draw_map(open: Callable[[], Recording], choice: MapChoice, progress: Progress) -> Drawn:
    """Draw the map of a recording, which is opened twice. Raises MinervaError."""
    extent, located, uncorrected = Extent(), _Located(), 0
    posed_all: list[Posed] = []
    with closing(open()) as recording:
        for posed in located.first(recording, choice, lambda part: progress(part / 2)):
            extent.take(posed)
            if isinstance(posed, Posed):
                posed_all.append(posed)
            uncorrected += needs_path(posed.scan)
    canvas = canvas_of(extent, choice.cell)
    with closing(open()) as recording:
        for posed in located.again(recording, choice, lambda part: progress(0.5 + part / 2)):
            if isinstance(posed, Posed):
                canvas.draw(posed)
    progress(1.0)
    way, angle = np.array(canvas.way), canvas.first_angle
    left_out, drift = extent.unposed, located.drift
    scans, places = [one.scan for one in posed_all], [place_of(one) for one in posed_all]
    notes = (*located.notes, *doubling_told(scans, places, choice.poses))
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


class _Located:
    """The scans with their places, which need not be found out a second time."""

    def __init__(self) -> None:
        self._taken: list[tuple[Pose | None, tuple[Displacement, ...]]] = []
        self._gone: list[Gone] = []
        self.notes: list[str] = []

    @property
    def drift(self) -> Drift | None:
        """How far off the places are that the robot has found itself."""
        return Drift.of(self._gone) if self._gone else None

    def first(
        self, recording: Recording, choice: MapChoice, progress: Progress
    ) -> Iterator[Posed | Unposed]:
        if choice.poses == "published":
            yield from _published(recording, choice, progress)
            return
        located = list(_located(recording, choice, lambda part: progress(0.6 * part), NO_MOTION))
        if choice.poses == "matched":
            if any(needs_path(one.scan) for one in located):
                located = list(_located(recording, choice, lambda part: None, Motion.of(located)))
            located = self._closed(located, lambda part: progress(0.6 + 0.4 * part))
        for one in located:
            self._remember(one)
            yield one.posed

    def _closed(self, located: list[Located], progress: Progress) -> list[Located]:
        """The scans at the places that they have once loops are closed."""
        try:
            from minerva_agents.robot.loops import closed_loops  # late: needs scipy
        except ImportError:
            self.notes.append(
                "loops are not closed: that needs scipy; install it with: pip install"
                " 'minerva-bus[maps]'"
            )
            return located
        known = [one for one in located if one.taken is not None]
        places = [one.taken for one in known if one.taken is not None]
        closed = closed_loops([one.scan for one in known], places, progress)
        if closed.closures or closed.rejected:
            self.notes.append(str(closed))
        at = iter(closed.places)
        return [one if one.taken is None else replace(one, taken=next(at)) for one in located]

    def again(
        self, recording: Recording, choice: MapChoice, progress: Progress
    ) -> Iterator[Posed | Unposed]:
        said = _published(recording, choice, progress)
        if choice.poses == "published":
            yield from said
            return
        for one, (at, path) in zip(said, self._taken, strict=True):
            yield Located(replace(one.scan, path=path), at, None, None).posed

    def _remember(self, one: Located) -> None:
        self._taken.append((one.taken, one.scan.path))
        if one.taken is not None and one.published is not None:
            self._gone.append(Gone(one.scan.time, one.published, one.taken, one.chained))


def _located(
    recording: Recording, choice: MapChoice, progress: Progress, motion: Motion
) -> Iterator[Located]:
    """The scans at the places that the robot has found itself."""
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
    """The scans that are drawn, at the places that the recording has for them."""
    for posed in posed_scans(_between(recording, choice, progress)):
        yield replace(posed, scan=shortened(posed.scan, choice.farthest))


def _between(recording: Recording, choice: MapChoice, progress: Progress) -> Iterator[Recorded]:
    """The readings from the one second to the other."""
    readings = Compensator(choice.time_offset).all(recording.readings())
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
