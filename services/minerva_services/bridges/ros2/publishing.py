"""Publishes a robot's readings relative to where the string has the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence

from minerva_bus.world.compensation import span
from minerva_bus.world.poses import Pose
from minerva_bus.world.readings import Scan, Sightings
from minerva_bus.world.services import Tick
from minerva_services.bridges.ros2.buffers import SensorBuffers, scanned_from, seen_from
from minerva_services.bridges.ros2.driver import Driver
from minerva_services.bridges.ros2.stepping import is_rounding


class ReadingPublisher:
    """Publishes the newest scan and the newest sightings, each once."""

    def __init__(self, driver: Driver, senses: SensorBuffers) -> None:
        self._driver, self._senses = driver, senses
        self._published_at = {"scan": -math.inf, "sightings": -math.inf}

    def publish(self, tick: Tick, robot: str) -> None:
        """Publish new readings of this tick."""
        scan = self._newest("scan", self._senses.scans)
        if isinstance(scan, Scan):
            scan = self._driver.track.corrected(scan)
            tick.publish("scan", scanned_from(self._shift(scan.time), scan, robot))
        seen = self._newest("sightings", self._senses.sightings)
        if isinstance(seen, Sightings):
            tick.publish("sightings", seen_from(self._shift(seen.time), seen, robot))

    def _newest(self, what: str, waiting: Sequence[Scan | Sightings]) -> Scan | Sightings | None:
        """The newest reading covered by odometry, otherwise the newest.

        None if already published.
        """
        track = self._driver.track
        covered = [reading for reading in waiting if all(map(track.covers, _span(reading)))]
        if waiting and not covered:
            self._senses.count(f"{what} beside odometry's time")
        newest = (covered or waiting or [None])[-1]
        if newest is None or newest.time == self._published_at[what]:
            self._senses.count(f"frames without {what}")
            return None
        self._published_at[what] = newest.time
        return newest

    def _shift(self, at: float) -> Pose:
        """The robot's pose at a time, relative to where the string has it."""
        track, goal = self._driver.track, self._driver.goal
        pose = track.at(at) if track.covers(at) else track.newest
        shift = Pose() if pose is None or goal is None else goal.seen(pose)
        return Pose() if is_rounding(shift) else shift


def _span(reading: Scan | Sightings) -> tuple[float, float]:
    """Times of the first and last measurement."""
    return span(reading) if isinstance(reading, Scan) else (reading.time, reading.time)
