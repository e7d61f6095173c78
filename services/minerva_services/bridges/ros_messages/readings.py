"""Readings from ROS messages: pure functions that convert REP 103 units to ours.

Arguments are the message, the id of the robot that carries the sensor, the mount, and the time in
seconds if it is not the message's stamp. All raise GarbageError for invalid messages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.world.readings import Battery, Odometry, Position, Scan, Sighting, Sightings
from minerva_services.bridges.ros_messages.frames import GarbageError, Matrix, SensorMount
from minerva_services.bridging.transforms import moved, unit_quaternion

_MAX_FLOAT: Final = float(np.finfo(np.float32).max)
_FREE_BELOW: Final = 25
_OCCUPIED_FROM: Final = 65
"""Percentages, as in nav2 and the map_server."""

_CENTRE: Final = SensorMount()
Place: TypeAlias = tuple[float, float, float]
"""Metres, metres and degrees in a plane."""


def stamp_of(message: Any) -> float:
    """A message's time in seconds."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def scan_of(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Scan:
    """A LaserScan; ranges that are too short, too long or not numbers count as no hit."""
    ranges = np.asarray(message.ranges, np.float32)
    least, most = float(message.range_min), float(message.range_max)
    first, step = degrees_of(message.angle_min), degrees_of(message.angle_increment)
    _finite("angles", first, step)
    if not len(ranges):
        raise GarbageError("no beams")
    if not step and len(ranges) > 1:
        raise GarbageError(f"angle_increment is 0, with {len(ranges)} beams")
    # Without limits, all ranges would count as no hit, or none.
    if math.isnan(least):
        raise GarbageError("range_min is not a number")
    if math.isnan(most):
        raise GarbageError("range_max is not a number")
    if most <= max(0.0, least):
        raise GarbageError(f"range_max is {most:g}; expected metres above 0 and range_min")
    # Ranges of no return are set to `most`, so it must be finite, also if the driver has no limit.
    most = min(most, _MAX_FLOAT)
    valid = np.isfinite(ranges) & (ranges >= least)
    # +inf means beyond range [REP 117]; NaN and ranges below the minimum are errors.
    ranges = np.where(valid, ranges, np.where(np.isposinf(ranges), np.float32(most), 0))
    # The beams of a scanner that is mounted upside down run clockwise.
    mount, sign = mounting.mount, -1.0 if mounting.flipped else 1.0
    return Scan(
        robot, ranges.astype(np.float32), sign * first, sign * step, most,
        stamp_of(message) if time is None else time, mount.x, mount.y, mount.angle,
        _beam_time(message),
    )  # fmt: skip


def _beam_time(message: Any) -> float:
    """Seconds between beams; 0 if the driver does not know."""
    seconds = float(message.time_increment)
    return seconds if math.isfinite(seconds) else 0.0


def degrees_of(radians: float) -> float:
    """Degrees of a float32 angle: the shortest number with the same float32 value.

    Beams 4 degrees apart are then exactly that, and not 3.9999999.
    """
    exact = math.degrees(radians)
    if not math.isfinite(exact):
        return exact
    stored = np.float32(radians)
    shorter = (round(exact, digits) for digits in range(10))
    return next(
        (degrees for degrees in shorter if np.float32(math.radians(degrees)) == stored), exact
    )


