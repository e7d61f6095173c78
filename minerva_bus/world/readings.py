"""Raw sensor data on sensor topics, from a sensor to a generator, and recordings of such data.

Each kind of sensor has one layout. A simulated and a real sensor publish the same, so replacing one
by the other has no effect beyond the topic (section 4.3). Angles are in degrees counter-clockwise
from the robot's heading, lengths in metres. `time` is in seconds: simulated seconds for a simulated
sensor, otherwise those of the sensor's clock. `robot` is the id of the agent that has the sensor.

A lidar turns while its robot moves, so beam i starts at the robot's pose `i·beam_time` seconds
after the first beam. If the `path` of a scan is known, the end points of its beams are corrected
for that motion here, for all their users: generators, maps, scan matching and windows.
`Compensator` makes the paths from the robot's odometry.

A `Recording` is a log or a bag, for playback and mapping. Its readings are ordered by time, and
clocks step back. A time that is older than the latest one by more than STEP_SECONDS is a step of
the clock. It begins a new segment: what follows is ordered within the segment, and the step itself
takes no time. A smaller difference is a reading that arrives late.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.errors import MinervaError, MisuseError, nearest
from minerva_bus.semantics.poses import HasPose, Pose, interpolated


@dataclass(frozen=True, slots=True)
class Mount:
    """Pose of a sensor on its robot: metres ahead (x) and to the left (y), angle in degrees."""

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0


CENTRE: Final = Mount()


@dataclass(frozen=True, slots=True)
class Displacement:
    """Pose of a robot `seconds` after a scan's first beam, relative to its pose at that beam.

    Metres ahead (x) and to the left (y), degrees counter-clockwise.
    """

    seconds: float
    x: float
    y: float
    angle: float


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One turn of a laser range finder.

    `ranges[i]`, shape (n,), is the distance in metres at `first + i·step` degrees from the sensor's
    direction. `range_max` or more, including infinity, means no obstacle in range; 0 or less and
    NaN mean no measurement.

    `time` is that of the first beam; beam i is measured `i·beam_time` seconds later (0: all beams
    at once). `path` is the motion of the robot from the earliest to the latest beam, in order of
    time; empty if unknown.
    """

    robot: str
    ranges: NDArray[np.float32]
    first: float
    step: float
    range_max: float
    time: float
    mount_x: float = 0.0
    mount_y: float = 0.0
    mount_angle: float = 0.0
    beam_time: float = 0.0
    path: tuple[Displacement, ...] = ()


@dataclass(frozen=True, slots=True)
class Sighting:
    """A marker in a camera image: distance in metres, angle from the robot's heading in degrees."""

    marker: str
    distance: float
    angle: float


@dataclass(frozen=True, slots=True)
class Sightings:
    """The markers in one camera image."""

    robot: str
    seen: tuple[Sighting, ...]
    time: float


ENCODINGS: Final = ("jpeg", "png", "rgb8", "mono8")


