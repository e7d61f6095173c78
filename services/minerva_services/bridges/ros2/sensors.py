"""Publishes the sensor readings of a ROS 2 robot on the world's sensor topics."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, ClassVar, Final

from minerva_bus.grammar.events import Event
from minerva_bus.log.recordings import Compensator, Recorded
from minerva_bus.world.services import WorldInfo
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros2.qos import HEARING, LASTING, asked_qos
from minerva_services.bridges.ros2.uses import (
    EVENTS,
    NetworkUser,
    TopicUse,
    topic_uses,
    transforms_uses,
)
from minerva_services.bridges.ros_messages import Frames, GarbageError
from minerva_services.bridges.ros_messages.conversion import TOPICS, Conversion, LivePlaces
from minerva_services.bridges.ros_messages.definitions import MessageTopic
from minerva_services.bridges.ros_messages.frames import UnplacedError, mount_of
from minerva_services.bridges.ros_messages.messages import (
    BATTERY,
    COMPRESSED,
    DETECTIONS,
    FIX,
    GRID,
    IMAGE,
    LASER_SCAN,
    ODOMETRY,
    POINTS,
    RANGE,
    TRANSFORMS,
    messages,
)
from minerva_services.bridges.ros_messages.ranges import HeightBand
from minerva_services.bridging import Bridge, Source, SourceError
from minerva_services.bridging.bridge import SourceItem
from minerva_services.options import grouped, names_in, takes_options
from minerva_services.sensors.clocks import SHARED_TOPIC, ClockWatch
from minerva_services.sensors.playback import NOT_CORRECTED, checked_offset, item_of

_MAX_QUEUED: Final = 100
_MAX_BYTES: Final = 64 << 20
"""Maximum of a topic's queued messages: their number and size; the oldest are dropped."""

_OVERHEAD: Final = 200
"""Bytes of memory of a message beside its own."""

_CHECK_SECONDS: Final = 0.25
_LOST: Final = "lost on the way"


