"""`rosbag`: a bag of ROS 1 or ROS 2, played into a world."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_services.bridges.rosbag.bag import Bag
from minerva_services.bridges.rosbag.messages import CONVERSIONS
from minerva_services.sensors.playing import Mounting, Pace, Playing


class Rosbag(Playing, lockstep=False):
    """Plays the sensors of a bag. Raises MisuseError.

    Args:
        file: a .bag, .db3 or .mcap, or the folder of a bag of ROS 2.
        robot: the id of the agent whose sensors they are.
        topics: what is played, and as which topic: {"/base_scan" = "scan"}; by default the first
            topic of each kind, on `scan`, `odometry`, `image`, `battery` and `position`.
        speed: so many times as fast as it was recorded; 0: as fast as it goes.
        loop: from its end on again from its beginning.
        offset: seconds of it that are left out at first.
        mount_x: metres ahead, where the sensors sit; by default as /tf_static says.
        mount_y: metres to the left, likewise.
        mount_angle: degrees, likewise.
        time_offset: seconds that are added to the times of scans, where the lidar's clock is not
            that of the odometry.

    """

    publishes = tuple(sorted({one.topic for one in CONVERSIONS.values()}))

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
    ) -> None:
        super().__init__(file, Pace(speed, loop, offset), time_offset)
        self._robot, self._topics = robot, _checked(topics)
        self._mounting = Mounting(mount_x, mount_y, mount_angle)
        if self._topics:
            # Which topics is up to each world, so these hide the class's.
            self.publishes = tuple(sorted(set(self._topics.values())))

    def recording(self) -> Bag:
        return Bag(Path(self.source), self.pass_over, self._robot, self._mounting, self._topics)


def _checked(topics: Any) -> Mapping[str, str]:
    if topics is None:
        return {}
    whole = isinstance(topics, Mapping) and all(
        isinstance(one, str) and one for pair in topics.items() for one in pair
    )
    if not whole:
        raise MisuseError(f'topics is {topics!r}; expected such as {{"/base_scan" = "scan"}}')
    return dict(topics)
