"""The file of a record while it is written: its channels, and its name on the disk."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from minerva_bus import __version__
from minerva_bus.log import channels as c
from minerva_bus.log.description import Description
from minerva_bus.log.errors import RecordError, check_installed
from minerva_bus.outputs import check_output, check_replaceable

if TYPE_CHECKING:
    from mcap.writer import Writer

CHUNK: Final = 4 << 20
"""Bytes of a chunk before compression. Large, because the maps of robots repeat between frames."""

HEAD: Final = 31
"""Bytes of a message without its data (MCAP specification, Message)."""


class McapFile:
    """An MCAP file with our channels. Raises OSError if it cannot be written.

    `stream` stays open. Times are those of the world that `description` describes. `in_chunk` is
    the number of bytes in the current chunk, which are in memory only.
    """

    def __init__(self, stream: IO[bytes], description: Description) -> None:
        world = description.world
        self.in_chunk: int = 0
        self._stream = stream
        self._dt = world.dt
        self._began = description.began
        self._is_dirty = False
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._writer = _mcap_writer(stream)
        self._writer.start(c.PROFILE, f"minerva-bus {__version__}")
        self._writer.add_metadata(
            "minerva", {"world": world.name, "seed": str(world.seed), "dt": repr(world.dt)}
        )
        # Readers of damaged files rely on these ids, so they are registered first and in order.
        for topic in c.OWN:
            self.register(topic, c.SCHEMA_OF.get(topic, ""))

    def __contains__(self, topic: str) -> bool:
        return topic in self._channels

    def register(self, topic: str, schema: str = "") -> None:
        """Add a channel: JSON with this schema, for other tools, or else msgpack."""
        # Called again for each message of a channel for other tools.
        if topic in self._channels:
            return
        if schema and schema not in self._schemas:
            plain = json.dumps(c.SCHEMAS[schema]).encode()
            self._schemas[schema] = self._writer.register_schema(schema, "jsonschema", plain)
        encoding, number = ("json", self._schemas[schema]) if schema else ("msgpack", 0)
        self._channels[topic] = self._writer.register_channel(topic, encoding, number)

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


def _mcap_writer(stream: IO[bytes]) -> Writer:
    check_installed()
    from mcap.writer import CompressionType, Writer

    return Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)


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
