"""`rosbag`: plays a bag of ROS 1 or ROS 2 into a world."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_services.bridges.ros_messages.ranges import HeightBand
from minerva_services.bridges.rosbag.bag import TOPICS, Bag
from minerva_services.sensors.playback import MountOverride, PlaybackPace, Playing


class Rosbag(Playing, when="freely"):
    """Plays the sensors of a bag. Raises MisuseError.

    Args:
        file: a .bag, .db3 or .mcap, or the folder of a ROS 2 bag.
        robot: the id of the agent that carries the sensors.
        topics: what to play, and as which topic: {"/base_scan" = "scan"}; by default the first
          topic of each kind, on `scan`, `odometry`, `image`, `battery`, `position` and `range`;
          point clouds become a `scan`, too.
        speed: playback speed relative to the recording; 0: as fast as possible.
        loop: start over at the end.
        offset: seconds to skip at the start.
        mount_x: sensor position, metres ahead of the robot's centre; by default from /tf_static.
        mount_y: metres to the left, likewise.
        mount_angle: degrees, likewise.
        time_offset: seconds added to the times of scans if the lidar's clock differs from that of
          odometry.
        points_low: metres above the base from which points of a cloud are obstacles.
        points_high: metres above the base up to which they are.
        points_range: metres from the sensor up to which they are.

    """

    publishes = tuple(sorted(set(TOPICS.values())))

    def __init__(
        self,
        file: str,
        robot: str = "r1",
        topics: Mapping[str, Any] | None = None,
        speed: float = 1.0,
        loop: bool = False,
        offset: float = 0.0,
        mount_x: float | None = None,
        mount_y: float | None = None,
        mount_angle: float | None = None,
        time_offset: float = 0.0,
        points_low: float = 0.1,
        points_high: float = 1.0,
        points_range: float = 10.0,
    ) -> None:
        super().__init__(file, PlaybackPace(speed, loop, offset), time_offset)
        self._robot, self._topics = robot, _checked(topics)
        self._mounting = MountOverride(mount_x, mount_y, mount_angle)
        self._band = HeightBand(points_low, points_high, points_range)
        if self._topics:
            # Topics differ between worlds, so the instance attribute hides the class's.
            self.publishes = tuple(sorted(set(self._topics.values())))

    def recording(self) -> Bag:
        path, passed = Path(self.source), self.pass_over
        return Bag(path, passed, self._robot, self._mounting, self._topics, self._band)


def _checked(topics: Any) -> Mapping[str, str]:
    if topics is None:
        return {}
    is_valid = isinstance(topics, Mapping) and all(
        isinstance(name, str) and name for pair in topics.items() for name in pair
    )
    if not is_valid:
        raise MisuseError(f'topics is {topics!r}; expected for example {{"/base_scan" = "scan"}}')
    return dict(topics)
