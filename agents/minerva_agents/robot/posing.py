"""Assigns each scan of a recording the robot's pose at that time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from minerva_bus.semantics.poses import interpolated, moved
from minerva_bus.world.clock_steps import STEP_SECONDS
from minerva_bus.world.readings import Odometry, Scan
from minerva_bus.world.recordings import CORRECTION, POSE, Recorded

NEAR: Final = 1.0
"""Maximum time in seconds between a scan and the nearest odometry."""

_MAX_QUEUED: Final = 10_000
"""Maximum number of scans that wait for odometry; the oldest is dropped."""


@dataclass(frozen=True, slots=True)
class Posed:
    """A scan and the robot's pose: metres, and degrees counter-clockwise.

    `is_published`: the recording gives this pose for exactly this scan.
    """

    scan: Scan
    x: float
    y: float
    angle: float
    is_published: bool = False


@dataclass(frozen=True, slots=True)
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
    after = bisect_left(track, scan.time, key=lambda reading: reading.time)
    around = [track[k] for k in (after - 1, after) if 0 <= k < len(track)]
    near = [known for known in around if abs(known.time - scan.time) <= NEAR]
    if not near:
        return Unposed(scan)
    first, last = near[0], near[-1]
    span = last.time - first.time
    part = min(1.0, max(0.0, (scan.time - first.time) / span)) if span > 0 else 1.0
    pose = interpolated(first, last, part)
    return Posed(scan, pose.x, pose.y, pose.angle)