def odometry_of(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Odometry:
    """An Odometry: the pose in the odometry frame, speeds in the robot's frame."""
    x, y, angle = place_of(message.pose.pose)
    twist = message.twist.twist
    speed, turn = _finite("twist", twist.linear.x, twist.angular.z)
    time = stamp_of(message) if time is None else time
    return Odometry(robot, x, y, angle, speed, math.degrees(turn), time)


def place_of(message: Any) -> Place:
    """A Pose in the plane."""
    at, turned = message.position, message.orientation
    x, y, *_ = _finite("pose", at.x, at.y, turned.x, turned.y, turned.z, turned.w)
    return x, y, heading_of(turned)


def heading_of(orientation: Any) -> float:
    """Heading in degrees of a quaternion. Raises GarbageError."""
    try:
        x, y, z, w = unit_quaternion(orientation)
    except ValueError as error:
        raise GarbageError(str(error)) from None
    return math.degrees(portable.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def battery_of(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Battery:
    """A BatteryState; drivers that report per cent instead of a fraction are tolerated."""
    (part,) = _finite("percentage", message.percentage)
    if part < 0:
        raise GarbageError(f"percentage is {part:g}")
    volts = float(message.voltage)
    charge = min(part if part <= 1.0 else part / 100.0, 1.0)
    time = stamp_of(message) if time is None else time
    return Battery(robot, charge, volts if math.isfinite(volts) else 0.0, time)


def position_of(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Position:
    """A NavSatFix; the accuracy is one standard deviation, the larger of north and east.

    Altitude and accuracy are None if the message lacks them.
    """
    if message.status.status < 0:
        raise GarbageError("no fix")
    latitude, longitude = _finite("place", message.latitude, message.longitude)
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise GarbageError(f"latitude {latitude:g} and longitude {longitude:g} are no place")
    altitude = float(message.altitude)
    spread = max(message.position_covariance[0], message.position_covariance[4])
    known = message.position_covariance_type > 0 and 0 <= spread < math.inf
    return Position(
        robot, latitude, longitude, altitude if math.isfinite(altitude) else None,
        math.sqrt(spread) if known else None, stamp_of(message) if time is None else time,
    )  # fmt: skip


def sightings_of(message: Any, robot: str, placed: Matrix, time: float | None = None) -> Sightings:
    """A Detection3DArray: each detection's most likely class is a marker, its pose a position.

    `placed` is the transform from the message's frame to the robot, 4 x 4.
    """
    seen = [
        _sighting(detection, placed) for detection in message.detections if len(detection.results)
    ]
    return Sightings(robot, tuple(seen), stamp_of(message) if time is None else time)


def _sighting(detection: Any, placed: Matrix) -> Sighting:
    best = max(detection.results, key=_score)
    place = best.pose.pose.position
    x, y, _ = moved(placed, (place.x, place.y, place.z))
    _finite("detection", x, y)
    return Sighting(
        best.hypothesis.class_id, portable.hypot(x, y), math.degrees(portable.atan2(y, x))
    )


def _score(result: Any) -> float:
    # Comparisons with nan depend on the order.
    score = float(result.hypothesis.score)
    return -math.inf if math.isnan(score) else score


@dataclass(frozen=True, slots=True)
class MapGrid:
    """An OccupancyGrid in the codes of a robot's grid: 0 unknown, 1 free, 9 obstacle.

    `cells` are (along x, along y), each `cell` metres wide, from the corner at `corner`.
    """

    cells: NDArray[np.int16]
    cell: float
    corner: Place


def grid_of(message: Any) -> MapGrid:
    """An OccupancyGrid; probabilities between free and occupied are unknown."""
    about, data = message.info, np.asarray(message.data, np.int8)
    width, height, cell = int(about.width), int(about.height), float(about.resolution)
    if not (width and height) or data.size != width * height:
        raise GarbageError(f"an OccupancyGrid of {data.size} cells for {width} × {height}")
    if not (math.isfinite(cell) and cell > 0):
        raise GarbageError(f"an OccupancyGrid whose cells are {cell} m wide")
    values = data.reshape(height, width).T
    free, occupied = (values >= 0) & (values < _FREE_BELOW), values >= _OCCUPIED_FROM
    cells = np.where(occupied, 9, np.where(free, 1, 0)).astype(np.int16)
    # The side is a float32: round-trip through its shortest text, 0.05 and not 0.0500000007.
    return MapGrid(cells, float(str(np.float32(cell))), place_of(about.origin))


def _finite(what: str, *numbers: float) -> tuple[float, ...]:
    if not all(map(math.isfinite, numbers)):
        raise GarbageError(f"{what} not finite")
    return tuple(map(float, numbers))
