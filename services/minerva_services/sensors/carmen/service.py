"""`carmen`: plays a CARMEN log into a world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_services.options import grouped, names_in, takes_options
from minerva_services.sensors.carmen.log import CarmenLog, LogTopics
from minerva_services.sensors.playback import MountOverride, PlaybackPace, Playing


class Carmen(Playing, when="freely"):
    """Plays the laser and the odometry of a CARMEN log. Raises MisuseError.

    Its other options are those of `PlaybackPace` and `MountOverride`.

    Args:
        file: the log, plain or gzipped.
        robot: the id of the agent that carries the sensors.
        scan: the topic of the scans (FLASER, RAWLASER1, ROBOTLASER1); "": none.
        odometry: the topic of wheel odometry (ODOM), an `Odometry` each; "": none.
        pose: the topic of the robot's poses, an `Odometry` before each scan; "": none.
        range_max: range in metres from which nothing was hit; 0: as logged, at most 80 m.

    """

    @takes_options(PlaybackPace, MountOverride)
    def __init__(
        self,
        file: str,
        robot: str = "r1",
        scan: str = "scan",
        odometry: str = "odometry",
        pose: str = "pose",
        range_max: float = 0.0,
        **further: Any,
    ) -> None:
        pace, self._mounting = grouped(further, PlaybackPace, MountOverride)
        super().__init__(file, pace)
        if not 0 <= range_max < float("inf"):
            raise MisuseError(f"range_max is {range_max}; expected metres, or 0 for the log's own")
        self._topics = LogTopics(scan, odometry, pose)
        self._robot, self._range_max = robot, range_max
        self.concerns = names_in(robot)
        # Topics differ between worlds, so the instance attribute hides the class's.
        self.publishes = tuple(dict.fromkeys(topic for topic in (scan, odometry, pose) if topic))

    def recording(self) -> CarmenLog:
        return CarmenLog(
            Path(self.source),
            self.pass_over,
            self._robot,
            self._mounting,
            self._topics,
            self._range_max,
        )
