"""Message types of a bag that can be played, and their conversions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.world.readings import Reading
from minerva_services.bridges.ros_messages import SensorMount, images, readings


@dataclass(frozen=True, slots=True)
class Conversion:
    """Conversion of a message type, and its default topic."""

    topic: str
    read: Callable[[Any, str, SensorMount, float | None], Reading]


CONVERSIONS: Final[Mapping[str, Conversion]] = {
    "sensor_msgs/msg/LaserScan": Conversion("scan", readings.scan_of),
    "nav_msgs/msg/Odometry": Conversion("odometry", readings.odometry_of),
    "sensor_msgs/msg/Image": Conversion("image", images.image_of),
    "sensor_msgs/msg/CompressedImage": Conversion("image", images.file_of),
    "sensor_msgs/msg/BatteryState": Conversion("battery", readings.battery_of),
    "sensor_msgs/msg/NavSatFix": Conversion("position", readings.position_of),
}
"""Keyed by type name; rosbags uses the same names for ROS 1."""
