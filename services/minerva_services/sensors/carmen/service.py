"""`carmen`: a CARMEN log, played into a world."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.errors import MisuseError
from minerva_services.sensors.carmen.log import CarmenLog, Topics
from minerva_services.sensors.playing import Mounting, Pace, Playing


class Carmen(Playing, lockstep=False):
    """Plays the laser and the odometry of a CARMEN log. Raises MisuseError.

    Args:
        file: the log, plain or gzipped.
        robot: the id of the agent whose sensors they are.
        scan: the topic of the scans (FLASER, RAWLASER1, ROBOTLASER1); "": none.
        odometry: the topic of what the wheels say (ODOM), an `Odometry` each; "": none.
        pose: the topic of where the robot was, an `Odometry` before each scan; "": none.
        range_max: metres from which on nothing was hit; 0: as the log says, 80 m at most.
        speed: so many times as fast as it was recorded; 0: as fast as it goes.
        loop: from its end on again from its beginning.
        offset: seconds of it that are left out at first.
        mount_x: metres ahead, where the laser sits; by default as the log says.
        mount_y: metres to the left, likewise.
        mount_angle: degrees, likewise.

    """

    def __init__(
        self,
        file: str,
        robot: str = "r1",
        scan: str = "scan",
        odometry: str = "odometry",
        pose: str = "pose",
        range_max: float = 0.0,
        speed: float = 1.0,
        loop: bool = False,
        offset: float = 0.0,
        mount_x: float | None = None,
        mount_y: float | None = None,
        mount_angle: float | None = None,
    ) -> None:
        super().__init__(file, Pace(speed, loop, offset))
        if not 0 <= range_max < float("inf"):
            raise MisuseError(f"range_max is {range_max}; expected metres, or 0 for the log's own")
        self._topics = Topics(scan, odometry, pose)
        self._robot, self._range_max = robot, range_max
        self._mounting = Mounting(mount_x, mount_y, mount_angle)
        # Which topics is up to each world, so these hide the class's.
        self.publishes = tuple(dict.fromkeys(one for one in (scan, odometry, pose) if one))

    def recording(self) -> CarmenLog:
        return CarmenLog(
            Path(self.source),
            self.pass_over,
            self._robot,
            self._mounting,
            self._topics,
            self._range_max,
        )
