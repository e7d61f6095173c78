"""Raw sensor data, as it travels on sensor topics from whoever measures to a generator.

One layout for each kind of sensor: a simulated one and a real one publish the same, so swapping
them changes nothing behind the topic (4.3). Angles are degrees counter-clockwise from the
robot's heading, lengths metres. `time` is in seconds: simulated seconds where the sensor is
simulated, else those of the sensor's own clock. `robot` is the id of the agent that carries it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Mount:
    """Where a sensor sits on its robot: metres ahead (x) and to the left (y), degrees turned."""

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0


CENTRE: Final = Mount()


@dataclass(frozen=True, slots=True)
class Displacement:
    """Where a robot is so many seconds after a scan's first beam, as seen from its place then.

    Metres ahead and to the left, degrees counter-clockwise.
    """

    seconds: float
    x: float
    y: float
    angle: float


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One turn of a laser range finder.

    `ranges[i]` is the distance from the sensor at `first + i·step` degrees from where it points;
    `range_max` or more, also infinity, means that nothing was hit; 0 or less, and NaN, that nothing
    was measured. Shape (n,), metres.

    `time` is that of the first beam; beam i is measured `i·beam_time` seconds later, all beams at
    once where that is 0. `path` is how the robot moved meanwhile, in the order of time, from the
    earliest beam to the latest; empty where that is not known.
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
    """A marker that a camera sees, at a distance and an angle from the robot's heading."""

    marker: str
    distance: float
    angle: float


@dataclass(frozen=True, slots=True)
class Sightings:
    """What one camera image shows of markers."""

    robot: str
    seen: tuple[Sighting, ...]
    time: float


ENCODINGS: Final = ("jpeg", "png", "rgb8", "mono8")


@dataclass(frozen=True, slots=True)
class Image:
    """One image of a camera: a JPEG or PNG file's bytes, or rows of pixels from the top.

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
    """Where a robot's wheels believe it to be since they were started, and how fast it goes.

    Metres and degrees in the odometry's own frame; metres and degrees per second.
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
    """A robot's battery: its charge from 0 to 1, and its voltage in volts (0: not measured)."""

    robot: str
    charge: float
    volts: float
    time: float


@dataclass(frozen=True, slots=True)
class Position:
    """A place on the Earth: degrees north and east (WGS 84), metres up, metres of accuracy.

    `altitude` and `accuracy` are None where the receiver does not report them.
    """

    robot: str
    latitude: float
    longitude: float
    altitude: float | None
    accuracy: float | None
    time: float


Reading: TypeAlias = Scan | Sightings | Image | Odometry | Battery | Position
