"""Where a robot takes itself to be at each scan of a recording, without being told.

By its odometry alone, each step beginning where the one before has ended; or by its odometry and
its scans, each of which is matched to the map that the scans before have made. It begins where the
recording says that it was first. Between two scans without odometry it may have gone anywhere near.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import tee
from typing import Final

import numpy as np

from minerva_agents.robot import motion
from minerva_agents.robot.canvas import Canvas, Extent, canvas_of, hits
from minerva_agents.robot.matching import Doubt, match
from minerva_agents.robot.posing import Posed, Unposed, posed_scans
from minerva_bus import portable
from minerva_bus.world.compensation import needs_path, path_of
from minerva_bus.world.poses import HasPose, Pose, moved
from minerva_bus.world.readings import Scan
from minerva_bus.world.recordings import Recorded

_ANYWHERE: Final = Doubt(0.15, 5.0)
"""Of a robot that has gone on since the scan before, nobody knows where to."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Where a robot was at times in seconds, which rise: its motion during scans, by matching."""

    times: tuple[float, ...] = ()
    places: tuple[Pose, ...] = ()

    @staticmethod
    def of(located: Iterable[Located]) -> Motion:
        """The motion of a robot from scan to scan."""
        known = {one.scan.time: one.taken for one in located if one.taken is not None}
        times = tuple(sorted(known))
        return Motion(times, tuple([known[time] for time in times]))

    def corrected(self, scan: Scan) -> Scan:
        """A scan with its path, where no odometry says it and this motion covers it."""
        if not needs_path(scan):
            return scan
        return replace(scan, path=path_of(scan, self.times, self.places))


@dataclass(frozen=True, slots=True)
class Located:
    """A scan with the place that counts, the one that is published and that of the odometry."""

    scan: Scan
    taken: Pose | None
    published: Pose | None
    chained: Pose | None

    @property
    def posed(self) -> Posed | Unposed:
        """The scan at the place that counts."""
        at = self.taken
        return Unposed(self.scan) if at is None else Posed(self.scan, at.x, at.y, at.angle)


NO_MOTION: Final = Motion()


def located_scans(
    recorded: Iterable[Recorded],
    *,
    cell: float,
    farthest: float,
    matched: bool,
    motion: Motion = NO_MOTION,
) -> Iterator[Located]:
    """The scans in their order, each with its place; a grid for matching has cells of `cell` m.

    `motion` corrects scans that have beam times, but no path by odometry.
    """
    one, other = tee(recorded)
    both = zip(posed_scans(one), posed_scans(other, odometry=True), strict=True)
    chain, matcher = _Chain(), _Matcher(cell, motion)
    for said, wheels in both:
        scan = shortened(said.scan, farthest)
        chained = chain.go(said, wheels)
        if not matched:
            yield Located(scan, chained, _told(said), chained)
            continue
        posed = matcher.take(scan, said, wheels)
        yield Located(posed.scan, place_of(posed), _told(said), chained)


def shortened(scan: Scan, farthest: float) -> Scan:
    """A scan without what is farther than so many metres; 0: all of it."""
    return replace(scan, range_max=farthest) if 0 < farthest < scan.range_max else scan


class _Chain:
    """Step upon step of the odometry, from the first place that is known."""

    def __init__(self) -> None:
        self._start: HasPose | None = None
        self._first: Posed | None = None

    def go(self, said: Posed | Unposed, wheels: Posed | Unposed) -> Pose | None:
        if isinstance(wheels, Unposed):
            return None
        if self._first is None or self._start is None:
            self._start, self._first = (_told(said) or wheels), wheels
        return moved(self._start, self._first, wheels)


class _Matcher:
    """A map that grows by the scans, and where on it the robot is."""

    def __init__(self, cell: float, motion: Motion) -> None:
        self._cell = cell
        self._canvas: Canvas | None = None
        self._extent = Extent()
        self._here = Pose(0.0, 0.0, 0.0)
        self._wheels: Posed | None = None
        self._motion = motion

    def take(self, scan: Scan, said: Posed | Unposed, wheels: Posed | Unposed) -> Posed:
        """Where the scan was measured; the map has it now."""
        scan = self._motion.corrected(scan)
        if self._canvas is None:
            known = [one for one in (said, wheels) if isinstance(one, Posed)]
            here = place_of(known[0]) if known else self._here
        else:
            guess, doubt = self._step(wheels)
            here = self._matched(self._canvas, scan, guess, doubt)
        posed = Posed(scan, here.x, here.y, here.angle)
        self._extent.take(posed)
        if self._canvas is None:
            self._canvas = canvas_of(self._extent, self._cell)
        self._canvas.make_room(self._extent)
        self._canvas.draw(posed)
        self._here, self._wheels = here, wheels if isinstance(wheels, Posed) else None
        return posed

    def _step(self, wheels: Posed | Unposed) -> tuple[Pose, Doubt]:
        before, here = self._wheels, self._here
        if before is None or isinstance(wheels, Unposed):
            return here, _ANYWHERE
        turn = math.remainder(wheels.angle - before.angle, 360.0)
        dist = portable.dist((wheels.x, wheels.y), (before.x, before.y))
        return moved(here, before, wheels), Doubt.after(turn, dist)

    def _matched(self, canvas: Canvas, scan: Scan, guess: Pose, doubt: Doubt) -> Pose:
        cell = self._cell
        seen = np.array(list(hits(scan)), np.float64).reshape(-1, 2)
        start = motion.Pose((guess.x - canvas.x) / cell, (guess.y - canvas.y) / cell, guess.angle)
        found = match(canvas.grid, start, (seen[:, 0] / cell, seen[:, 1]), cell, doubt)
        if found is start:
            return guess
        return Pose(canvas.x + found.row * cell, canvas.y + found.column * cell, found.angle)


def place_of(posed: Posed) -> Pose:
    """Where a scan was measured."""
    return Pose(posed.x, posed.y, posed.angle)


def _told(said: Posed | Unposed) -> Pose | None:
    if isinstance(said, Unposed) or not said.told:
        return None
    return place_of(said)
