"""The robot's pose at each scan of a recording, and the grid that such scans are drawn into.

Poses are those that the recording gives, or come from odometry alone, step by step, or from
odometry corrected by matching each scan against the map built from the previous ones. The
trajectory starts at the recording's first pose. Without odometry between two scans, the robot may
have moved anywhere nearby.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import tee
from typing import Final

import numpy as np

from minerva_agents.robot.grid import clearing_part, mark_scan
from minerva_agents.robot.matching import Uncertainty, match
from minerva_agents.robot.pose import GridPose, Reals, at_distances, moved
from minerva_bus import Cells, portable
from minerva_bus.errors import MisuseError
from minerva_bus.log.recordings import (
    CORRECTION,
    POSE,
    STEP_SECONDS,
    Recorded,
    RecordingClock,
    RecordingError,
    needs_path,
    path_of,
)
from minerva_bus.semantics.poses import HasPose, Pose, interpolated
from minerva_bus.values import fast_dataclass
from minerva_bus.world.readings import Odometry, Scan, hits

# --- poses of scans -------------------------------------------------------------------------------


NEAR: Final = 1.0
"""Maximum time in seconds between a scan and the nearest odometry."""

_MAX_QUEUED: Final = 10_000
"""Maximum number of scans that wait for odometry; the oldest is dropped."""


@fast_dataclass
class Posed:
    """A scan and the robot's pose: metres, and degrees counter-clockwise.

    `is_published`: the recording gives this pose for exactly this scan.
    """

    scan: Scan
    x: float
    y: float
    angle: float
    is_published: bool = False


@fast_dataclass
class Unposed:
    """A scan without a known pose."""

    scan: Scan


def posed_scans(
    recorded: Iterable[Recorded], *, odometry: bool = False
) -> Iterator[Posed | Unposed]:
    """The scans in order, each with its pose.

    The pose is the one that the recording gives for this scan on the topic `pose`; otherwise, or if
    only `odometry` counts, it is interpolated from the odometry before and after the scan.
    """
    assigner, wheels = _PoseAssigner(), _RawOdometry()
    for item in recorded:
        if isinstance(item.reading, Scan):
            yield from assigner.measured(item.reading)
        elif not isinstance(item.reading, Odometry):
            continue
        elif item.topic == POSE:
            assigner.published = None if odometry else item.reading
        elif item.topic == CORRECTION:
            wheels.corrected(item.reading)
        else:
            # Odometry jumps where a log has been corrected, which the wheels have not measured.
            measured = wheels.measured(item.reading) if odometry else item.reading
            yield from assigner.moved(measured)
    yield from assigner.rest()


class _PoseAssigner:
    """The latest odometry, and the scans that wait for the next one."""

    def __init__(self) -> None:
        self.published: Odometry | None = None
        self._track: deque[Odometry] = deque()
        # The odometry before a step back of the clock, until a scan from after the step.
        self._ended: deque[Odometry] = deque()
        self._waiting: deque[Scan] = deque()

    def measured(self, scan: Scan) -> Iterator[Posed | Unposed]:
        published, self.published = self.published, None
        if published is not None:
            # Earlier scans first, so that the order is kept.
            yield from self.rest()
            yield Posed(scan, published.x, published.y, published.angle, is_published=True)
            return
        if self._precedes_step(scan):
            yield from self.rest()
            yield _placed(scan, self._ended)
            return
        self._ended.clear()
        # The clock of the scans has been set back: no odometry will come for those from before.
        if self._waiting and self._waiting[-1].time - scan.time > STEP_SECONDS:
            yield from self.rest()
        self._waiting.append(scan)
        yield from self._ready()
        if len(self._waiting) > _MAX_QUEUED:
            yield Unposed(self._waiting.popleft())

    def moved(self, reading: Odometry) -> Iterator[Posed | Unposed]:
        track = self._track
        if track and reading.time < track[-1].time:
            # The clock has been set back: odometry from after the step says nothing about scans
            # from before it.
            while self._waiting and _is_nearer(track[-1], self._waiting[0], reading):
                yield _placed(self._waiting.popleft(), track)
            self._ended, self._track = track, deque()
        self._track.append(reading)
        yield from self._ready()
        # Afterwards, because after a gap the older odometry is the nearest to a waiting scan.
        while self._track[0].time < reading.time - NEAR:
            self._track.popleft()

    def rest(self) -> Iterator[Posed | Unposed]:
        """Flush scans whose odometry did not arrive."""
        while self._waiting:
            yield _placed(self._waiting.popleft(), self._track)

    def _ready(self) -> Iterator[Posed | Unposed]:
        # `not >`, so that a scan whose time is nan does not hold up the queue.
        while self._waiting and self._track and not self._waiting[0].time > self._track[-1].time:
            yield _placed(self._waiting.popleft(), self._track)

    def _precedes_step(self, scan: Scan) -> bool:
        """Whether a scan was measured before the clock was set back, and arrived after that."""
        if not self._ended:
            return False
        ended, after = self._ended[-1], self._track[-1]
        return abs(ended.time - scan.time) <= NEAR and _is_nearer(ended, scan, after)


class _RawOdometry:
    """Odometry without the corrections that a recording has applied to it."""

    def __init__(self) -> None:
        self._last: Odometry | None = None
        self._start: tuple[Odometry, Odometry] | None = None

    def corrected(self, to: Odometry) -> None:
        """From here on, odometry is relative to this corrected pose."""
        if self._last is not None:
            self._start = self._last, to

    def measured(self, reading: Odometry) -> Odometry:
        """The pose that wheel odometry alone would give."""
        if self._start is not None:
            start, correction = self._start
            at = moved(start, correction, reading)
            reading = replace(reading, x=at.x, y=at.y, angle=at.angle)
        self._last = reading
        return reading


def _is_nearer(first: Odometry, scan: Scan, second: Odometry) -> bool:
    """Whether the time of a scan is nearer to the first of two readings."""
    return abs(first.time - scan.time) < abs(second.time - scan.time)


def _placed(scan: Scan, track: Sequence[Odometry]) -> Posed | Unposed:
    """The scan at its interpolated pose, or at the nearest pose within `NEAR` seconds."""
    # Of readings of one time, the latest.
    after = bisect_right(track, scan.time, key=lambda reading: reading.time)
    around = [track[k] for k in (after - 1, after) if 0 <= k < len(track)]
    near = [known for known in around if abs(known.time - scan.time) <= NEAR]
    if not near:
        return Unposed(scan)
    first, last = near[0], near[-1]
    span = last.time - first.time
    part = min(1.0, max(0.0, (scan.time - first.time) / span)) if span > 0 else 1.0
    pose = interpolated(first, last, part)
    return Posed(scan, pose.x, pose.y, pose.angle)


# --- the canvas -----------------------------------------------------------------------------------


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


# --- estimated poses ------------------------------------------------------------------------------


ANYWHERE: Final = Uncertainty(0.15, 5.0)
"""Uncertainty of a step without odometry: the robot may have moved in any direction."""


@fast_dataclass
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


@fast_dataclass
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
            here = matched_pose(self._canvas, scan, *self._step(wheels))
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
            return here, ANYWHERE
        turn = math.remainder(wheels.angle - before.angle, 360.0)
        dist = portable.dist((wheels.x, wheels.y), (before.x, before.y))
        return moved(here, before, wheels), Uncertainty.after(turn, dist)


def matched_pose(canvas: Canvas, scan: Scan, guess: Pose, uncertainty: Uncertainty) -> Pose:
    """The pose at which a scan fits a map best; the guess itself if it fits nowhere."""
    cell = canvas.cell
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


# --- keyframes ------------------------------------------------------------------------------------


KEY_METRES, KEY_DEGREES = 0.8, 40.0
"""Maximum travel and rotation between keyframes, if scans are that dense."""

MIN_LOOP: Final = 12.0
"""Minimum travel in metres between two keyframes of one place."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanKeyframe:
    """A scan of the trajectory: index, hits relative to the robot in metres (n, 2), and reach.

    `reach` is the distance in metres to the nearest hit per degree, (360,); 0 where nothing was
    hit. `way` is the distance travelled so far.
    """

    number: int
    points: Reals
    reach: Reals
    way: float


