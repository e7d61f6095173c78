"""Pose estimates for the scans of a recording, without using the published ones.

Poses come from odometry alone, step by step, or from odometry corrected by matching each scan
against the map built from the previous ones. The trajectory starts at the recording's first pose.
Without odometry between two scans, the robot may have moved anywhere nearby.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import tee
from typing import Final

from minerva_agents.robot.canvas import Canvas, MapExtent, canvas_of
from minerva_agents.robot.matching import Uncertainty, match
from minerva_agents.robot.motion import GridPose
from minerva_agents.robot.posing import Posed, Unposed, posed_scans
from minerva_bus import portable
from minerva_bus.semantics.poses import HasPose, Pose, moved
from minerva_bus.world.beams import hits
from minerva_bus.world.clock_steps import RecordingClock
from minerva_bus.world.compensation import needs_path, path_of
from minerva_bus.world.readings import Scan
from minerva_bus.world.recordings import Recorded

_ANYWHERE: Final = Uncertainty(0.15, 5.0)
"""Uncertainty of a step without odometry: the robot may have moved in any direction."""


@dataclass(frozen=True, slots=True)
class ScanMotion:
    """The robot's poses by times in seconds, to correct scans for its own motion.

    A mapping for each segment, because times are ambiguous if the clock has stepped back; and the
    number of steps before each scan.
    """

    segments: tuple[Mapping[float, Pose], ...] = ()
    steps: tuple[int, ...] = ()

    @staticmethod
    def of(located: Iterable[Located]) -> ScanMotion:
        """The trajectory through matched scans."""
        clock, steps = RecordingClock(), list[int]()
        segments: list[dict[float, Pose]] = [{}]
        for item in located:
            clock.advance(item.scan.time)
            steps.append(clock.steps)
            if clock.steps == len(segments):
                segments.append({})
            if item.taken is not None:
                segments[-1][item.scan.time] = item.taken
        ascending = [dict(sorted(known.items())) for known in segments]
        return ScanMotion(tuple(ascending), tuple(steps))

    def corrected(self, scan: Scan, number: int) -> Scan:
        """The scan of this number with its path, if only this trajectory covers it."""
        if not (needs_path(scan) and self.segments):
            return scan
        known = self.segments[self.steps[number]]
        return replace(scan, path=path_of(scan, [*known], [*known.values()]))


@dataclass(frozen=True, slots=True)
class Located:
    """A scan with its estimated pose, the published one, and the one by odometry alone."""

    scan: Scan
    taken: Pose | None
    published: Pose | None
    chained: Pose | None

    @property
    def posed(self) -> Posed | Unposed:
        """The scan at its estimated pose."""
        at = self.taken
        return Unposed(self.scan) if at is None else Posed(self.scan, at.x, at.y, at.angle)


NO_MOTION: Final = ScanMotion()


def located_scans(
    recorded: Iterable[Recorded],
    *,
    cell: float,
    farthest: float,
    matched: bool,
    motion: ScanMotion = NO_MOTION,
) -> Iterator[Located]:
    """All scans in order, each with its pose; `cell` is the matching grid's cell side in m.

    `motion` corrects scans that have beam times but no path by odometry.
    """
    first, second = tee(recorded)
    # Both yield all scans in order, but delay them differently while they wait for odometry; `tee`
    # buffers the difference.
    both = zip(posed_scans(first), posed_scans(second, odometry=True), strict=True)
    chain, matcher = _Chain(), _Matcher(cell, motion)
    for published, wheels in both:
        scan = shortened(published.scan, farthest)
        chained = chain.go(published, wheels)
        if not matched:
            yield Located(scan, chained, _published(published), chained)
            continue
        posed = matcher.take(scan, published, wheels)
        yield Located(posed.scan, place_of(posed), _published(published), chained)


def shortened(scan: Scan, farthest: float) -> Scan:
    """The scan without readings beyond `farthest` metres; 0 keeps all."""
    return replace(scan, range_max=farthest) if 0 < farthest < scan.range_max else scan


class _Chain:
    """Dead reckoning from the first known pose."""

    def __init__(self) -> None:
        self._start: HasPose | None = None
        self._first: Posed | None = None

    def go(self, published: Posed | Unposed, wheels: Posed | Unposed) -> Pose | None:
        if isinstance(wheels, Unposed):
            return None
        if self._first is None or self._start is None:
            self._start, self._first = (_published(published) or wheels), wheels
        return moved(self._start, self._first, wheels)


class _Matcher:
    """A map that grows scan by scan, and the robot's pose on it."""

    def __init__(self, cell: float, motion: ScanMotion) -> None:
        self._cell = cell
        self._canvas: Canvas | None = None
        self._extent = MapExtent()
        self._here = Pose(0.0, 0.0, 0.0)
        self._wheels: Posed | None = None
        self._motion = motion
        self._taken = 0

    def take(self, scan: Scan, published: Posed | Unposed, wheels: Posed | Unposed) -> Posed:
        """Match a scan and draw it; the result is its pose."""
        scan = self._motion.corrected(scan, self._taken)
        self._taken += 1
        # There is no map yet to match the first scan with, so its given pose counts.
        if self._canvas is None:
            known = [posed for posed in (published, wheels) if isinstance(posed, Posed)]
            here = place_of(known[0]) if known else self._here
        else:
            guess, uncertainty = self._step(wheels)
            here = self._matched(self._canvas, scan, guess, uncertainty)
        posed = Posed(scan, here.x, here.y, here.angle)
        self._extent.take(posed)
        if self._canvas is None:
            self._canvas = canvas_of(self._extent, self._cell)
        self._canvas.make_room(self._extent)
        self._canvas.draw(posed)
        self._here, self._wheels = here, wheels if isinstance(wheels, Posed) else None
        return posed

    def _step(self, wheels: Posed | Unposed) -> tuple[Pose, Uncertainty]:
        before, here = self._wheels, self._here
        if before is None or isinstance(wheels, Unposed):
            return here, _ANYWHERE
        turn = math.remainder(wheels.angle - before.angle, 360.0)
        dist = portable.dist((wheels.x, wheels.y), (before.x, before.y))
        return moved(here, before, wheels), Uncertainty.after(turn, dist)

    def _matched(self, canvas: Canvas, scan: Scan, guess: Pose, uncertainty: Uncertainty) -> Pose:
        cell = self._cell
        dist, angle = hits(scan)
        start = GridPose((guess.x - canvas.x) / cell, (guess.y - canvas.y) / cell, guess.angle)
        best = match(canvas.grid, start, (dist / cell, angle), cell, uncertainty)
        # A conversion to cells and back would round the pose.
        if best is start:
            return guess
        return Pose(canvas.x + best.row * cell, canvas.y + best.column * cell, best.angle)


def place_of(posed: Posed) -> Pose:
    """The pose of a scan."""
    return Pose(posed.x, posed.y, posed.angle)


def _published(posed: Posed | Unposed) -> Pose | None:
    if isinstance(posed, Unposed) or not posed.is_published:
        return None
    return place_of(posed)