class Ros2(Bridge, NetworkUser):
    """Publishes the readings of a ROS 2 robot: scans, odometry, images, positions, battery.

    Empty topics are not subscribed to. Mounts come from the fixed transforms, unless `mount` is
    given for the laser.

    Args:
        router: the endpoint of the robot's network; further options are those of `Ros2Network` and
          `HeightBand`.
        robot: the id of the agent that the sensors belong to.
        scan: topic of LaserScan messages, published here on `scan`.
        odometry: topic of Odometry messages, on `odometry`.
        image: topic of Image messages, on `image`.
        compressed: topic of CompressedImage messages, also on `image`.
        points: topic of PointCloud2 messages; their points in a band of heights are a scan, also on
          `scan`.
        ranges: topic of Range messages, each a scan of one beam, on `range`.
        fix: topic of NavSatFix messages, on `position`.
        battery: topic of BatteryState messages, on `battery`.
        detections: topic of Detection3DArray messages, whose classes are markers, on `sightings`.
        base: the robot's base frame.
        mount: "x, y, degrees" of the laser on the robot.
        time_offset: seconds added to the times of scans if the lidar's clock differs from that of
          odometry.
        map: topic of OccupancyGrid messages; each becomes an event of the type `map_event`.
        map_event: that type, with `cells` in the codes of a robot's grid (0 unknown, 1 free, 9
          obstacle), the side of a `cell`, and `x`, `y` and `angle` of the corner.
        events: other topics, such as those of Imu and JointState messages: by topic a table with
          the `type` of its messages, the `event` that each becomes, the paths of its `data` in the
          message, the most events per second as `rate`, and `qos`. Those of point clouds have
          `points`, one in each `cube`.
        qos: the quality of service of the other topics, by option: {scan = "sensor_data"}.

    """

    source_option: ClassVar[str] = "router"

    @takes_options(Ros2Network, HeightBand)
    def __init__(
        self,
        router: str,
        robot: str = "r1",
        scan: str = "scan",
        odometry: str = "odom",
        image: str = "",
        compressed: str = "",
        battery: str = "battery_state",
        detections: str = "",
        points: str = "",
        ranges: str = "",
        fix: str = "",
        base: str = "base_link",
        mount: str = "",
        time_offset: float = 0.0,
        map: str = "",
        map_event: str = "eMap",
        events: Mapping[str, Any] | None = None,
        qos: Mapping[str, Any] | None = None,
        **further: Any,
    ) -> None:
        super().__init__()
        options = {"router": router, **further}
        self.network, self._band = grouped(options, Ros2Network, HeightBand)
        self.source = f"the ROS 2 network at {router}"
        self._robot, self.concerns = robot, names_in(robot)
        self._mount = mount_of(mount)
        self._time_offset = checked_offset(time_offset)
        self._frames, self._clocks = Frames(), ClockWatch()
        places = LivePlaces(self._frames, base, self._mount)
        self._conversion = Conversion(robot, places, self._band)
        topics = {
            "scan": (scan, LASER_SCAN), "odometry": (odometry, ODOMETRY), "image": (image, IMAGE),
            "compressed": (compressed, COMPRESSED), "battery": (battery, BATTERY),
            "detections": (detections, DETECTIONS), "points": (points, POINTS),
            "ranges": (ranges, RANGE), "fix": (fix, FIX),
        }  # fmt: skip
        self._options = {message: option for option, (_, message) in topics.items()}
        sensors = [
            TopicUse(option, *about, others=self._options) for option, about in topics.items()
        ]
        self.publishes = tuple(sorted({TOPICS[use.message] for use in sensors if use.topic}))
        uses = [
            *transforms_uses(self.network, needed=self._mount is None),
            *sensors,
            TopicUse("map", map, GRID, qos=LASTING),
        ]
        self._events = dict[str, MessageTopic]()
        if map:
            # Each map counts, because the last one may stay for long.
            every = {"type": GRID, "event": map_event, "rate": sys.float_info.max}
            self._events[GRID] = MessageTopic("ros2: map", every)
        for name, table in (events or {}).items():
            where = f"ros2: {EVENTS}{name}"
            topic = self._events[name] = MessageTopic(where, table)
            asked = asked_qos(f"{where}: qos", topic.qos, HEARING)
            uses.append(TopicUse(f"{EVENTS}{name}", name, topic.kind, qos=asked))
        self.uses = topic_uses(self.network, uses, qos)

    def check(self, world: WorldInfo) -> list[str]:
        """What fits no robot. Raises MisuseError without rosbags, or an event for maps."""
        messages()
        for topic in self._events.values():
            topic.check(world)
        return self.unfit()

    def generates(self) -> tuple[str, ...]:
        """The event types of maps and of other messages."""
        return tuple(dict.fromkeys(topic.event for topic in self._events.values()))

    def open(self) -> Source:
        """Raises SourceError if the network does not answer."""
        self._clocks = ClockWatch()
        session = Ros2Session(self.network, "minerva_sensors", self.uses)
        source = _Listening(session, self)
        for use in self.uses:
            kind = use.topic if use.option.startswith(EVENTS) else use.message
            receive = source.receiver(kind, use.qos.depth)
            # A lasting message is sent again.
            lost = None if use.qos.lasting else partial(self.lost, use.topic)
            session.subscribe(use.topic, use.message, receive, use.qos, lost=lost)
        return source

    def lost(self, topic: str, missing: int) -> None:
        """Count messages that were sent, but did not arrive."""
        line = f"{self.source}: messages of {topic} are lost on the way; is the link too slow?"
        self.pass_over(_LOST, line)
        self.count(_LOST, missing - 1)

    def compensator(self) -> Compensator:
        """Corrects scans for the robot's motion; counts those that it cannot correct."""
        return Compensator(self._time_offset, lambda: self.count(NOT_CORRECTED))

    def reading(self, message: str, data: bytes) -> SourceItem | None:
        """The reading of a message of a type, or of one of the topics that become events.

        Invalid and unplaced messages are counted.
        """
        try:
            if topic := self._events.get(message):
                return self._event(topic, data)
            value = messages().decode(message, data)
            if message == TRANSFORMS:
                self._frames.update(value)
                return None
            option, made = self._options[message], self._conversion.reading(message, value)
            for what, line in self._clocks.problems(option, made.time, value.header.frame_id):
                # Detections of several cameras each have the place of theirs.
                if what != SHARED_TOPIC or message != DETECTIONS:
                    self.pass_over(what, f"{self.source}: {line}")
            return TOPICS[message], made
        except UnplacedError:
            self.count("without a transform")
        except GarbageError as error:
            self.pass_over("garbage", f"{self.source}: a {message} skipped: {error}")
        return None

    def _event(self, topic: MessageTopic, data: bytes) -> Event | None:
        """The event of a message; None for those above the rate."""
        now = time.monotonic()
        if not topic.is_due(now):
            return None
        message = messages().decode(topic.kind, data)
        reach, placed = self._band.points_range, self._conversion.places.placed
        return topic.made(message, self._robot, placed, reach, now)