@dataclass(frozen=True, slots=True)
class Image:
    """A camera image: the bytes of a JPEG or PNG file, or rows of pixels from the top.

    `encoding` is "jpeg", "png", "rgb8" (3 bytes a pixel) or "mono8" (1 byte a pixel).
    """

    robot: str
    data: bytes
    encoding: str
    width: int
    height: int
    time: float
    mount: Mount = CENTRE


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose and velocity of a robot, estimated from its wheels.

    Metres and degrees in the frame of the odometry; metres and degrees per second.
    """

    robot: str
    x: float
    y: float
    angle: float
    speed: float
    turn: float
    time: float


@dataclass(frozen=True, slots=True)
class Battery:
    """State of a battery: charge from 0 to 1, and volts (0: not measured)."""

    robot: str
    charge: float
    volts: float
    time: float


@dataclass(frozen=True, slots=True)
class Position:
    """A position on the Earth: degrees north and east (WGS 84), altitude and accuracy in metres.

    `altitude` and `accuracy` are None where the receiver does not report them.
    """

    robot: str
    latitude: float
    longitude: float
    altitude: float | None
    accuracy: float | None
    time: float


Reading: TypeAlias = Scan | Sightings | Image | Odometry | Battery | Position


Reals: TypeAlias = NDArray[np.float64]


def hits(scan: Scan, every: int = 1) -> tuple[Reals, Reals]:
    """Distances from the robot's centre (m) and angles (deg) of beams that hit, (n,) each.

    With `every` = k, only each k-th beam is used, from the first.
    """
    ranges = scan.ranges[::every]
    # Compared as float32: in float64, a beam at exactly the limit could seem to be below it.
    beams = np.flatnonzero((ranges > 0) & (ranges < np.float32(scan.range_max)))
    return _ends(scan, beams * every, ranges[beams].astype(np.float64))


def no_returns(scan: Scan, most: float, every: int = 1) -> tuple[Reals, Reals]:
    """As `hits`, for beams without an obstacle in range, free for at most `most` metres.

    Without a positive `range_max` there are none, because such a sensor cannot report them.
    """
    free = min(scan.range_max, most)
    if not free > 0:
        return np.empty(0), np.empty(0)
    beams = np.flatnonzero(scan.ranges[::every] >= np.float32(scan.range_max))
    return _ends(scan, beams * every, np.full(len(beams), float(free)))


def _ends(scan: Scan, beams: NDArray[np.intp], dist: Reals) -> tuple[Reals, Reals]:
    """End points, as for `hits`, of beams with lengths `dist` in metres from the sensor."""
    # The usual case of a sensor in the centre: its polar coordinates are those of the robot.
    if not (scan.mount_x or scan.mount_y or scan.path):
        return dist, _bearings(scan, beams)
    x, y, degrees = origins(scan, beams)
    cos, sin = portable.cos_sin(np.radians(degrees))
    ahead, left = x + dist * cos, y + dist * sin
    angle: Reals = np.degrees(portable.atan2(left, ahead))
    return portable.hypot(ahead, left), angle


def origins(scan: Scan, beams: NDArray[np.intp]) -> tuple[Reals, Reals, Reals]:
    """Origins of beams, in metres ahead and to the left, and their directions in degrees.

    Both are relative to the robot's pose at the first beam; `beams` are numbers of beams, (n,).
    """
    if not scan.path:
        zeros = np.zeros(len(beams))
        return zeros + scan.mount_x, zeros + scan.mount_y, _bearings(scan, beams)
    x, y, angle = _moved(scan, beams.astype(np.float64) * scan.beam_time)
    cos, sin = portable.cos_sin(np.radians(angle))
    ahead = x + cos * scan.mount_x - sin * scan.mount_y
    left = y + sin * scan.mount_x + cos * scan.mount_y
    return ahead, left, _bearings(scan, beams) + angle


def _bearings(scan: Scan, beams: NDArray[np.intp]) -> Reals:
    """Directions of beams, in degrees from the robot's heading."""
    return scan.first + beams.astype(np.float64) * float(scan.step) + scan.mount_angle


def _moved(scan: Scan, seconds: Reals) -> tuple[Reals, Reals, Reals]:
    """Motion of the robot after some seconds: metres ahead and to the left, degrees; (n,) each."""
    knots = np.array([place.seconds for place in scan.path])
    x: Reals = np.interp(seconds, knots, np.array([place.x for place in scan.path]))
    y: Reals = np.interp(seconds, knots, np.array([place.y for place in scan.path]))
    angle: Reals = np.interp(seconds, knots, np.array([place.angle for place in scan.path]))
    return x, y, angle


PassOver: TypeAlias = Callable[[str, str], None]
"""Called with skipped data: its kind, and a line with position and reason."""

Progress: TypeAlias = Callable[[float], None]
"""Called occasionally with the progress of a task, from 0 to 1."""


POSE: Final = "pose"
CORRECTION: Final = "correction"
"""Topics of a recording on which an `Odometry` is not what wheels measured; see `Recording`."""


