"""Where the beams of a scan end, as seen from where its robot was at the first beam.

A lidar turns while its robot moves, so beam i starts from where the robot was `i·beam_time` seconds
after the first beam. A scan whose `path` is known is corrected for that motion here, for everybody
who uses its beams: generators, maps, scan matching and windows.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.world.readings import Scan

Reals: TypeAlias = NDArray[np.float64]


def hits(scan: Scan, every: int = 1) -> tuple[Reals, Reals]:
    """Metres from the robot's centre and degrees from its heading of each beam that hit, (n,) each.

    `every` takes only each so many-th beam, beginning with the first.
    """
    ranges = scan.ranges[::every]
    # The limit as float32 too, or a beam that reads just the limit might seem to be below it.
    beams = np.flatnonzero((ranges > 0) & (ranges < np.float32(scan.range_max)))
    return _ends(scan, beams * every, ranges[beams].astype(np.float64))


def no_returns(scan: Scan, most: float, every: int = 1) -> tuple[Reals, Reals]:
    """As `hits`, of each beam that met nothing; it counts as free for `most` metres at most.

    A sensor whose `range_max` is no positive number says of no beam that it met nothing.
    """
    free = min(scan.range_max, most)
    if not free > 0:
        return np.empty(0), np.empty(0)
    beams = np.flatnonzero(scan.ranges[::every] >= np.float32(scan.range_max))
    return _ends(scan, beams * every, np.full(len(beams), float(free)))


def _ends(scan: Scan, beams: NDArray[np.intp], dist: Reals) -> tuple[Reals, Reals]:
    """Where beams end that go so many metres from the sensor."""
    if not (scan.mount_x or scan.mount_y or scan.path):
        return dist, _bearings(scan, beams)
    x, y, degrees = origins(scan, beams)
    heading = np.radians(degrees)
    ahead, left = x + dist * portable.cos(heading), y + dist * portable.sin(heading)
    angle: Reals = np.degrees(portable.atan2(left, ahead))
    return portable.hypot(ahead, left), angle


def origins(scan: Scan, beams: NDArray[np.intp]) -> tuple[Reals, Reals, Reals]:
    """Where beams start, in metres ahead and to the left, and where they point, in degrees.

    Both are relative to the robot at the first beam; `beams` are their numbers, (n,).
    """
    if not scan.path:
        zeros = np.zeros(len(beams))
        return zeros + scan.mount_x, zeros + scan.mount_y, _bearings(scan, beams)
    x, y, angle = _moved(scan, beams.astype(np.float64) * scan.beam_time)
    cos, sin = portable.cos(np.radians(angle)), portable.sin(np.radians(angle))
    ahead = x + cos * scan.mount_x - sin * scan.mount_y
    left = y + sin * scan.mount_x + cos * scan.mount_y
    return ahead, left, _bearings(scan, beams) + angle


def _bearings(scan: Scan, beams: NDArray[np.intp]) -> Reals:
    """Degrees from the robot's heading at which beams point."""
    return scan.first + beams.astype(np.float64) * float(scan.step) + scan.mount_angle


def _moved(scan: Scan, seconds: Reals) -> tuple[Reals, Reals, Reals]:
    """Metres ahead, metres to the left and degrees by which the robot has moved, (n,) each."""
    knots = np.array([place.seconds for place in scan.path])
    x: Reals = np.interp(seconds, knots, np.array([place.x for place in scan.path]))
    y: Reals = np.interp(seconds, knots, np.array([place.y for place in scan.path]))
    angle: Reals = np.interp(seconds, knots, np.array([place.angle for place in scan.path]))
    return x, y, angle
