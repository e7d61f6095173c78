"""Readings made of messages: pure functions, units of REP 103 to ours.

Each takes the message, the id of the robot that carries the sensor, how it is mounted, and the time
in seconds where that is not the message's own stamp. All raise GarbageError for what is no reading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.world.readings import Battery, Odometry, Position, Scan, Sighting, Sightings
from minerva_services.bridges.ros_messages.errors import GarbageError
from minerva_services.bridges.ros_messages.frames import Matrix, Mounting
from minerva_services.bridging.transforms import moved

_FARTHEST: Final = float(np.finfo(np.float32).max)
_FREE_BELOW: Final = 25
_OCCUPIED_FROM: Final = 65
"""Per cent, as nav2 and the map_server take them."""

_CENTRE: Final = Mounting()
Place: TypeAlias = tuple[float, float, float]
"""Metres, metres and degrees in a plane."""


def stamp_of(message: Any) -> float:
    """A message's time in seconds."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def scan_of(
    message: Any, robot: str, mounting: Mounting = _CENTRE, time: float | None = None
) -> Scan:
    """A LaserScan: what is too near, or no number, hit nothing; nor did what is beyond range."""
    ranges, most = np.asarray(message.ranges, np.float32), float(message.range_max)
    first, step = degrees_of(message.angle_min), degrees_of(message.angle_increment)
    _finite("angles", first, step)
    if math.isnan(most):
        raise GarbageError("its range_max is no number")
    most = min(most, _FARTHEST)
    valid = np.isfinite(ranges) & (ranges >= message.range_min)
    # Beyond the range is what hit nothing [REP 117]; NaN and what is too near are errors.
    ranges = np.where(valid, ranges, np.where(np.isposinf(ranges), np.float32(most), 0))
    mount, sign = mounting.mount, -1.0 if mounting.flipped else 1.0
    return Scan(
        robot, ranges.astype(np.float32), sign * first, sign * step, most,
        stamp_of(message) if time is None else time, mount.x, mount.y, mount.angle,
        _beam_time(message),
    )  # fmt: skip


def _beam_time(message: Any) -> float:
    """Seconds from one beam to the next; 0 where the driver does not know them."""
    seconds = float(message.time_increment)
    return seconds if math.isfinite(seconds) else 0.0


def degrees_of(radians: float) -> float:
    """Degrees of an angle that was a float32: the shortest number that is the same float32.

    So beams that are 4 degrees apart are just that, and not 3.9999999.
    """
    exact = math.degrees(radians)
    if not math.isfinite(exact):
        return exact
    told = np.float32(radians)
    shorter = (round(exact, digits) for digits in range(10))
    return next((one for one in shorter if np.float32(math.radians(one)) == told), exact)


def odometry_of(
    message: Any, robot: str, mounting: Mounting = _CENTRE, time: float | None = None
) -> Odometry:
    """An Odometry: the pose in the frame of odometry, speeds in that of the robot."""
    x, y, angle = place_of(message.pose.pose)
    twist = message.twist.twist
    speed, turn = _finite("twist", twist.linear.x, twist.angular.z)
    time = stamp_of(message) if time is None else time
    return Odometry(robot, x, y, angle, speed, math.degrees(turn), time)


def place_of(message: Any) -> Place:
    """A Pose in the plane."""
    at = message.position
    x, y, angle = _finite("pose", at.x, at.y, heading_of(message.orientation))
    return x, y, angle


def heading_of(orientation: Any) -> float:
    """Degrees about the vertical of a quaternion."""
    x, y, z, w = (float(getattr(orientation, name)) for name in "xyzw")
    return math.degrees(portable.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def battery_of(
    message: Any, robot: str, mounting: Mounting = _CENTRE, time: float | None = None
) -> Battery:
    """A BatteryState; some drivers say per cent where the part is meant."""
    (part,) = _finite("percentage", message.percentage)
    volts = float(message.voltage)
    charge = min(part if part <= 1.0 else part / 100.0, 1.0)
    time = stamp_of(message) if time is None else time
    return Battery(robot, max(0.0, charge), volts if math.isfinite(volts) else 0.0, time)


def position_of(
    message: Any, robot: str, mounting: Mounting = _CENTRE, time: float | None = None
) -> Position:
    """A NavSatFix; the accuracy is one standard deviation, the larger of north and east.

    Altitude and accuracy are None where the message does not have them.
    """
    if message.status.status < 0:
        raise GarbageError("it has no fix")
    latitude, longitude = _finite("place", message.latitude, message.longitude)
    altitude = float(message.altitude)
    spread = max(message.position_covariance[0], message.position_covariance[4])
    known = message.position_covariance_type > 0 and 0 <= spread < math.inf
    return Position(
        robot, latitude, longitude, altitude if math.isfinite(altitude) else None,
        math.sqrt(spread) if known else None, stamp_of(message) if time is None else time,
    )  # fmt: skip


def sightings_of(message: Any, robot: str, placed: Matrix, time: float | None = None) -> Sightings:
    """A Detection3DArray: each detection's likeliest class is a marker's name, its pose a place.

    `placed` is the transform from the message's frame to the robot, 4 x 4.
    """
    seen = [_sighting(one, placed) for one in message.detections if len(one.results)]
    return Sightings(robot, tuple(seen), stamp_of(message) if time is None else time)


def _sighting(detection: Any, placed: Matrix) -> Sighting:
    best = max(detection.results, key=lambda one: one.hypothesis.score)
    place = best.pose.pose.position
    x, y, _ = moved(placed, (place.x, place.y, place.z))
    _finite("detection", x, y)
    return Sighting(
        best.hypothesis.class_id, portable.hypot(x, y), math.degrees(portable.atan2(y, x))
    )


@dataclass(frozen=True, slots=True)
class Known:
    """What an OccupancyGrid says, as a robot's grid has it: 0 unknown, 1 free, 9 an obstacle.

    `cells` are (along x, along y), each `cell` metres wide, from the corner at `corner`.
    """

    cells: NDArray[np.int16]
    cell: float
    corner: Place


def known_of(message: Any) -> Known:
    """An OccupancyGrid; between free and occupied is unknown."""
    about, data = message.info, np.asarray(message.data, np.int8)
    width, height, cell = int(about.width), int(about.height), float(about.resolution)
    if not (width and height) or data.size != width * height:
        raise GarbageError(f"an OccupancyGrid of {data.size} cells for {width} × {height}")
    if not (math.isfinite(cell) and cell > 0):
        raise GarbageError(f"an OccupancyGrid whose cells are {cell} m wide")
    told = data.reshape(height, width).T
    free, occupied = (told >= 0) & (told < _FREE_BELOW), told >= _OCCUPIED_FROM
    cells = np.where(occupied, 9, np.where(free, 1, 0)).astype(np.int16)
    # A cell's width is a float32: 0.05 of it is meant to be that, and not 0.0500000007.
    return Known(cells, float(str(np.float32(cell))), place_of(about.origin))


def _finite(what: str, *numbers: float) -> tuple[float, ...]:
    if not all(map(math.isfinite, numbers)):
        raise GarbageError(f"its {what} is no finite number")
    return tuple(map(float, numbers))
