"""Writes a record: an MCAP file with our channels, in the order of events.

Log lines are in JSON, which other tools read, too. Extensions write further channels for them.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from minerva_bus import __version__
from minerva_bus.entry_points import entries
from minerva_bus.errors import RecordError
from minerva_bus.files import check_output, check_replaceable
from minerva_bus.frame.messages import FrameRecord, Readings
from minerva_bus.frame.stimuli import FrameDone
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.columns import column_bytes
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.channels import check_installed, encode_log
from minerva_bus.log.entries import (
    Kept,
    RecordHeader,
    decode_sensed,
    delta_between,
    encode_checkpoint,
    encode_dropped,
    encode_frame,
    encode_header,
    encode_inputs,
    encode_keyframe,
    encode_readings,
)
from minerva_bus.log.record import Record
from minerva_bus.world.operator import PersonOperation

if TYPE_CHECKING:
    from mcap.writer import Writer


CHUNK: Final = 4 << 20
"""Bytes of a chunk before compression. Large, because the maps of robots repeat between frames."""

LARGE: Final = CHUNK
"""Bytes of the numbers in columns from which on a frame alone fills a chunk with them."""

HEAD: Final = 31
"""Bytes of a message without its data (MCAP specification, Message)."""


class McapFile:
    """An MCAP file with our channels. Raises OSError if it cannot be written.

    `stream` stays open. Times are those of the world that `description` describes. `in_chunk` is
    the number of bytes in the current chunk, which are in memory only. `is_large` as in
    `RecordWriter`.
    """

    def __init__(self, stream: IO[bytes], description: RecordHeader) -> None:
        world = description.world
        self.in_chunk: int = 0
        self._stream = stream
        self._dt = world.dt
        self._began = description.began
        self._is_dirty = False
        self._ends: tuple[int, int] = 0, 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self.is_large = column_bytes(world.scene) >= LARGE
        self._writer = _mcap_writer(stream, is_large=self.is_large)
        self._writer.start(c.PROFILE, f"minerva-bus {__version__}")
        self._writer.add_metadata(
            "minerva", {"world": world.name, "seed": str(world.seed), "dt": repr(world.dt)}
        )
        # Readers of damaged files rely on these ids, so they are registered first and in order.
        for topic in c.OWN:
            self.register(topic, c.SCHEMAS.get(topic))

    def __contains__(self, topic: str) -> bool:
        return topic in self._channels

    def register(self, topic: str, schema: Mapping[str, Any] | None = None) -> None:
        """Add a channel: JSON with this schema, for other tools, or else msgpack."""
        # Called again for each message of a channel for other tools.
        if topic in self._channels:
            return
        encoding, number = ("msgpack", 0) if schema is None else ("json", self._schema(schema))
        self._channels[topic] = self._writer.register_channel(topic, encoding, number)

    def _schema(self, schema: Mapping[str, Any]) -> int:
        title = schema["title"]
        if title not in self._schemas:
            plain = json.dumps(schema).encode()
            self._schemas[title] = self._writer.register_schema(title, "jsonschema", plain)
        return self._schemas[title]

    def put(self, topic: str, data: bytes, frame: int, seconds: float, sequence: int = 0) -> None:
        """Write a message at the beginning of a frame, `seconds` after the record began."""
        log_time = c.time_of(frame, self._dt)
        self.copy(topic, data, log_time, self._began + round(seconds * c.NANO), sequence)

    def copy(self, topic: str, data: bytes, log_time: int, published: int, sequence: int) -> None:
        """Write a message with times in nanoseconds."""
        self._writer.add_message(
            self._channels[topic],
            log_time=log_time,
            publish_time=published,
            data=data,
            # MCAP has 32 bits for it.
            sequence=sequence & 0xFFFFFFFF,
        )
        self.in_chunk += len(data) + HEAD
        if self.in_chunk > CHUNK:  # The library has begun a new chunk.
            self.in_chunk = 0
            begin, self._ends = self._ends[0], (self._ends[1], self._stream.tell())
            _sync_later(self._stream, begin, self._ends[1] - begin)
        self._is_dirty = True

    def end_chunk(self) -> None:
        """Begin a new chunk, so that later damage does not affect the messages so far."""
        self._writer.flush()
        self.in_chunk = 0

    def flush(self) -> None:
        """Write everything to the disk."""
        # Each flush ends a chunk, and small chunks compress badly.
        if self._is_dirty:
            self.end_chunk()
            _sync(self._stream)
            self._is_dirty = False

    def finish(self) -> None:
        """Write the remaining data and the index."""
        self.flush()
        self._writer.finish()
        self._stream.flush()
        _sync(self._stream)


def _mcap_writer(stream: IO[bytes], *, is_large: bool) -> Writer:
    check_installed()
    from mcap.writer import CompressionType, Writer

    # Most numbers of a large population compress badly, and zstd takes as long for them as all else
    # in the record.
    compression = CompressionType.LZ4 if is_large else CompressionType.ZSTD
    return Writer(stream, chunk_size=CHUNK, compression=compression, enable_data_crcs=True)


def _sync_later(stream: IO[bytes], begin: int, size: int) -> None:
    """Let the system begin to write a part of a file, so that `_sync` need not wait for it.

    What it has already written no longer takes memory. A record is rarely read at once, and other
    memory would have to be cleared for the next frame.
    """
    # Not all systems have it, and pipes and buffers have no disk.
    with suppress(OSError, AttributeError):
        os.posix_fadvise(stream.fileno(), begin, size, os.POSIX_FADV_DONTNEED)


def _sync(stream: IO[bytes]) -> None:
    """Write a file to its disk; pipes and buffers have none."""
    try:
        os.fsync(stream.fileno())
    except OSError as error:
        # Errors of a disk must be raised, because the frames would be reported as written.
        if error.errno not in (None, errno.EINVAL, errno.ENOTSUP):
            raise


# --- its name on the disk ---


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
    except ValueError as error:  # The name contains a null character.
        raise RecordError(f"{path}: cannot be written: {error}") from None


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
    # Only files with the mark of a record are renamed, never a user's own files.
    check_replaceable(path, "record")
    if path.is_file():
        old = path.with_name(f"{path.stem}.old{path.suffix}")
        check_replaceable(old, "record")
        path.replace(old)


# --- channels for other tools ---

CHANNELS: Final = "minerva.channels"
"""The entry points of classes of `FurtherChannels`."""


class FurtherChannels:
    """Base of channels for other tools, which our own readers ignore.

    `file` is to be written, `world` that of the record; see the methods of `McapFile`.
    """

    def __init__(self, file: McapFile, world: WorldSpec) -> None: ...

    def begin(self) -> None:
        """Write what does not change: a new record begins."""

    def string(self, scene: Scene, frame: int, seconds: float) -> None:
        """Write about the string with which a frame begins."""

    def readings(self, message: Readings, frame: int, seconds: float) -> None:
        """Write readings that arrived during a frame."""


# --- our own channels ---

SMALL: Final = CHUNK // 8
"""Maximum bytes of a frame that `idle` encodes."""

ALONE: Final = CHUNK // 32
"""Bytes of a chunk after which a keyframe begins another one, so that damage costs less."""

KEY_AFTER: Final = 8
"""A keyframe is written when the frames since the last one are this many times as long."""


class RecordWriter:
    """Writes one record. Raises OSError if it cannot be written.

    `stream` is the file, which stays open. Data written before the last `flush` are always
    readable: `kept` of `frames` frames. `is_large`: a single frame may fill a chunk. `past`: a
    record to continue, which is copied first.
    """

    def __init__(
        self, stream: IO[bytes], description: RecordHeader, past: Record | None = None
    ) -> None:
        self.frames: int = 0
        self.kept: int = 0
        self._description = description
        self._file = McapFile(stream, description)
        self.is_large = self._file.is_large
        self._further: list[FurtherChannels] = [
            entry.load()(self._file, description.world)
            for _, entry in sorted(entries(CHANNELS).items())
        ]
        self._scene = description.world.scene
        self._checkpoint: Kept | None = None
        self._since_key = 0
        self._key_bytes = 0
        self._frame_bytes = 0
        self._put_description()
        if past is None:
            first, state = description.frame, description.world.past
            self._put_keyframe(first, 0.0, Kept.of(state) if first else None)
            for channels in self._further:
                channels.begin()
                channels.string(self._scene, first, 0.0)
        else:
            self._copy(past)
        self.flush()

    def _put_description(self) -> None:
        """Write the description, in two chunks: a record cannot be read without it."""
        self._file.put(c.WORLD, encode_header(self._description), 0, 0.0)
        self._file.end_chunk()
        self._file.put(c.WORLD, encode_header(self._description, string=False), 0, 0.0)

    def _copy(self, past: Record) -> None:
        """Copy a record up to the state from which its world resumes, and write that state."""
        end = past.intact_end()
        self._scene = end.scene
        seconds = 0.0
        for topic, message in past.messages(end.number):
            # The description has been written, and the channels for
            # other tools are derived from the rest.
            if topic == c.WORLD or topic not in self._file:
                continue
            log_time, published = message.log_time, message.publish_time
            self._file.copy(topic, message.data, log_time, published, message.sequence)
            self.frames += topic == c.FRAME
            seconds = (published - self._description.began) / c.NANO
            sensed = decode_sensed(message.data) if topic == c.SENSED else None
            if isinstance(sensed, Readings):
                self._show(sensed, message.sequence, seconds)
        checkpoint = None if end.checkpoint is None else Kept.of(end.checkpoint)
        self._put_keyframe(end.number, seconds, checkpoint)

    def frame(
        self,
        record: FrameRecord | FrameDone,
        scene: Scene,
        seconds: float,
        timings: Mapping[str, float],
        checkpoint: Kept | None = None,
    ) -> None:
        """Write a frame; `scene` is the string after it, and `checkpoint` that after it.

        The checkpoint and the inputs are first: a frame that was not cut off then has both.
        """
        number, after = record.frame, record.frame + 1
        data = encode_frame(number, record.events, delta_between(self._scene, scene), scene.digest)
        change = b"" if checkpoint is None else encode_checkpoint(checkpoint, self._checkpoint)
        if change:
            self._file.put(c.CHECKPOINT, change, after, seconds, after)
        if isinstance(record, FrameDone) and record.inputs is not None:
            inputs = encode_inputs(record.inputs.without_replies)
            self._file.put(c.INPUTS, inputs, after, seconds, number)
        self._file.put(c.FRAME, data, after, seconds, number)
        self._file.put(c.TIMING, _timing(number, seconds, timings), after, seconds, number)
        self._scene, self._checkpoint = scene, checkpoint
        self.frames += 1
        self._frame_bytes = len(data) + len(change)
        self._since_key += self._frame_bytes
        # Keyframes then take an eighth of the record at most, and a seek reads a bounded amount.
        if self._since_key > KEY_AFTER * self._key_bytes:
            self._put_keyframe(after, seconds, checkpoint)
        for channels in self._further:
            channels.string(scene, after, seconds)

    def log(self, frame: int, seconds: float, member: str, text: str, warning: bool) -> None:
        """Write a log line during this frame."""
        time = c.time_of(frame, self._description.world.dt)
        self._file.put(c.LOG, encode_log(time, member, text, warning), frame, seconds)

    def noted(self, operation: PersonOperation, seconds: float) -> None:
        """Write what a person did to the world."""
        data = json.dumps(asdict(operation)).encode()
        self._file.put(c.OPERATION, data, operation.frame, seconds, operation.frame)

    def sensed(self, readings: Readings, frame: int, seconds: float) -> None:
        """Write readings of a sensor topic that arrived during this frame."""
        # Readings in step have the time of their frame; free ones that of the frame in progress.
        number = readings.frame if readings.frame >= 0 else frame
        self._file.put(c.SENSED, encode_readings(readings), number, seconds, number)
        self._show(readings, number, seconds)

    def _show(self, readings: Readings, frame: int, seconds: float) -> None:
        for channels in self._further:
            channels.readings(readings, frame, seconds)

    def dropped(self, count: int, frame: int, seconds: float) -> None:
        """Write the number of missing messages on topics."""
        self._file.put(c.SENSED, encode_dropped(count), frame, seconds, frame)

    def flush(self) -> None:
        """Write all data to the disk."""
        self._file.flush()
        self.kept = self.frames

    def finish(self) -> None:
        """Write the remaining data and the index."""
        self.flush()
        self._file.finish()

    @property
    def has_room(self) -> bool:
        """Whether a small frame, and a keyframe if one is due, stay in memory."""
        due = self._since_key + SMALL > KEY_AFTER * self._key_bytes
        # The next keyframe is assumed to be as long as the last one.
        keyframe = self._key_bytes if due else 0
        # A chunk that ends is written to the disk.
        near = self._since_key + 2 * self._frame_bytes > KEY_AFTER * self._key_bytes
        most = ALONE if near else CHUNK - SMALL
        return keyframe <= SMALL and self._file.in_chunk + keyframe < most

    def _put_keyframe(self, frame: int, seconds: float, checkpoint: Kept | None) -> None:
        data = encode_keyframe(frame, self._scene, checkpoint)
        if self._file.in_chunk > ALONE:
            self._file.end_chunk()
        self._file.put(c.KEYFRAME, data, frame, seconds)
        self._since_key, self._key_bytes = 0, len(data)
        self._checkpoint = checkpoint  # The next checkpoint contains changes from this one.


def _timing(frame: int, seconds: float, timings: Mapping[str, float]) -> bytes:
    if timings:
        return json.dumps({"frame": frame, "seconds": seconds, **timings}).encode()
    return b'{"frame": %d, "seconds": %.9f}' % (frame, seconds)
