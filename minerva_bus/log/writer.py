"""Writes a record: an MCAP file with our channels, in the order of events."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from minerva_bus import __version__
from minerva_bus.frame.messages import FrameRecord, Readings
from minerva_bus.frame.stimuli import FrameDone
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.checkpoints import Kept, encode_checkpoint
from minerva_bus.log.deltas import delta_between
from minerva_bus.log.description import Description, encode_description
from minerva_bus.log.entries import encode_frame, encode_inputs, encode_keyframe
from minerva_bus.log.errors import RecordError
from minerva_bus.log.extra import check_installed
from minerva_bus.log.places import Surveyor
from minerva_bus.log.reader import Record
from minerva_bus.log.sensing import (
    decode_sensed,
    encode_dropped,
    encode_readings,
    encode_transform,
    shown_readings,
)
from minerva_bus.log.showing import encode_log, encode_maps, encode_poses
from minerva_bus.outputs import check_output, check_replaceable

if TYPE_CHECKING:
    from mcap.writer import Writer

CHUNK: Final = 4 << 20
"""Bytes of a chunk before compression. Large, because the maps of robots repeat between frames."""

SMALL: Final = CHUNK // 8
"""Maximum bytes of a frame that `idle` encodes."""

HEAD: Final = 31
"""Bytes of a message without its data (MCAP specification, Message)."""

KEY_AFTER: Final = 8
"""A keyframe is written when the frames since the last one are so many times as long."""

SHOWN: Final = 500
"""Agents of a kind whose poses are shown; of a larger kind, every n-th agent."""

SHOWN_EVERY: Final = 0.1
"""Seconds of world time between two shown poses of an agent."""


class RecordWriter:
    """Writes one record. Raises OSError if it cannot be written.

    `stream` is the file, which stays open. Data written before the last `flush` can be read in any
    case: `kept` of `frames` frames. `past` is a record to continue; its contents are copied first.
    """

    def __init__(
        self, stream: IO[bytes], description: Description, past: Record | None = None
    ) -> None:
        self._stream = stream
        self._description = description
        self._dt = description.world.dt
        self._scene = description.world.scene
        self._surveyor = Surveyor(description.world.vocabulary, SHOWN)
        self._since_key = 0
        self._key_bytes = 0
        self._last_shown = -1.0
        self._kept: Kept | None = None
        self._dirty = False
        self._in_chunk = 0
        self.frames: int = 0
        self.kept: int = 0
        self._writer = _mcap_writer(stream)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._sensing: set[str] = set()
        self._begin()
        if past is None:
            self._put_beginning()
        else:
            self._copy(past)
        self.flush()

    def _begin(self) -> None:
        world = self._description.world
        self._writer.start(c.PROFILE, f"minerva-bus {__version__}")
        self._writer.add_metadata(
            "minerva", {"world": world.name, "seed": str(world.seed), "dt": repr(world.dt)}
        )
        for topic in c.OWN:
            if topic in c.SCHEMA_OF:
                self._show_in(topic, c.SCHEMA_OF[topic])
            else:
                self._channels[topic] = self._writer.register_channel(topic, "msgpack", 0)
        for kind in self._surveyor.placed:
            self._show_in(c.POSES + kind, "foxglove.PosesInFrame")

    def _show_in(self, topic: str, schema: str) -> None:
        """Register a channel for other tools."""
        if schema not in self._schemas:
            plain = json.dumps(c.SCHEMAS[schema]).encode()
            self._schemas[schema] = self._writer.register_schema(schema, "jsonschema", plain)
        self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema])

    def _describe(self) -> None:
        """Write the description, in two chunks: a record cannot be read without it."""
        self._put(c.WORLD, encode_description(self._description), 0, 0.0)
        self._writer.flush()
        self._put(c.WORLD, encode_description(self._description, string=False), 0, 0.0)

    def _put_beginning(self) -> None:
        world = self._description.world
        self._describe()
        self._put_keyframe(0, 0.0, None)
        for grid in encode_maps(world.scene, world.vocabulary):
            self._put(c.MAP, grid, 0, 0.0)
        self._show_poses(0, 0.0)

    def _copy(self, past: Record) -> None:
        """Copy a record up to the state from which its world resumes, and write that state."""
        end = past.intact_end()
        number, self._scene = end.number, end.scene
        published = self._description.began
        self._describe()
        for topic, message in past.messages(number):
            if topic == c.WORLD or topic not in self._channels:
                continue
            self._writer.add_message(
                self._channels[topic],
                log_time=message.log_time,
                publish_time=message.publish_time,
                data=message.data,
                sequence=message.sequence,
            )
            self.frames += topic == c.FRAME
            published = message.publish_time
            sensed = decode_sensed(message.data) if topic == c.SENSED else None
            if isinstance(sensed, Readings):
                seconds = (published - self._description.began) / c.NANO
                self._show_readings(sensed, message.sequence, seconds)
        kept = None if end.checkpoint is None else Kept.of(end.checkpoint)
        self._put_keyframe(number, (published - self._description.began) / c.NANO, kept)

    def frame(
        self,
        record: FrameRecord | FrameDone,
        scene: Scene,
        seconds: float,
        timings: Mapping[str, float],
        kept: Kept | None = None,
    ) -> None:
        """Write a frame; `scene` is the string after it, and `kept` the checkpoint there.

        The checkpoint and the inputs come first: a frame that was not cut off then has both.
        """
        delta = delta_between(self._scene, scene)
        data = encode_frame(record.frame, record.events, delta, scene.digest)
        after = record.frame + 1
        checkpoint = encode_checkpoint(kept, self._kept) if kept is not None else b""
        if checkpoint:
            self._put(c.CHECKPOINT, checkpoint, after, seconds, after)
        self._kept = kept
        if isinstance(record, FrameDone) and record.inputs is not None:
            inputs = encode_inputs(record.inputs.without_replies)
            self._put(c.INPUTS, inputs, after, seconds, record.frame)
        self._put(c.FRAME, data, after, seconds, record.frame)
        self._put(c.TIMING, _timing(record.frame, seconds, timings), after, seconds, record.frame)
        self._scene = scene
        self.frames += 1
        self._since_key += len(data) + len(checkpoint)
        if self._since_key > KEY_AFTER * self._key_bytes:
            self._put_keyframe(after, seconds, kept)
        self._show_poses(after, seconds)

    def log(self, frame: int, seconds: float, member: str, text: str, warning: bool) -> None:
        """Write a log line during this frame."""
        time = c.time_of(frame, self._dt)
        self._put(c.LOG, encode_log(time, member, text, warning), frame, seconds)

    def sensed(self, readings: Readings, frame: int, seconds: float) -> None:
        """Write readings of a sensor topic that arrived during this frame."""
        number = readings.frame if readings.frame >= 0 else frame
        self._put(c.SENSED, encode_readings(readings), number, seconds, number)
        self._show_readings(readings, number, seconds)

    def dropped(self, count: int, frame: int, seconds: float) -> None:
        """Write how many messages on topics are missing."""
        self._put(c.SENSED, encode_dropped(count), frame, seconds, frame)

    def _show_readings(self, readings: Readings, frame: int, seconds: float) -> None:
        for schema, data in shown_readings(readings, c.time_of(frame, self._dt)):
            topic = f"{c.TOPICS}{readings.topic}/{readings.member}/{schema.partition('.')[2]}"
            if topic not in self._channels:
                self._show_in(topic, schema)
            self._put(topic, data, frame, seconds, frame)
        self._sensing.update(reading.robot for reading in readings.readings)

    def flush(self) -> None:
        """Write everything to the disk."""
        if self._dirty:
            self._writer.flush()
            _sync(self._stream)
            self._dirty, self._in_chunk, self.kept = False, 0, self.frames

    @property
    def has_room(self) -> bool:
        """Whether a small frame, and a keyframe if one is due, stay in memory."""
        due = self._since_key + SMALL > KEY_AFTER * self._key_bytes
        whole = self._key_bytes if due else 0
        return whole <= SMALL and self._in_chunk + whole < CHUNK - SMALL

    def finish(self) -> None:
        """Write the remaining data and the index."""
        self.flush()
        self._writer.finish()
        self._stream.flush()
        _sync(self._stream)

    def _put_keyframe(self, frame: int, seconds: float, kept: Kept | None) -> None:
        data = encode_keyframe(frame, self._scene, kept)
        self._put(c.KEYFRAME, data, frame, seconds)
        self._since_key, self._key_bytes = 0, len(data)
        self._kept = kept  # The next checkpoint contains changes from this one.

    def _show_poses(self, frame: int, seconds: float) -> None:
        now = frame * self._dt
        if self._last_shown >= 0.0 and now - self._last_shown < SHOWN_EVERY:
            return
        self._last_shown = now
        for kind, places in self._surveyor.places(self._scene).items():
            time = c.time_of(frame, self._dt)
            self._put(c.POSES + kind, encode_poses(time, places), frame, seconds)
            for robot, x, y, angle in places.of(self._sensing) if self._sensing else ():
                if c.TRANSFORMS not in self._channels:
                    self._show_in(c.TRANSFORMS, "foxglove.FrameTransform")
                data = encode_transform(robot, time, x, y, angle)
                self._put(c.TRANSFORMS, data, frame, seconds)

    def _put(self, topic: str, data: bytes, frame: int, seconds: float, sequence: int = 0) -> None:
        self._writer.add_message(
            self._channels[topic],
            log_time=c.time_of(frame, self._dt),
            publish_time=self._description.began + round(seconds * c.NANO),
            data=data,
            sequence=sequence & 0xFFFFFFFF,
        )
        self._in_chunk += len(data) + HEAD
        if self._in_chunk > CHUNK:
            self._in_chunk = 0
        self._dirty = True


def _timing(frame: int, seconds: float, timings: Mapping[str, float]) -> bytes:
    if timings:
        return json.dumps({"frame": frame, "seconds": seconds, **timings}).encode()
    return b'{"frame": %d, "seconds": %.9f}' % (frame, seconds)


def _mcap_writer(stream: IO[bytes]) -> Writer:
    check_installed()
    from mcap.writer import CompressionType, Writer

    return Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)


def _sync(stream: IO[bytes]) -> None:
    """Write a file to its disk, if it is on one."""
    try:
        os.fsync(stream.fileno())
    except OSError as error:
        if error.errno not in (None, errno.EINVAL, errno.ENOTSUP):
            raise


def open_for_record(path: Path, *, keep_old: bool = True) -> IO[bytes]:
    """A new file of this name; with `keep_old`, an existing one is kept as `NAME.old.mcap`.

    Raises RecordError.
    """
    try:
        if keep_old:
            _keep_old(path)
        else:
            check_output(path, "record")
        return path.open("wb")
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {error.strerror}") from None


def part_of(path: Path) -> Path:
    """Temporary name of a record while it is copied."""
    return path.with_name(f"{path.stem}.part{path.suffix}")


def take_name(path: Path, *, keep_old: bool) -> None:
    """Rename the temporary record to its final name, as `open_for_record`. Raises RecordError."""
    try:
        if keep_old:
            _keep_old(path)
        part_of(path).replace(path)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {error.strerror}") from None


def _keep_old(path: Path) -> None:
    check_replaceable(path, "record")
    if path.is_file():
        old = path.with_name(f"{path.stem}.old{path.suffix}")
        check_replaceable(old, "record")
        path.replace(old)
