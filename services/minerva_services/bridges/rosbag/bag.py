"""A bag of ROS 1 (.bag) or ROS 2 (.db3, .mcap, a folder of them) as a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.world.recordings import PassOver, Recorded, RecordingError
from minerva_services.bridges.ros_messages import Frames, GarbageError
from minerva_services.bridges.rosbag.messages import CONVERSIONS
from minerva_services.sensors.playing import Mounting

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

_STATIC: Final = "tf_static"
_NANO: Final = 1e-9
_UNUSABLE, _GARBAGE, _BROKEN = "messages passed over", "messages not readable", "broken off"
_OTHERS: Final = "topics passed over"


@dataclass(frozen=True, slots=True)
class Played:
    """A topic of the bag that is played, and on which topic of the world."""

    connection: Connection
    topic: str


@dataclass(slots=True)
class Bag:
    """A bag, opened. `topics` are those of the world by those of the bag that are played.

    Without them it is the first topic, by name, of each kind of reading. Raises RecordingError.
    """

    path: Path
    pass_over: PassOver
    robot: str = "r1"
    mounting: Mounting = field(default_factory=Mounting)
    topics: Mapping[str, str] = field(default_factory=dict[str, str])
    part: float = 0.0
    _reader: AnyReader = field(init=False)
    _played: Mapping[int, Played] = field(init=False)
    _frames: Frames = field(init=False, default_factory=Frames)

    def __post_init__(self) -> None:
        self._reader = _opened(self.path)
        try:
            self._played = {one.connection.id: one for one in self._chosen()}
            self._learn_mounts()
        except BaseException:
            self.close()
            raise

    def readings(self) -> Iterator[Recorded]:
        """The readings in the order in which they were recorded. Raises RecordingError."""
        some = False
        for connection, stamp, data in self._messages():
            message = self._decoded(data, connection)
            if message is None:
                continue
            try:
                yield self._recorded(message, self._played[connection.id], stamp * _NANO)
                some = True
            except (GarbageError, AttributeError, TypeError) as error:  # bags define types, too
                line = f"{self.path}: a message of {connection.topic} is passed over: {error}"
                self.pass_over(_UNUSABLE, line)
        if not some:
            there = ", ".join(self._names())
            raise RecordingError(f"{self.path}: has no message that can be played on {there}")

    def close(self) -> None:
        if self._reader.stack is not None:
            self._reader.close()

    def _names(self) -> list[str]:
        return sorted({one.connection.topic for one in self._played.values()})

    def _messages(self) -> Iterator[tuple[Connection, int, bytes]]:
        """The messages that are played, as far as the file can be read."""
        connections = [one.connection for one in self._played.values()]
        begin = self._reader.start_time
        length = max(1, self._reader.end_time - begin)
        try:
            for connection, stamp, data in self._reader.messages(connections):
                self.part = min(1.0, max(0.0, (stamp - begin) / length))
                yield connection, stamp, data
        except Exception as error:  # readers of damaged files raise nearly anything
            self.pass_over(_BROKEN, f"{self.path}: breaks off: {_line(error)}")

    def _decoded(self, data: bytes, connection: Connection) -> Any:
        try:
            return self._reader.deserialize(data, connection.msgtype)
        except Exception as error:  # as above
            line = f"{self.path}: a message of {connection.topic} cannot be read: {_line(error)}"
            self.pass_over(_GARBAGE, line)
            return None

    def _recorded(self, message: Any, played: Played, stamp: float) -> Recorded:
        header = message.header
        time = header.stamp.sec + header.stamp.nanosec * _NANO or stamp
        found = self._frames.on_its_robot(header.frame_id)
        mounting = replace(found, mount=self.mounting.over(found.mount))
        read = CONVERSIONS[played.connection.msgtype].read
        return Recorded(stamp, played.topic, read(message, self.robot, mounting, time))

    def _chosen(self) -> Iterator[Played]:
        """The connections that are played. Raises RecordingError."""
        known = {one.topic: one.msgtype for one in self._reader.connections}
        chosen = self._named(known) if self.topics else self._first_ones(known)
        for connection in self._reader.connections:
            if connection.topic in chosen and connection.msgtype in CONVERSIONS:
                yield Played(connection, chosen[connection.topic])

    def _named(self, known: Mapping[str, str]) -> Mapping[str, str]:
        for topic in self.topics:
            if topic not in known:
                there = ", ".join(sorted(known)) or "none"
                raise RecordingError(f"{self.path}: has no topic {topic}; there are {there}")
            if known[topic] not in CONVERSIONS:
                raise RecordingError(
                    f"{self.path}: {topic} is of {known[topic]}; expected one of"
                    f" {', '.join(CONVERSIONS)}"
                )
        return self.topics

    def _first_ones(self, known: Mapping[str, str]) -> Mapping[str, str]:
        chosen: dict[str, str] = {}
        for topic, kind in sorted(known.items()):
            if kind not in CONVERSIONS:
                continue
            here = CONVERSIONS[kind].topic
            if here in chosen.values():
                line = f"{self.path}: {topic} is passed over; the option topics takes it too"
                self.pass_over(_OTHERS, line)
            else:
                chosen[topic] = here
        if not chosen:
            there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(known.items()))
            raise RecordingError(
                f"{self.path}: has nothing to play; expected one of {', '.join(CONVERSIONS)};"
                f" there are {there or 'no topics'}"
            )
        return chosen

    def _learn_mounts(self) -> None:
        static = [one for one in self._reader.connections if one.topic.lstrip("/") == _STATIC]
        if not static:
            return
        try:
            for connection, _, data in self._reader.messages(static):
                message = self._decoded(data, connection)
                if message is not None:
                    self._frames.hear(message)
        except Exception as error:  # as above
            self.pass_over(_BROKEN, f"{self.path}: /{_STATIC} breaks off: {_line(error)}")


def open_bag(path: Path, pass_over: PassOver) -> Bag:
    """A bag as it is, for whoever wants its readings alone. Raises RecordingError."""
    return Bag(path, pass_over)


def _opened(path: Path) -> AnyReader:
    try:
        from rosbags.highlevel import AnyReader  # late: of the extra ros
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise RecordingError(
            f"{path}: bags need rosbags; install it with: pip install 'minerva-bus[ros]'"
        ) from None
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except Exception as error:  # as above
        raise RecordingError(f"{path}: is no bag that can be read: {_line(error)}") from None
    return reader


def _line(error: Exception) -> str:
    if isinstance(error, UnicodeError):
        return "it begins with garbage"
    said = " ".join(str(error).split())[:200] or type(error).__name__
    return f"{said}; an index can be made anew (rosbag reindex)" if "index" in said else said
