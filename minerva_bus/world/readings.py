"""Raw sensor data on sensor topics, from a sensor to a generator.

Each kind of sensor has one layout. A simulated and a real sensor publish the same, so replacing one
by the other has no effect beyond the topic (section 4.3). Angles are in degrees counter-clockwise
from the robot's heading, lengths in metres. `time` is in seconds: simulated seconds for a simulated
sensor, otherwise those of the sensor's clock. `robot` is the id of the agent that has the sensor.

A lidar turns while its robot moves, so beam i starts at the robot's pose `i·beam_time` seconds
after the first beam. If the `path` of a scan is known, the end points of its beams are corrected
for that motion here, for all their users: generators, maps, scan matching and windows.
`Compensator` (log/recordings.py) makes the paths from the robot's odometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable


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


ENCODINGS: Final = ("jpeg", "png", "rgb8", "mono8", "32FC1")


@dataclass(frozen=True, slots=True)
class Image:
    """A camera image: the bytes of a JPEG or PNG file, or rows of pixels from the top.

    `encoding` is "jpeg", "png", "rgb8" (3 bytes a pixel), "mono8" (1 byte a pixel) or "32FC1" (a
    depth: metres along the optical axis as float32, little endian; infinite where nothing is).
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
    return ends(scan, beams * every, ranges[beams].astype(np.float64))


def ends(scan: Scan, beams: NDArray[np.intp], dist: Reals) -> tuple[Reals, Reals]:
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
