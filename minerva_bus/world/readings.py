"""Raw sensor data on sensor topics, from a simulated or real sensor to a generator.

Each kind of sensor has one layout. A simulated and a real sensor publish the same, so replacing one
by the other has no effect beyond the topic (section 4.3). Angles are in degrees counter-clockwise
from the robot's heading, lengths in metres. `time` is in seconds: simulated seconds for a simulated
sensor, otherwise those of the sensor's clock. `robot` is the id of the agent that has the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray


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
