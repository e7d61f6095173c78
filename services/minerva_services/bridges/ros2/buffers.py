"""Buffers for a robot's own topics: scans, detections, odometry and transforms."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, TypeVar

from minerva_bus import portable
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Displacement, Mount, Scan, Sightings
from minerva_bus.world.recordings import span
from minerva_bus.world.services import Tick
from minerva_services.bridges.ros2.driver import Driver
from minerva_services.bridges.ros2.messages import (
    DETECTIONS,
    LASER_SCAN,
    ODOMETRY,
    TRANSFORMS,
    messages,
)
from minerva_services.bridges.ros2.session import Ros2Session
from minerva_services.bridges.ros2.stepping import is_rounding
from minerva_services.bridges.ros_messages import Frames, GarbageError, readings
from minerva_services.bridges.ros_messages.frames import UnplacedError, mounting_of
from minerva_services.bridging.bridge import log

_MAX_READINGS: Final = 8
"""Number of buffered scans and sightings; the newest counts."""

_Timed = TypeVar("_Timed", Scan, Sightings)


class SensorBuffers:
    """The latest scans and sightings of one robot, filled by Zenoh's threads.

    `moved(time, pose)` receives odometry. Without odometry the robot's clock is of no use, so
    readings carry their time of arrival. `notify()` is called after each message.
    """

    def __init__(
        self,
        base: str,
        mount: Mount | None,
        moved: Callable[[float, Pose], None],
        notify: Callable[[], None] = lambda: None,
        time_offset: float = 0.0,
    ) -> None:
        self._time_offset = time_offset
        self._notify = notify
        self.odometry_frame = "odom"
        self.scanned = False
        self._base, self._mount, self._moved = base, mount, moved
        self._frames = Frames()
        self._by_arrival = True
        self._scans = deque[Scan](maxlen=_MAX_READINGS)
        self._sightings = deque[Sightings](maxlen=_MAX_READINGS)
        self._counts: dict[str, int] = {}
        self._lock = threading.Lock()

    def listen(self, session: Ros2Session, scan: str, odometry: str, detections: str) -> None:
        """Subscribe to the configured topics."""
        self._by_arrival = not odometry
        session.subscribe("/tf_static", TRANSFORMS, self._on_transforms, lasting=True)
        if odometry:
            session.subscribe(odometry, ODOMETRY, self._decoder(ODOMETRY, self._take_odometry))
        if scan:
            session.subscribe(scan, LASER_SCAN, self._decoder(LASER_SCAN, self._take_scan))
        if detections:
            receive = self._decoder(DETECTIONS, self._take_detections)
            session.subscribe(detections, DETECTIONS, receive)

    @property
    def scans(self) -> tuple[Scan, ...]:
        """The buffered scans."""
        with self._lock:
            return tuple(self._scans)

    @property
    def sightings(self) -> tuple[Sightings, ...]:
        """The buffered sightings."""
        with self._lock:
            return tuple(self._sightings)

    def measured(self, *, scan: bool, detections: bool) -> float:
        """The time up to which all requested kinds have arrived."""
        with self._lock:
            times = [
                waiting[-1].time if waiting else -math.inf
                for wanted, waiting in ((scan, self._scans), (detections, self._sightings))
                if wanted
            ]
        return min(times, default=math.inf)

    @property
    def counts(self) -> dict[str, int]:
        """Counts of skipped messages by reason."""
        with self._lock:
            return dict(self._counts)

    def count(self, what: str) -> None:
        """Count a skipped message."""
        with self._lock:
            self._counts[what] = self._counts.get(what, 0) + 1

    def _on_transforms(self, data: bytes) -> None:
        self._decoder(TRANSFORMS, self._frames.update)(data)

    def _decoder(self, message: str, take: Callable[[Any], None]) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            try:
                take(messages().decode(message, data))
            except UnplacedError:
                self.count("without a transform")
            except GarbageError as error:
                if "garbage" not in self.counts:
                    log(f"a {message} skipped: {error}; further ones are counted as 'garbage'")
                self.count("garbage")
            self._notify()

        return receive

    def _take_odometry(self, message: Any) -> None:
        pose, stamp = Pose(*readings.place_of(message.pose.pose)), readings.stamp_of(message)
        self.odometry_frame = message.header.frame_id or "odom"
        self._moved(stamp, pose)

    def _take_scan(self, message: Any) -> None:
        frame = message.header.frame_id
        mounting = mounting_of(self._frames, self._base, frame, self._mount)
        scan = self._timed(readings.scan_of(message, "", mounting))
        scan = replace(scan, time=scan.time + self._time_offset)
        with self._lock:
            self._scans.append(scan)
        self.scanned = True

    def _take_detections(self, message: Any) -> None:
        placed = self._frames.matrix(self._base, message.header.frame_id)
        if placed is None:
            raise UnplacedError(f"no transform from {message.header.frame_id}")
        sightings = self._timed(readings.sightings_of(message, "", placed))
        with self._lock:
            self._sightings.append(sightings)

    def _timed(self, reading: _Timed) -> _Timed:
        return replace(reading, time=time.monotonic()) if self._by_arrival else reading


def seen_from(shift: Pose, sightings: Sightings, robot: str) -> Sightings:
    """Sightings made by a robot at `shift`, transformed to the origin."""
    seen = [
        replace(
            sighting,
            distance=portable.hypot(at.x, at.y),
            angle=math.degrees(portable.atan2(at.y, at.x)),
        )
        for sighting in sightings.seen
        for at in (shift.compose(Pose(angle=sighting.angle)).compose(Pose(x=sighting.distance)),)
    ]
    return Sightings(robot, tuple(seen), sightings.time)


def scanned_from(shift: Pose, scan: Scan, robot: str) -> Scan:
    """A scan made by a robot at `shift`, as one from the origin with another mount."""
    mount = shift.compose(Pose(scan.mount_x, scan.mount_y, scan.mount_angle))
    # Displacements are relative to the robot, so those of a shifted robot are conjugated by the
    # shift.
    back = shift.seen(Pose())
    path = [shift.compose(Pose(place.x, place.y, place.angle)).compose(back) for place in scan.path]
    moved = [
        Displacement(before.seconds, place.x, place.y, place.angle)
        for before, place in zip(scan.path, path, strict=True)
    ]
    return replace(
        scan,
        robot=robot,
        mount_x=mount.x,
        mount_y=mount.y,
        mount_angle=mount.angle,
        path=tuple(moved),
    )


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
        # An exact zero keeps the readings of a stepped simulation bit-identical to those of
        # physics.
        return Pose() if is_rounding(shift) else shift


def _span(reading: Scan | Sightings) -> tuple[float, float]:
    """Times of the first and last measurement."""
    return span(reading) if isinstance(reading, Scan) else (reading.time, reading.time)
