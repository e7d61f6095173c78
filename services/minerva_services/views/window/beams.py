"""Laser scans as they come, and their beams where the robots are seen to be."""

from __future__ import annotations

from collections import deque

import numpy as np

from minerva_bus.semantics.picture import Picture
from minerva_bus.semantics.plane import Pose
from minerva_bus.world.beams import origins
from minerva_bus.world.readings import Reading, Scan
from minerva_services.views.window.painter import Beams
from minerva_services.views.window.picking import spots_of

_KEPT = 8


class Scans:
    """The last scans of each robot."""

    def __init__(self) -> None:
        self._scans: dict[str, deque[Scan]] = {}

    def take(self, reading: Reading) -> None:
        """A reading of any kind; scans are kept."""
        if isinstance(reading, Scan):
            self._scans.setdefault(reading.robot, deque(maxlen=_KEPT)).append(reading)

    def beams(self, picture: Picture, time: float) -> list[Beams]:
        """The beams of the robots that a picture of this simulated time shows."""
        spots = spots_of(picture, self._scans.keys())
        return [
            beams_of(_of_time(self._scans[robot], time), Pose(spot.x, spot.y, spot.angle))
            for robot, spot in spots.items()
        ]


def _of_time(scans: deque[Scan], time: float) -> Scan:
    """The newest scan that is not newer than the picture; a real sensor's clock is another."""
    return next((one for one in reversed(scans) if one.time <= time + 1e-6), scans[-1])


def beams_of(scan: Scan, robot: Pose) -> Beams:
    """A scan as seen from where its robot is."""
    sensor = robot.then(scan.mount_x, scan.mount_y, scan.mount_angle, 0.0)
    x, y, degrees = origins(scan, np.arange(len(scan.ranges)))
    ranges = np.asarray(scan.ranges, np.float64)
    hits = ranges < scan.range_max  # nor is what is not a number
    ranges = np.where(hits, ranges, scan.range_max)
    angle, turn = np.radians(degrees + robot.angle), np.radians(robot.angle)
    begin_x = robot.x + x * np.cos(turn) - y * np.sin(turn)
    begin_y = robot.y + x * np.sin(turn) + y * np.cos(turn)
    ends = np.stack([begin_x + ranges * np.cos(angle), begin_y + ranges * np.sin(angle)], axis=1)
    return Beams(sensor.x, sensor.y, ends, hits)