def keyframes_of(scans: Sequence[Scan], places: Sequence[Pose]) -> list[ScanKeyframe]:
    """Scans of a trajectory, thinned to the spacing of keyframes."""
    keys: list[ScanKeyframe] = []
    way, last = 0.0, -1
    for number, (scan, place) in enumerate(zip(scans, places, strict=True)):
        if number:
            before = places[number - 1]
            way += math.hypot(place.x - before.x, place.y - before.y)
        if keys:
            turn = abs(math.remainder(place.angle - places[last].angle, 360.0))
            if way - keys[-1].way < KEY_METRES and turn < KEY_DEGREES:
                continue
        dist, angle = hits(scan)
        # Too few hits to recognise a place.
        if len(dist) < 20:
            continue
        keys.append(ScanKeyframe(number, _points(dist, angle), _reach(dist, angle), way))
        last = number
    return keys


def _points(dist: Reals, angle: Reals) -> Reals:
    heading = np.radians(angle)
    return np.stack([dist * np.cos(heading), dist * np.sin(heading)], axis=1)


def _reach(dist: Reals, angle: Reals) -> Reals:
    reach = np.full(360, np.inf)
    np.minimum.at(reach, np.floor(angle).astype(np.intp) % 360, dist)
    # The nearest of three degrees: an edge that lies between two of them must not count as seen
    # through.
    least = np.minimum(reach, np.minimum(np.roll(reach, 1), np.roll(reach, -1)))
    return np.where(np.isfinite(least), least, 0.0)


def poses_of(places: Sequence[Pose]) -> Reals:
    """Poses as an array, (n, 3)."""
    return np.array([(p.x, p.y, math.radians(p.angle)) for p in places])


def between(first: Reals, second: Reals) -> Reals:
    """The second pose relative to the first."""
    cos, sin = math.cos(first[2]), math.sin(first[2])
    x, y = second[0] - first[0], second[1] - first[1]
    turn = math.remainder(second[2] - first[2], math.tau)
    return np.array([cos * x + sin * y, cos * y - sin * x, turn])


def transformed(points: Reals, pose: Reals) -> Reals:
    """Points in a pose's own frame, transformed to the outer frame."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def seen_through(points: Reals, reach: Reals) -> float:
    """Fraction of points in space that a keyframe observed as free."""
    dist = np.hypot(points[:, 0], points[:, 1])
    degree = np.floor(np.degrees(np.arctan2(points[:, 1], points[:, 0]))).astype(np.intp) % 360
    limit = reach[degree]
    known = limit > 0
    if np.count_nonzero(known) < 20:
        return 0.0
    # The tolerance grows with the distance, like the effect of an error of heading.
    return float(np.mean(dist[known] < limit[known] - 0.3 - 0.03 * limit[known]))
