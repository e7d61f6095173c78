"""What a ROS 2 robot measures, on the world's sensor topics."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, ClassVar, Final, TypeAlias

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Cells, Degrees, Metres
from minerva_bus.world.compensation import Compensator
from minerva_bus.world.readings import Mount, Reading
from minerva_bus.world.recordings import Recorded
from minerva_bus.world.services import WorldInfo
from minerva_services.bridges.ros2.messages import (
    BATTERY,
    COMPRESSED,
    DETECTIONS,
    GRID,
    IMAGE,
    LASER_SCAN,
    ODOMETRY,
    TRANSFORMS,
    messages,
)
from minerva_services.bridges.ros2.mounts import UnplacedError, mount_of, mounting_of
from minerva_services.bridges.ros2.network import Network, Tls
from minerva_services.bridges.ros2.session import Session
from minerva_services.bridges.ros_messages import Frames, GarbageError, Mounting, images, readings
from minerva_services.bridging import Bridge, Source, SourceError
from minerva_services.bridging.bridge import Said
from minerva_services.event_factory import EventFactory
from minerva_services.sensors.playing import NOT_CORRECTED, checked_offset

_WAITING: Final = 100
"""Messages that wait for their turn, at most; the oldest are dropped."""

_GLANCE: Final = 0.25
Make: TypeAlias = Callable[[Any], Reading]


class Ros2(Bridge):
    """Publishes what a ROS 2 robot measures, as it comes: scans, odometry, images, battery.

    An empty topic is not listened to. Where a sensor is mounted is taken from /tf_static, unless
    `mount` gives it for the laser.

    Args:
        router: the endpoint of the robot's Zenoh router or zenoh-bridge-ros2dds.
        robot: the id of the agent that the sensors are for.
        layout: "rmw_zenoh", or "dds" for a zenoh-bridge-ros2dds.
        domain: the ROS domain, for rmw_zenoh.
        namespace: what stands before all topics that do not begin with a slash.
        humble: the robot runs ROS 2 Humble, which has no type hashes.
        scan: topic of LaserScan messages, published here on `scan`.
        odometry: topic of Odometry messages, on `odometry`.
        image: topic of Image messages, on `image`.
        compressed: topic of CompressedImage messages, on `image` too.
        battery: topic of BatteryState messages, on `battery`.
        detections: topic of Detection3DArray messages, whose classes are markers, on `sightings`.
        base: the robot's own frame.
        mount: "x, y, degrees" of the laser on the robot.
        time_offset: seconds that are added to the times of scans, where the lidar's clock is not
            that of the odometry.
        map: topic of OccupancyGrid messages; each is an event of the type `map_event`.
        map_event: its type, with `cells` as a robot's grid has them (0 unknown, 1 free, 9 an
            obstacle), and the width of a `cell`, `x`, `y` and `angle` of the corner.
        authority: for tls/: the certificate of who has signed the router's, a PEM file.
        certificate: our own, where the router asks for one.
        key: and its private key.

    """

    source_option: ClassVar[str] = "router"

    def __init__(
        self,
        router: str,
        robot: str = "r1",
        layout: str = "rmw_zenoh",
        domain: int = 0,
        namespace: str = "",
        humble: bool = False,
        scan: str = "scan",
        odometry: str = "odom",
        image: str = "",
        compressed: str = "",
        battery: str = "battery_state",
        detections: str = "",
        base: str = "base_link",
        mount: str = "",
        time_offset: float = 0.0,
        map: str = "",
        map_event: str = "eMap",
        authority: str = "",
        certificate: str = "",
        key: str = "",
    ) -> None:
        super().__init__()
        tls = Tls(authority, certificate, key)
        self._network = Network(router, layout, domain, namespace, humble, tls)
        self.source = f"the ROS 2 network at {router}"
        self._robot = robot
        self._base = base
        self._mount = mount_of(mount)
        self._time_offset = checked_offset(time_offset)
        self._frames = Frames()
        self._wanted = self._makers(scan, odometry, image, compressed, battery, detections)
        for name, _, _ in self._wanted.values():
            self._network.name(name)
        self._map, self._map_event = map, map_event
        if map:
            self._network.name(map)
        topics = sorted({topic for _, topic, _ in self._wanted.values()})
        self.publishes = tuple(topics)

    def _makers(
        self, scan: str, odometry: str, image: str, compressed: str, battery: str, detections: str
    ) -> dict[str, tuple[str, str, Make]]:
        """By message type: the ROS topic, ours, and what makes a reading of a message."""
        robot = self._robot
        table: dict[str, tuple[str, str, Make]] = {
            LASER_SCAN: (scan, "scan", self._scan),
            ODOMETRY: (odometry, "odometry", partial(readings.odometry_of, robot=robot)),
            IMAGE: (image, "image", partial(self._image, images.image_of)),
            COMPRESSED: (compressed, "image", partial(self._image, images.file_of)),
            BATTERY: (battery, "battery", partial(readings.battery_of, robot=robot)),
            DETECTIONS: (detections, "sightings", self._sightings),
        }
        return {message: row for message, row in table.items() if row[0]}

    def joined(self, world: WorldInfo) -> None:
        """Raises MisuseError where rosbags is missing, or the world has no event for maps."""
        messages()
        if self._map:
            data = {"cells": Cells, "cell": Metres, "x": Metres, "y": Metres, "angle": Degrees}
            self._makes_map = EventFactory("ros2", world, self._map_event, **data)

    def generates(self) -> tuple[str, ...]:
        """The type of the events that maps are."""
        return (self._map_event,) if self._map else ()

    def open(self) -> Source:
        """Raises SourceError where the network does not answer."""
        session = Session(self._network, "minerva_sensors")
        source = _Listening(session, self)
        session.subscribe("/tf_static", TRANSFORMS, source.hears(TRANSFORMS), lasting=True)
        for message, (topic, _, _) in self._wanted.items():
            session.subscribe(topic, message, source.hears(message))
        if self._map:
            session.subscribe(self._map, GRID, source.hears(GRID), lasting=True)
        return source

    def compensator(self) -> Compensator:
        """What corrects scans for the robot's motion; scans that it cannot correct are counted."""
        return Compensator(self._time_offset, lambda: self.count(NOT_CORRECTED))

    def reading(self, message: str, data: bytes) -> Said | None:
        """What a message says; garbage, and what has no known place, is counted."""
        try:
            value = messages().decode(message, data)
            if message == TRANSFORMS:
                self._frames.hear(value)
                return None
            if message == GRID:
                return self._known(value)
            _, topic, make = self._wanted[message]
            return topic, make(value)
        except UnplacedError:
            self.count("without a transform")
        except GarbageError:
            self.count("garbage")
        return None

    def _known(self, message: Any) -> Event:
        known = readings.known_of(message)
        return self._makes_map(known.cells, known.cell, *known.corner, receivers=(self._robot,))

    def _scan(self, message: Any) -> Reading:
        return readings.scan_of(message, self._robot, self._mounting(message, self._mount))

    def _image(self, make: Callable[..., Reading], message: Any) -> Reading:
        known = self._frames.mounting(self._base, message.header.frame_id)
        return make(message, self._robot, known or Mounting())

    def _sightings(self, message: Any) -> Reading:
        placed = self._frames.matrix(self._base, message.header.frame_id)
        if placed is None:
            raise UnplacedError(f"no transform from {message.header.frame_id}")
        return readings.sightings_of(message, self._robot, placed)

    def _mounting(self, message: Any, given: Mount | None) -> Mounting:
        return mounting_of(self._frames, self._base, message.header.frame_id, given)