class _Waiting:
    """Messages of one type that wait, each with its number among all messages."""

    def __init__(self, most: int = _MAX_QUEUED) -> None:
        self._most = most
        self._messages = deque[tuple[int, bytes]]()
        self._bytes = 0

    def add(self, number: int, data: bytes) -> int:
        """Add a message; returns how many others were dropped for it."""
        self._messages.append((number, data))
        self._bytes += len(data) + _OVERHEAD
        dropped = 0
        while len(self._messages) > 1 and (
            len(self._messages) > self._most or self._bytes > _MAX_BYTES
        ):
            _, oldest = self._messages.popleft()
            self._bytes -= len(oldest) + _OVERHEAD
            dropped += 1
        return dropped

    def taken(self) -> list[tuple[int, bytes]]:
        """All messages, which then no longer wait."""
        messages = list(self._messages)
        self._messages.clear()
        self._bytes = 0
        return messages


class _Listening:
    """Incoming messages in bounded queues, filled by Zenoh's threads.

    Each type has a queue of its own, so that large images cannot displace scans and transforms.
    """

    def __init__(self, session: Ros2Session, bridge: Ros2) -> None:
        self._session = session
        self._bridge = bridge
        self._waiting: dict[str, _Waiting] = {}
        self._received = 0
        self._news = threading.Condition()

    def receiver(self, message: str, depth: int = 0) -> Callable[[bytes], None]:
        """A callback for the payloads of a topic, of which at most `depth` wait, if it is given."""
        waiting = self._waiting.setdefault(message, _Waiting(depth or _MAX_QUEUED))

        def receive(data: bytes) -> None:
            with self._news:
                self._received += 1
                dropped = waiting.add(self._received, data)
                self._news.notify()
            if dropped:
                self._bridge.count("dropped here", dropped)

        return receive

    def taken(self, seconds: float) -> list[tuple[str, bytes]]:
        """The messages that wait, in the order of their arrival; waits for the first."""
        with self._news:
            self._news.wait_for(lambda: self._received, seconds)
            self._received = 0
            ordered = sorted(
                (number, message, data)
                for message, waiting in self._waiting.items()
                for number, data in waiting.taken()
            )
        return [(message, data) for _, message, data in ordered]

    def read(self, stop: threading.Event) -> Iterator[SourceItem | None]:
        """Readings and maps. Raises SourceError if the link is lost."""
        compensator = self._bridge.compensator()
        while not stop.is_set():
            # Decoding happens outside the lock, which Zenoh's threads need for new messages.
            waiting = self.taken(_CHECK_SECONDS)
            # Transforms of joints say nothing of those that never change.
            self._session.advise({message for message, _ in waiting if message != TRANSFORMS})
            # A lost link is an error only once all messages received before it have been read.
            if not waiting and not self._session.connected:
                raise SourceError(f"{self._bridge.source} is lost")
            if not waiting:
                # Delayed scans must not wait for odometry that has stopped arriving.
                yield from map(item_of, compensator.rest())
                yield None
            for message, data in waiting:
                reading = self._bridge.reading(message, data)
                if not isinstance(reading, tuple):
                    yield reading
                    continue
                topic, measured = reading
                recorded = Recorded(time.monotonic(), topic, measured)
                yield from map(item_of, compensator.add(recorded))

    def close(self) -> None:
        """Leave the network."""
        self._session.close()
