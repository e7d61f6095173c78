"""What a robot has measured, told as from where the string has it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from minerva_bus.world.compensation import span
from minerva_bus.world.poses import Pose
from minerva_bus.world.readings import Scan, Sightings
from minerva_bus.world.services import Tick
from minerva_services.bridges.ros2.driver import Driver
from minerva_services.bridges.ros2.senses import Senses, scanned_from, seen_from
from minerva_services.bridges.ros2.stepping import is_rounding


class Teller:
    """Tells the newest scan and the newest sightings, each once."""

    def __init__(self, driver: Driver, senses: Senses) -> None:
        self._driver, self._senses = driver, senses
        self._told_at = {"scan": -math.inf, "sightings": -math.inf}

    def tell(self, tick: Tick, robot: str) -> None:
        """Publish them."""
        scan = self._newest("scan", self._senses.scans)
        if isinstance(scan, Scan):
            scan = self._driver.track.corrected(scan)
            tick.publish("scan", scanned_from(self._shift(scan.time), scan, robot))
        seen = self._newest("sightings", self._senses.sightings)
        if isinstance(seen, Sightings):
            tick.publish("sightings", seen_from(self._shift(seen.time), seen, robot))

    def _newest(self, what: str, waiting: Sequence[Scan | Sightings]) -> Scan | Sightings | None:
        """The newest that odometry reaches up to, or else the newest; None if that was told."""
        track = self._driver.track
        covered = [one for one in waiting if all(map(track.covers, _span(one)))]
        if waiting and not covered:
            self._senses.count(f"{what} beside odometry's time")
        found = (covered or waiting or [None])[-1]
        if found is None or found.time == self._told_at[what]:
            self._senses.count(f"frames without {what}")
            return None
        self._told_at[what] = found.time
        return found

    def _shift(self, at: float) -> Pose:
        """Where the robot was at a time, as seen from where the string has it."""
        track, goal = self._driver.track, self._driver.goal
        pose = track.at(at) if track.covers(at) else track.newest
        shift = Pose() if pose is None or goal is None else goal.seen(pose)
        return Pose() if is_rounding(shift) else shift


def _span(reading: Scan | Sightings) -> tuple[float, float]:
    """The times of the first and the last that it measures."""
    return span(reading) if isinstance(reading, Scan) else (reading.time, reading.time)
