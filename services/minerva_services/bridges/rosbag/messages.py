"""Which messages of a bag are played, and as what."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.world.readings import Reading
from minerva_services.bridges.ros_messages import Mounting, images, readings


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a type of message becomes, and on which topic unless another is named."""

    topic: str
    read: Callable[[Any, str, Mounting, float | None], Reading]


CONVERSIONS: Final[Mapping[str, Conversion]] = {
    "sensor_msgs/msg/LaserScan": Conversion("scan", readings.scan_of),
    "nav_msgs/msg/Odometry": Conversion("odometry", readings.odometry_of),
    "sensor_msgs/msg/Image": Conversion("image", images.image_of),
    "sensor_msgs/msg/CompressedImage": Conversion("image", images.file_of),
    "sensor_msgs/msg/BatteryState": Conversion("battery", readings.battery_of),
    "sensor_msgs/msg/NavSatFix": Conversion("position", readings.position_of),
}
"""By the type's name; rosbags names those of ROS 1 so too."""
