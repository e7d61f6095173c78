"""Raw sensor data, as it travels on sensor topics from whoever measures to a generator.

One layout for each kind of sensor: a simulated one and a real one publish the same, so swapping
them changes nothing behind the topic (4.3). Angles are degrees counter-clockwise from the
robot's heading, lengths metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One turn of a laser range finder.

    `ranges[i]` is the distance from the sensor at `first + i·step` degrees; `range_max` or more
    means that nothing was hit. The sensor sits at (`mount_x`, `mount_y`) on the robot, turned by
    `mount_angle`. `time` is in seconds; simulated seconds where the sensor is.
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


Reading: TypeAlias = Scan | Sightings
