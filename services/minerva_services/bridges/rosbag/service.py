"""`rosbag`: plays a bag of ROS 1 or ROS 2 into a world."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.world.services import WorldInfo
from minerva_services.bridges.ros_messages.conversion import TOPICS
from minerva_services.bridges.ros_messages.definitions import MessageTopic
from minerva_services.bridges.ros_messages.ranges import HeightBand
from minerva_services.bridges.rosbag.bag import Bag
from minerva_services.options import grouped, names_in, takes_options
from minerva_services.sensors.playback import MountOverride, PlaybackPace, Playing


class Rosbag(Playing, when="freely"):
    """Plays the sensors of a bag. Raises MisuseError.

    Its other options are those of `PlaybackPace`, `MountOverride` and `HeightBand`.

    Args:
        file: a .bag, .db3 or .mcap, or the folder of a ROS 2 bag.
        robot: the id of the agent that carries the sensors.
        topics: what to play, and as which topic: {"/base_scan" = "scan"}; by default the first
          topic of each kind, on `scan`, `odometry`, `image`, `battery`, `position` and `range`;
          point clouds become a `scan`, too.
        time_offset: seconds added to the times of scans if the lidar's clock differs from that of
          odometry.
        events: topics whose messages become events, with the tables of `ros2`.

    """

    publishes = tuple(sorted(set(TOPICS.values())))

    @takes_options(PlaybackPace, MountOverride, HeightBand)
    def __init__(
        self,
        file: str,
        robot: str = "r1",
        topics: Mapping[str, Any] | None = None,
        time_offset: float = 0.0,
        events: Mapping[str, Any] | None = None,
        **further: Any,
    ) -> None:
        groups = grouped(further, PlaybackPace, MountOverride, HeightBand)
        pace, self._mounting, self._band = groups
        super().__init__(file, pace, time_offset)
        self._robot, self._topics = robot, _checked(topics)
        self.concerns = names_in(robot)
        self._events = {
            name: MessageTopic(f"rosbag: events.{name}", table)
            for name, table in (events or {}).items()
        }
        if self._topics:
            # Topics differ between worlds, so the instance attribute hides the class's.
            self.publishes = tuple(sorted(set(self._topics.values())))

    def check(self, world: WorldInfo) -> None:
        """Raises MisuseError if the events do not fit the world, or their messages."""
        for topic in self._events.values():
            topic.check(world)

    def generates(self) -> tuple[str, ...]:
        """The event types of messages."""
        return tuple(dict.fromkeys(topic.event for topic in self._events.values()))

    def recording(self) -> Bag:
        return Bag(
            Path(self.source), self.pass_over,
            self._robot, self._mounting, self._topics, self._events, self._band,
        )  # fmt: skip


def _checked(topics: Any) -> Mapping[str, str]:
    if topics is None:
        return {}
    is_valid = isinstance(topics, Mapping) and all(
        isinstance(name, str) and name for pair in topics.items() for name in pair
    )
    if not is_valid:
        raise MisuseError(f'topics is {topics!r}; expected for example {{"/base_scan" = "scan"}}')
    return dict(topics)