class RecordingError(MinervaError):
    """A recording cannot be read, or lacks the requested data."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A reading, its sensor topic, and the time of recording in seconds.

    `stamp` is from the clock of the recorder, which may jump; the reading's `time` is from the
    clock of its sensor.
    """

    stamp: float
    topic: str
    reading: Reading


class Recording(Protocol):
    """A file of readings.

    The topic `pose` has an `Odometry` right before each scan for which the recording has a pose of
    the robot. The topic `correction` has one where the recorder has reset the odometry: later
    readings of odometry continue from the pose in it.
    """

    @property
    def part(self) -> float:
        """The part that has been read since the last call of `readings`, from 0 to 1."""
        ...

    def readings(self) -> Iterator[Recorded]:
        """All readings in the order of the file. Raises RecordingError."""
        ...

    def close(self) -> None:
        """Release the file."""
        ...


POSES: Final = ("published", "odometry", "matched")


@dataclass(frozen=True, slots=True)
class MapChoice:
    """Options of a map of a recording. Raises MisuseError.

    `cell` is the side of a cell and `farthest` the longest range to use (0: as recorded), in
    metres; `begin` and `end` are seconds after the first reading. `poses` selects the poses of the
    robot: those `published` in the recording, those of the `odometry`, or those corrected by scans
    `matched` to the map. `time_offset`, in seconds, is added to the times of scans, because the
    clocks of lidar and odometry may differ.
    """

    cell: float = 0.05
    farthest: float = 0.0
    begin: float = 0.0
    end: float = math.inf
    poses: str = "published"
    time_offset: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.cell < math.inf:
            raise MisuseError(f"the cell is {self.cell:g} m; expected metres above 0")
        if not 0 <= self.farthest < math.inf:
            raise MisuseError(f"the range is {self.farthest:g} m; expected metres, or 0 for all")
        if not 0 <= self.begin < self.end:
            raise MisuseError(
                f"from {self.begin:g} to {self.end:g} s there is nothing; expected from < to,"
                " seconds after the beginning"
            )
        if not math.isfinite(self.time_offset):
            raise MisuseError(f"the time offset is {self.time_offset:g} s; expected seconds")
        if self.poses not in POSES:
            known = f"expected {', '.join(POSES)}"
            raise MisuseError(
                f"there are no poses {self.poses!r}{nearest(self.poses, [*POSES], known)}"
            )


STEP_SECONDS: Final = 1.0
"""Maximum seconds by which a reading is late; an older time is a step of the clock."""


class RecordingClock:
    """The time of a recording, from a series of times whose clock may step back.

    `seconds` since the first time, and the number of `steps`.
    """

    def __init__(self) -> None:
        self.steps = 0
        self._begin = self._latest = math.nan
        self._before: tuple[float, float] | None = None

    @property
    def seconds(self) -> float:
        """Seconds since the first time, without steps."""
        return 0.0 if math.isnan(self._begin) else self._latest - self._begin

    def advance(self, time: float) -> float:
        """Advance to the next time of the series; returns the seconds that have passed.

        They are 0 for a step, a late reading, and a time that is not finite.
        """
        if not math.isfinite(time):
            return 0.0
        before, self._before = self._before, None
        # A single old time is damaged: its successor continues from the one before.
        if before is not None and abs(time - before[1]) < time - self._latest:
            self._begin, self._latest = before
        if math.isnan(self._begin):
            self._begin = self._latest = time
        passed = time - self._latest
        if passed < -STEP_SECONDS:
            self.steps += 1
            self._before = self._begin, self._latest
            self._begin, self._latest = self._begin + passed, time
        self._latest = max(self._latest, time)
        return max(0.0, passed)


def seconds_of(times: Iterable[float]) -> list[float]:
    """Seconds since the first of a series of times, without steps."""
    clock, seconds = RecordingClock(), list[float]()
    for time in times:
        clock.advance(time)
        seconds.append(clock.seconds)
    return seconds


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
