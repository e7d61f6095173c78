"""Compensation of motion distortion: the `path` of a robot during a scan, from its odometry.

`beams` applies the path to the beams.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

from minerva_bus import portable
from minerva_bus.semantics.poses import HasPose, Pose, interpolated
from minerva_bus.world.readings import Displacement, Odometry, Scan
from minerva_bus.world.recordings import CORRECTION, POSE, Recorded

GAP_SECONDS: Final = 0.5
"""Maximum gap between odometry readings on a path, and from the last reading to a beam."""

MAX_SPEED, MAX_TURN = 20.0, 1080.0
"""Metres and degrees per second; odometry that moves faster has jumped."""

_KEPT: Final = 2000
_HELD: Final = 1000


class Compensator:
    """Adds paths to the scans in a stream of readings, from the odometry in the stream.

    A scan, and all later readings, are delayed until the odometry reaches the last beam, at most
    for GAP_SECONDS of the recording. `offset`, in seconds, is added to the times of scans.
    `uncorrected` is called for each scan with beam times that gets no path, for lack of odometry.
    """

    def __init__(self, offset: float = 0.0, uncorrected: Callable[[], None] = lambda: None) -> None:
        self._offset, self._uncorrected = offset, uncorrected
        self._odometry = deque[Odometry](maxlen=_KEPT)
        self._topic = ""
        self._held = deque[Recorded]()

    def all(self, readings: Iterable[Recorded]) -> Iterator[Recorded]:
        """All readings in order."""
        for recorded in readings:
            yield from self.add(recorded)
        yield from self.rest()

    def add(self, recorded: Recorded) -> list[Recorded]:
        """Add a reading; returns the readings that are complete, in order of arrival."""
        reading = recorded.reading
        ready: list[Recorded] = []
        if isinstance(reading, Scan) and self._offset:
            recorded = replace(recorded, reading=replace(reading, time=reading.time + self._offset))
        elif isinstance(reading, Odometry) and recorded.topic not in (POSE, CORRECTION):
            ready = self._moved(recorded.topic, reading)
        self._held.append(recorded)
        return [*ready, *self._ready(recorded.stamp)]

    def rest(self) -> list[Recorded]:
        """The readings that are still delayed."""
        rest = [self._corrected(recorded) for recorded in self._held]
        self._held.clear()
        return rest

    def _moved(self, topic: str, odometry: Odometry) -> list[Recorded]:
        """Add odometry; returns the readings that nothing later can complete."""
        ready: list[Recorded] = []
        self._topic = self._topic or topic
        # Two sources of odometry have different origins; a path must not switch between them.
        if topic != self._topic:
            return ready
        # The sensor's clock was set back: older readings are of another time scale.
        if self._odometry and odometry.time < self._odometry[-1].time:
            ready = self.rest()
            self._odometry.clear()
        # Interpolation divides by the difference of neighbouring times.
        if not self._odometry or odometry.time > self._odometry[-1].time:
            self._odometry.append(odometry)
        return ready

    def _ready(self, now: float) -> list[Recorded]:
        ready: list[Recorded] = []
        # Readings behind a delayed scan wait, too, because the order of the stream is kept.
        while self._held and not self._waits(self._held[0], now):
            ready.append(self._corrected(self._held.popleft()))
        return ready

    def _waits(self, recorded: Recorded, now: float) -> bool:
        scan = recorded.reading
        if not isinstance(scan, Scan) or not needs_path(scan):
            return False
        # Bounds memory and delay where odometry is late or missing.
        if not self._odometry or len(self._held) > _HELD:
            return False
        begin, end = span(scan)
        latest = self._odometry[-1].time
        # The recorder's clock may jump; a negative difference must not hold the scan forever.
        in_time = 0 <= now - recorded.stamp <= GAP_SECONDS
        return begin - GAP_SECONDS <= latest < end and in_time

    def _corrected(self, recorded: Recorded) -> Recorded:
        scan = recorded.reading
        if not isinstance(scan, Scan) or not needs_path(scan):
            return recorded
        odometry = list(self._odometry)
        path = path_of(scan, [reading.time for reading in odometry], odometry)
        if not path:
            self._uncorrected()
        return replace(recorded, reading=replace(scan, path=path))


def needs_path(scan: Scan) -> bool:
    """Whether the beams of a scan have different times, and the motion between them is unknown."""
    return bool(scan.beam_time) and len(scan.ranges) > 1 and not scan.path


def span(scan: Scan) -> tuple[float, float]:
    """The times of the earliest and the latest beam, in seconds."""
    other = scan.time + scan.beam_time * (len(scan.ranges) - 1)
    return min(scan.time, other), max(scan.time, other)


def path_of(
    scan: Scan, times: Sequence[float], places: Sequence[HasPose]
) -> tuple[Displacement, ...]:
    """The path of a robot during a scan; () if unknown.

    `times` are strictly increasing, in seconds of the scan's clock; `places` are the robot's poses
    at these times. Before the first and after the last pose, the motion is extrapolated.
    """
    begin, end = span(scan)
    # At least two poses, of which the nearest are also those to extrapolate from.
    first = max(0, min(bisect_left(times, begin) - 1, len(times) - 2))
    last = max(bisect_left(times, end) + 1, first + 2)
    times, places = times[first:last], places[first:last]
    if not _covers(times, begin, end) or _jumps(times, places):
        return ()
    inner = [time for time in times if begin < time < end]
    knots = [begin, *inner, end]
    origin = _at(scan.time, times, places)
    return tuple([_displacement(t - scan.time, origin, _at(t, times, places)) for t in knots])


def _covers(times: Sequence[float], begin: float, end: float) -> bool:
    if len(times) < 2:
        return False
    gaps = [after - before for before, after in pairwise(times)]
    beyond = max(times[0] - begin, end - times[-1])
    return max(gaps) <= GAP_SECONDS and beyond <= GAP_SECONDS


def _jumps(times: Sequence[float], places: Sequence[HasPose]) -> bool:
    for number in range(1, len(times)):
        before, after = places[number - 1], places[number]
        seconds = times[number] - times[number - 1]
        dist = portable.hypot(after.x - before.x, after.y - before.y)
        turn = abs(math.remainder(after.angle - before.angle, 360.0))
        if dist > MAX_SPEED * seconds or turn > MAX_TURN * seconds:
            return True
    return False


def _at(time: float, times: Sequence[float], places: Sequence[HasPose]) -> Pose:
    """The pose at a time, interpolated or extrapolated from the two nearest poses."""
    after = min(max(bisect_left(times, time), 1), len(times) - 1)
    part = (time - times[after - 1]) / (times[after] - times[after - 1])
    return interpolated(places[after - 1], places[after], part)


def _displacement(seconds: float, origin: Pose, place: Pose) -> Displacement:
    seen = origin.seen(place)
    return Displacement(seconds, seen.x, seen.y, seen.angle)
