"""End points of the beams of a scan, relative to its robot's pose at the first beam.

A lidar turns while its robot moves, so beam i starts at the robot's pose `i·beam_time` seconds
after the first beam. If the `path` of a scan is known, its beams are corrected for that motion
here, for all users of beams: generators, maps, scan matching and windows.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.world.readings import Scan

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
