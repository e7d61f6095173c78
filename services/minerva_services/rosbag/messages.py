"""Messages of ROS as readings: sensor_msgs and nav_msgs, the same in ROS 1 and ROS 2."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from minerva_bus.world.readings import Battery, Mount, Odometry, Position, Reading, Scan
from minerva_services.rosbag.errors import UnusableError
from minerva_services.rosbag.images import compressed_image, image

_FARTHEST: Final = float(np.finfo(np.float32).max)


def scan(message: Any, robot: str, time: float, mount: Mount) -> Scan:
    """sensor_msgs/LaserScan; what is nearer than its range_min was no hit. Raises UnusableError."""
    ranges = np.array(message.ranges, np.float32)
    ranges[ranges < message.range_min] = 0.0
    first, step = _finite("angles", message.angle_min, message.angle_increment)
    if math.isnan(message.range_max):
        raise UnusableError("its range_max is no number")
    return Scan(
        robot,
        ranges,
        math.degrees(first),
        math.degrees(step),
        min(float(message.range_max), _FARTHEST),
        time,
        mount.x,
        mount.y,
        mount.angle,
    )


def odometry(message: Any, robot: str, time: float, mount: Mount) -> Odometry:
    """nav_msgs/Odometry in the plane. Raises UnusableError."""
    at, turned = message.pose.pose.position, message.pose.pose.orientation
    moves, turns = message.twist.twist.linear, message.twist.twist.angular
    x, y, angle = _finite("pose", at.x, at.y, _yaw(turned.x, turned.y, turned.z, turned.w))
    speed, turn = _finite("twist", moves.x, turns.z)
    return Odometry(robot, x, y, math.degrees(angle), speed, math.degrees(turn), time)


def battery(message: Any, robot: str, time: float, mount: Mount) -> Battery:
    """sensor_msgs/BatteryState; some drivers say per cent where the part is meant.

    Raises UnusableError.
    """
    (part,) = _finite("percentage", message.percentage)
    volts = float(message.voltage)
    charge = min(part if part <= 1.0 else part / 100.0, 1.0)
    return Battery(robot, max(0.0, charge), volts if math.isfinite(volts) else 0.0, time)


def position(message: Any, robot: str, time: float, mount: Mount) -> Position:
    """sensor_msgs/NavSatFix; the accuracy is one standard deviation, 0 where it is not known.

    Raises UnusableError.
    """
    if message.status.status < 0:
        raise UnusableError("it has no fix")
    latitude, longitude = _finite("place", message.latitude, message.longitude)
    altitude = float(message.altitude)
    spread = max(message.position_covariance[0], message.position_covariance[4])
    known = message.position_covariance_type > 0 and 0 <= spread < math.inf
    return Position(
        robot,
        latitude,
        longitude,
        altitude if math.isfinite(altitude) else 0.0,
        math.sqrt(spread) if known else 0.0,
        time,
    )


def _yaw(x: float, y: float, z: float, w: float) -> float:
    """The turn about the vertical of a quaternion, in radians."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _finite(what: str, *numbers: float) -> tuple[float, ...]:
    if not all(map(math.isfinite, numbers)):
        raise UnusableError(f"its {what} is no finite number")
    return tuple(map(float, numbers))


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a type of message becomes, and on which topic unless another is named."""

    topic: str
    read: Callable[[Any, str, float, Mount], Reading]


CONVERSIONS: Final[Mapping[str, Conversion]] = {
    "sensor_msgs/msg/LaserScan": Conversion("scan", scan),
    "nav_msgs/msg/Odometry": Conversion("odometry", odometry),
    "sensor_msgs/msg/Image": Conversion("image", image),
    "sensor_msgs/msg/CompressedImage": Conversion("image", compressed_image),
    "sensor_msgs/msg/BatteryState": Conversion("battery", battery),
    "sensor_msgs/msg/NavSatFix": Conversion("position", position),
}
"""By the type's name; rosbags names those of ROS 1 so too."""
