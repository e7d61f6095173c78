"""A bag of ROS 1 (.bag) or ROS 2 (.db3, .mcap, or a folder of them) as a recording."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.log.recordings import PassOver, Recorded, RecordingError
from minerva_bus.wording import install
from minerva_services.bridges.ros_messages import Frames, GarbageError
from minerva_services.bridges.ros_messages.conversion import TOPICS, Conversion, RecordedPlaces
from minerva_services.bridges.ros_messages.definitions import MessageTopic
from minerva_services.bridges.ros_messages.messages import POINTS, messages
from minerva_services.bridges.ros_messages.ranges import HeightBand
from minerva_services.sensors.clocks import FirstSkip, watched
from minerva_services.sensors.playback import MountOverride

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection


_TRANSFORMS: Final = ("tf", "tf_static")
_NANOSECOND: Final = 1e-9
_FIRST_NANOSECONDS: Final = 2_000_000_000
"""Within this time, a robot publishes each transform that may change."""

_UNUSABLE, _GARBAGE, _BROKEN = "messages passed over", "messages not readable", "broken off"
_NO_SCHEMA: Final = "a type without a schema"
_SKIPPED_TOPICS: Final = "topics passed over"
_OTHER_TOPICS: Final = "topics of other types"


@dataclass(frozen=True, slots=True)
class PlayedTopic:
    """A topic of the bag, and the topic of the world on which it is played, or its events.

    Without both, it has transforms.
    """

    connection: Connection
    topic: str = ""
    events: MessageTopic | None = None


@dataclass(slots=True)
class Bag:
    """An open bag. `topics` maps topics of the bag to those of the world.

    Without `topics`, the first topic by name of each kind of reading is played, and point clouds
    only without laser scans. `events` are the topics whose messages become events instead. `band`
    is that of points. Raises RecordingError.
    """

    path: Path
    pass_over: PassOver
    robot: str = "r1"
    mounting: MountOverride = field(default_factory=MountOverride)
    topics: Mapping[str, str] = field(default_factory=dict[str, str])
    events: Mapping[str, MessageTopic] = field(default_factory=dict[str, MessageTopic])
    band: HeightBand = field(default_factory=HeightBand)
    part: float = 0.0
    _reader: AnyReader = field(init=False)
    _is_open: bool = field(init=False, default=True)
    _played: dict[int, PlayedTopic] = field(init=False)
    _frames: Frames = field(init=False, default_factory=Frames)
    _frame: str = field(init=False, default="")
    _conversion: Conversion = field(init=False)
    _skipped: FirstSkip = field(init=False)

    def __post_init__(self) -> None:
        self._skipped = FirstSkip(self.pass_over)
        places = RecordedPlaces(self._frames, self.mounting.over)
        self._conversion = Conversion(self.robot, places, self.band)
        self._reader = _opened(self.path)
        try:
            self._played = {topic.connection.id: topic for topic in self._chosen()}
            self._learn_mounts()
        except BaseException:
            self.close()
            raise

    def readings(self) -> Iterator[Recorded]:
        """The readings in recorded order. Raises RecordingError."""
        return watched(self._readings(), self.path, self.pass_over, lambda: self._frame)

    def close(self) -> None:
        if self._is_open:
            self._is_open = False
            self._reader.close()

    def _readings(self) -> Iterator[Recorded]:
        is_empty = True
        for connection, stamp, data in self._messages():
            message = self._decoded(data, connection, stamp)
            if message is None:
                continue
            try:
                played = self._played[connection.id]
                if not (played.topic or played.events):
                    self._frames.update(message)
                    continue
                recorded = self._recorded(message, played, stamp * _NANOSECOND)
                is_empty = False
                if recorded is not None:
                    yield recorded
            except (
                GarbageError,
                AttributeError,
                TypeError,
            ) as error:  # bags carry their own type definitions
                self._skip(_UNUSABLE, connection, stamp, f"skipped: {error}")
        if is_empty:
            there = ", ".join(self._names())
            reason = self._skipped.reason(self.path)
            raise RecordingError(f"{self.path}: no playable message on {there}{reason}")

    def _names(self) -> list[str]:
        return sorted(
            {
                played.connection.topic
                for played in self._played.values()
                if played.topic or played.events
            }
        )

    def _messages(self) -> Iterator[tuple[Connection, int, bytes]]:
        """The played messages, as far as the file is readable."""
        connections = [topic.connection for topic in self._played.values()]
        begin = self._reader.start_time
        length = max(1, self._reader.end_time - begin)
        try:
            for connection, stamp, data in self._reader.messages(connections):
                self.part = min(1.0, max(0.0, (stamp - begin) / length))
                yield connection, stamp, data
        except Exception as error:  # readers raise many types for damaged files
            self._skipped(_BROKEN, f"{self.path}: breaks off: {reason_of(error, self.path)}")

    def _skip(self, what: str, connection: Connection, stamp: int, why: str) -> None:
        """Report a skipped message with its place."""
        seconds = (stamp - self._reader.start_time) * _NANOSECOND
        line = f"{self.path}: a message of {connection.topic} {why}"
        self._skipped(what, f"{line} ({seconds:.3f} s after the beginning)")

    def _decoded(self, data: bytes, connection: Connection, stamp: int) -> Any:
        try:
            return self._reader.deserialize(data, _kind(connection))
        except KeyError as error:
            why = f"cannot be read: its schema does not define {error}"
            self._skip(_GARBAGE, connection, stamp, why)
        except Exception as error:  # as above
            self._skip(
                _GARBAGE, connection, stamp, f"cannot be read: {reason_of(error, self.path)}"
            )
        return None

    def _recorded(self, message: Any, played: PlayedTopic, stamp: float) -> Recorded | None:
        """What a message becomes; None for those above the rate of their events."""
        if played.events is not None:
            if not played.events.is_due(stamp):
                return None
            reach, placed = self.band.points_range, self._conversion.places.placed
            event = played.events.made(message, self.robot, placed, reach, stamp)
            return Recorded(stamp, "", event)
        header = message.header
        self._frame = str(header.frame_id)
        # Some drivers leave the stamp at 0.
        time = header.stamp.sec + header.stamp.nanosec * _NANOSECOND or stamp
        reading = self._conversion.reading(_kind(played.connection), message, time)
        return Recorded(stamp, played.topic, reading)

    def _chosen(self) -> Iterator[PlayedTopic]:
        """The connections to play. Raises RecordingError."""
        known = {item.topic: _kind(item) for item in self._reader.connections}
        events = dict(self._of_events(known))
        rest = {topic: kind for topic, kind in known.items() if topic not in events}
        chosen = self._named(known) if self.topics else self._first_ones(rest)
        if not (chosen or events):
            there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(known.items()))
            raise RecordingError(
                f"{self.path}: nothing to play; expected one of {', '.join(TOPICS)}, or the"
                f" option events for others; available: {there or 'no topics'}"
            )
        for connection in self._reader.connections:
            name, kind = connection.topic, _kind(connection)
            if name in events and kind == events[name].kind:
                yield PlayedTopic(connection, events=events[name])
            elif name in chosen and kind in TOPICS:
                yield PlayedTopic(connection, chosen[name])

    def _of_events(self, known: Mapping[str, str]) -> Iterator[tuple[str, MessageTopic]]:
        """The topics whose messages become events; a leading slash may be missing."""
        for topic, events in self.events.items():
            name = next((each for each in known if each.strip("/") == topic.strip("/")), topic)
            self._check_topic(name, known, (events.kind,))
            yield name, events

    def _check_topic(self, topic: str, known: Mapping[str, str], kinds: Collection[str]) -> None:
        if topic not in known:
            there = ", ".join(sorted(known)) or "none"
            raise RecordingError(f"{self.path}: no topic {topic}; available: {there}")
        if known[topic] not in kinds:
            expected = f"expected {'one of ' if len(kinds) > 1 else ''}{', '.join(kinds)}"
            raise RecordingError(f"{self.path}: {topic} is of {known[topic]}; {expected}")

    def _named(self, known: Mapping[str, str]) -> Mapping[str, str]:
        for topic in self.topics:
            self._check_topic(topic, known, TOPICS)
        return self.topics

    def _first_ones(self, known: Mapping[str, str]) -> Mapping[str, str]:
        chosen: dict[str, str] = {}

        def rank(item: tuple[str, str]) -> tuple[bool, str]:
            return item[1] == POINTS, item[0]

        for topic, kind in sorted(known.items(), key=rank):
            if _has_transforms(topic, kind):
                continue  # They place the sensors.
            if kind not in TOPICS:
                line = f"{self.path}: {topic} skipped: messages {kind} are not read"
                self.pass_over(_OTHER_TOPICS, line)
                continue
            here = TOPICS[kind]
            # Two topics of one kind would mix their readings in one topic of the world.
            if here in chosen.values():
                line = f"{self.path}: {topic} skipped; add it to the option topics to play it"
                self.pass_over(_SKIPPED_TOPICS, line)
            else:
                chosen[topic] = here
        return chosen

    def _learn_mounts(self) -> None:
        """Learn where sensors are: their first messages may precede the transforms in the bag."""
        names = [f"/{name.lstrip('/')}" for name in self._names()]
        there = [
            item
            for item in self._reader.connections
            if _has_transforms(item.topic, _kind(item))
            # Of several robots, each has those in its own namespace.
            and any(name.startswith(f"{item.topic.rpartition('/')[0]}/") for name in names)
        ]
        fixed = [item for item in there if item.topic.endswith(_TRANSFORMS[1])]
        moving = [item for item in there if item not in fixed]
        self._played |= {item.id: PlayedTopic(item) for item in moving}
        soon = self._reader.start_time + _FIRST_NANOSECONDS
        for connections, until in ((moving, soon), (fixed, None)):
            if connections:
                self._learn(connections, until)

    def _learn(self, connections: list[Connection], until: int | None) -> None:
        try:
            for connection, stamp, data in self._reader.messages(connections, stop=until):
                message = self._decoded(data, connection, stamp)
                if message is None:
                    continue
                try:
                    self._frames.update(message)
                except GarbageError as error:
                    self._skip(_UNUSABLE, connection, stamp, f"skipped: {error}")
        except Exception as error:  # as above
            line = f"{self.path}: {connections[0].topic} breaks off"
            self.pass_over(_BROKEN, f"{line}: {reason_of(error, self.path)}")


def _has_transforms(topic: str, kind: str) -> bool:
    # In old bags of ROS 1, the type is tf/tfMessage.
    return topic.rpartition("/")[2] in _TRANSFORMS and kind.lower().endswith("/tfmessage")


def _kind(connection: Connection) -> str:
    """The full name of a message type; some writers of MCAP omit its `msg`."""
    if connection.msgtype == "__schemaless__":
        return _NO_SCHEMA
    package, _, name = connection.msgtype.rpartition("/")
    return f"{package}/msg/{name}" if package and "/" not in package else connection.msgtype


def open_bag(path: Path, pass_over: PassOver) -> Bag:
    """Open a bag with its default topics. Raises RecordingError."""
    return Bag(path, pass_over)


def _open_without_services(part: Any, open_part: Callable[[], None]) -> None:
    """Open a reader of a bag, without the definitions of services and actions.

    rosbags does not parse them, and refuses the whole bag. No reading has such a type.
    """
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    open_part()
    for index, connection in enumerate(part.connections):
        if "/srv/" in connection.msgtype or "/action/" in connection.msgtype:
            nothing = MessageDefinition(MessageDefinitionFormat.NONE, "")
            part.connections[index] = connection._replace(msgdef=nothing, digest="")


def _opened(path: Path) -> AnyReader:
    try:
        from rosbags.highlevel import AnyReader  # late: optional dependency (extra "ros")
    except ImportError:
        raise RecordingError(
            f"{path}: bags need rosbags; install it with: {install('ros')}"
        ) from None
    try:
        reader = AnyReader([path], default_typestore=messages().store)
        for part in reader.readers:
            part.open = partial(_open_without_services, part, part.open)
        reader.open()
    except KeyError as error:
        raise RecordingError(
            f"{path}: not a readable bag: its schemas are in {error}; expected ros2msg or ros2idl"
        ) from None
    except Exception as error:  # as above
        raise RecordingError(f"{path}: not a readable bag: {reason_of(error, path)}") from None
    return reader


_CUT: Final = (
    "ord() expected",
    "Truncated record",
    "File end magic",
    "MCAP footer",
    "summary offset",
    "unpack requires",
    "not enough values",
    "Got only",
    "Could not read",
    "could not be read",
    "not indexed",
)
"""Parts of messages about the end of a file."""

_DAMAGED: Final = (
    "Chunk checksum",
    "Chunk size",
    "Unexpected record",
    "Invalid message record",
    "Invalid chunk record",
    "exceeds its chunk",
    "Field size",
    "field size",
    "field could not be parsed",
    "is unexpected",
    "Expected to find",
    "index looks damaged",
    "malformed",
    "not a database",
    "missing tables",
    "too large to convert",
    "cannot fit",
    "decompress",
    "invalid header",
)
"""Parts of messages about what a file contains."""

_OTHER: Final = {
    "File magic": "it is a file of another kind",
    "seems to be empty": "it is empty",
    "Profile is not ros2": "an MCAP of another profile; expected ros2",
    "Expected metadata file": "the folder has no metadata.yaml; create it with: ros2 bag reindex",
    "not in timestamp order": "its messages are not in order; sort them with: mcap sort",
}
"""Meanings of other messages, by a part of them."""

_TOOLS: Final = {
    ".mcap": "repair it with: mcap recover {0} -o repaired.mcap",
    ".bag": "rebuild the index with: rosbag reindex {0}",
    ".db3": "repair it with: sqlite3 {0} .recover | sqlite3 repaired.db3",
}
_FOLDER_TOOL: Final = "rebuild the index with: ros2 bag reindex {0}"

_SURPRISES: Final = (AssertionError, MemoryError, OverflowError)
"""Errors of the reader itself about impossible contents."""

_LONGEST: Final = 120


def reason_of(error: Exception, path: Path) -> str:
    """Why a bag, or a part of it, cannot be read."""
    # Bytes that should be text; the exception would show all of them.
    text = "invalid header" if isinstance(error, UnicodeError) else " ".join(str(error).split())
    shown = text[:_LONGEST].rstrip(".") or type(error).__name__
    tool = _TOOLS.get(path.suffix, _FOLDER_TOOL).format(path.name)
    for part, meaning in _OTHER.items():
        if part in text:
            return meaning
    if any(part in text for part in _CUT):
        return f"it ends too early, as if its recorder had been killed; {tool}"
    if isinstance(error, _SURPRISES) or any(part in text for part in _DAMAGED):
        return f"it is damaged: {shown}; {tool}"
    return shown
