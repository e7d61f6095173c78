"""Buffered laser scans, and their beams at the displayed robots."""

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


class ScanBuffer:
    """The latest scans of each robot."""

    def __init__(self) -> None:
        self._scans: dict[str, deque[Scan]] = {}

    def add(self, reading: Reading) -> None:
        """Add a reading; readings other than scans are ignored."""
        if isinstance(reading, Scan):
            self._scans.setdefault(reading.robot, deque(maxlen=_KEPT)).append(reading)

    def beams(self, picture: Picture, time: float) -> list[Beams]:
        """The beams of all robots in a picture of this simulated time."""
        spots = spots_of(picture, self._scans.keys())
        return [
            beams_of(_of_time(self._scans[robot], time), Pose(spot.x, spot.y, spot.angle))
            for robot, spot in spots.items()
        ]


def _of_time(scans: deque[Scan], time: float) -> Scan:
    """The newest scan not newer than the picture, or the oldest: real sensors have other clocks."""
    return next((scan for scan in reversed(scans) if scan.time <= time + 1e-6), scans[-1])


def beams_of(scan: Scan, robot: Pose) -> Beams:
    """The beams of a scan, relative to the robot's displayed pose."""
    sensor = robot.then(scan.mount_x, scan.mount_y, scan.mount_angle, 0.0)
    x, y, degrees = origins(scan, np.arange(len(scan.ranges)))
    ranges = np.asarray(scan.ranges, np.float64)
    hits = ranges < scan.range_max  # False for NaN, too
    ranges = np.where(hits, ranges, scan.range_max)
    angle, turn = np.radians(degrees + robot.angle), np.radians(robot.angle)
    begin_x = robot.x + x * np.cos(turn) - y * np.sin(turn)
    begin_y = robot.y + x * np.sin(turn) + y * np.cos(turn)
    ends = np.stack([begin_x + ranges * np.cos(angle), begin_y + ranges * np.sin(angle)], axis=1)
    return Beams(sensor.x, sensor.y, ends, hits)
