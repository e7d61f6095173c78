"""Records as bags of ROS 2: MCAP files with CDR messages, written by rosbags.

| topic                 | message                          |                                       |
|-----------------------|----------------------------------|---------------------------------------|
| /tf                   | tf2_msgs/TFMessage               | poses of agents, in the frame `map`   |
| /tf_static            | tf2_msgs/TFMessage               | sensors on their robots               |
| /ROBOT/TOPIC          | LaserScan, Image, Odometry, ...  | readings, with the frame ROBOT/TOPIC  |
| /events/TYPE          | std_msgs/String                  | the events of a frame, a list in JSON |
"""

from __future__ import annotations

import json
import re
from collections.abc import Container, Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from minerva_analysis.places import SHOWN, Surveyor
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.events import AnyEvent, single
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.text_and_digest import value_text
from minerva_bus.log.channels import time_of
from minerva_bus.log.record import Record
from minerva_bus.world.readings import Mount, Reading
from minerva_exporters.datasets import ExportChoice, ExportProgress
from minerva_exporters.sources import RecordFrames, new_folder, only_record
from minerva_services.bridges.ros_messages.messages import TRANSFORMS, messages
from minerva_services.bridges.ros_messages.sending import frame_of, message_of, mount_of
from minerva_services.options import require

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Writer

FORM: Final = "rosbag"
MAP: Final = "map"
_STRING: Final = "std_msgs/msg/String"
_STATIC: Final = "/tf_static"
_UNNAMED: Final = re.compile(r"[^A-Za-z0-9_/]")
"""Characters that names of topics must not have."""


def write_bag(
    records: Sequence[Path], into: Path, choice: ExportChoice, progress: ExportProgress
) -> Mapping[str, int]:
    """Write a record as the folder of a bag; see `Exporter`."""
    require(FORM, "rosbags.typesys", "rosbags", "ros")
    path = only_record(records, FORM)
    with Record(path) as record, new_folder(into, FORM):
        description = record.description
        surveyor = Surveyor(description.world.vocabulary, SHOWN)
        frames = RecordFrames(record, choice.begin, choice.end)
        with closing(_BagFile(into)) as bag:
            for frame in frames:
                bag.time = description.began + time_of(frame.number, description.world.dt)
                due = not (frame.number - choice.begin) % choice.every
                # A scan is placed by the pose of its own frame.
                sensed = {r.robot for message in frame.readings for r in message.readings}
                if due or sensed:
                    bag.poses(surveyor, frame.scene, None if due else sensed)
                bag.readings(frame.readings)
                bag.events(frame.events)
                progress(frame.number - choice.begin, frames.last - choice.begin)
            return {"messages": bag.count, "topics": len(bag.topics)}


class _BagFile:
    """A bag that is written; `time` is that of all messages, in nanoseconds since 1970."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        self.time, self.count = 0, 0
        self.topics: dict[tuple[str, str], Connection] = {}
        self._mounts: dict[str, Mount] = {}
        path.rmdir()  # The library makes the folder itself.
        self._file: Writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._file.open()

    def close(self) -> None:
        self._file.close()

    def poses(self, surveyor: Surveyor, scene: Scene, robots: Container[str] | None) -> None:
        """Write the poses of agents; of these `robots` only, unless it is None."""
        header, make = self._header(MAP), messages()
        transforms = [
            make.transform(header, name, x, y, angle)
            for places in surveyor.places(scene).values()
            for name, x, y, angle in places.of(places.ids if robots is None else robots)
        ]
        if transforms:
            self._write("/tf", TRANSFORMS, make.make(TRANSFORMS, transforms=transforms))

    def readings(self, published: Iterable[Readings]) -> None:
        """Write the readings of a frame."""
        for message in published:
            for reading in message.readings:
                frame = frame_of(reading, message.topic)
                if frame != reading.robot:
                    self._mount(reading, frame)
                kind, made = message_of(reading, self._header(frame))
                self._write(f"/{reading.robot}/{message.topic}", kind, made)

    def events(self, events: Iterable[AnyEvent]) -> None:
        """Write the events of a frame, a message for each type."""
        by_type: dict[str, list[dict[str, Any]]] = {}
        for event in single(events):
            data = {name: _plain(value) for name, value in event.data.items()}
            own = {"sender": event.sender, "receivers": list(event.receivers), "data": data}
            by_type.setdefault(event.type, []).append(own)
        for name, rows in by_type.items():
            text = messages().make(_STRING, data=json.dumps(rows, ensure_ascii=False))
            self._write(f"/events/{name}", _STRING, text)

    def _mount(self, reading: Reading, frame: str) -> None:
        """Write the pose of a sensor on its robot, if it is new."""
        mount = mount_of(reading)
        if self._mounts.get(frame) == mount:
            return
        self._mounts[frame] = mount
        header = self._header(reading.robot or MAP)
        placed = messages().transform(header, frame, mount.x, mount.y, mount.angle)
        self._write(_STATIC, TRANSFORMS, messages().make(TRANSFORMS, transforms=[placed]))

    def _header(self, frame: str) -> Any:
        return messages().header(frame, self.time)

    def _write(self, topic: str, kind: str, message: Any) -> None:
        topic = _UNNAMED.sub("_", topic).replace("//", "/")
        if (topic, kind) not in self.topics:
            self.topics[topic, kind] = self._connection(topic, kind)
        self._file.write(self.topics[topic, kind], self.time, messages().encode(kind, message))
        self.count += 1

    def _connection(self, topic: str, kind: str) -> Connection:
        others = [name for name, _ in self.topics]
        # A topic has one type.
        name = f"{topic}_{kind.rpartition('/')[2].lower()}" if topic in others else topic
        qos = [_lasting()] if topic == _STATIC else []
        return self._file.add_connection(
            name, kind, typestore=messages().store, offered_qos_profiles=qos
        )


def _lasting() -> Any:
    """The profile of transforms that do not change: players send them to late subscribers."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST, 100, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
        never, never, QosLiveliness.AUTOMATIC, never, False,
    )  # fmt: skip


def _plain(value: Any) -> Any:
    """A datum as JSON; strings of the grammar as text."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Scene):
        return value_text(value)
    return list(value) if isinstance(value, tuple) else value  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]