def _said(ready: list[Recorded]) -> Iterator[Said]:
    for recorded in ready:
        yield recorded.topic, recorded.reading


class _Listening:
    """Messages as they come, as many as may wait; Zenoh's threads put them here."""

    def __init__(self, session: Session, bridge: Ros2) -> None:
        self._session = session
        self._bridge = bridge
        self._waiting = deque[tuple[str, bytes]]()
        self._news = threading.Condition()

    def hears(self, message: str) -> Callable[[bytes], None]:
        """What takes the payloads of a topic."""

        def hear(data: bytes) -> None:
            with self._news:
                if len(self._waiting) == _WAITING:
                    self._waiting.popleft()
                    self._bridge.count("dropped here")
                self._waiting.append((message, data))
                self._news.notify()

        return hear

    def read(self, stop: threading.Event) -> Iterator[Said | None]:
        """Readings and maps; raises SourceError where the link is lost."""
        compensator = self._bridge.compensator()
        while not stop.is_set():
            with self._news:
                if not self._waiting:
                    self._news.wait(_GLANCE)
                waiting = list(self._waiting)
                self._waiting.clear()
            if not waiting and not self._session.connected:
                raise SourceError(f"{self._bridge.source} is lost")
            if not waiting:
                yield from _said(compensator.rest())
                yield None
            for message, data in waiting:
                reading = self._bridge.reading(message, data)
                if not isinstance(reading, tuple):
                    yield reading
                    continue
                topic, measured = reading
                yield from _said(compensator.add(Recorded(time.monotonic(), topic, measured)))

    def close(self) -> None:
        """Leave the network."""
        self._session.close()
