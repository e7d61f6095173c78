"""Messages in the intact chunks of a record.

A chunk with a wrong checksum is skipped as a whole and reported. No chunk is unpacked beyond its
declared size, or beyond the limits of a record.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import IO, Any, Final

from minerva_bus.log.channels import FRAME, KEYFRAME, OWN, PROFILE
from minerva_bus.log.errors import RecordError, check_installed
from minerva_bus.log.scanning import (
    MAGIC,
    MESSAGE,
    ChunkLocation,
    Damage,
    channels_in,
    read_summary,
    scan,
    split,
)
from minerva_bus.outputs import is_stream, note_read

_MESSAGE_BEGIN: Final = struct.Struct("<HIQQ")
FEWEST_MESSAGES: Final = 100
MESSAGES_PER_BYTE: Final = 4
"""Maximum messages of a chunk, plus this many per packed byte: messages differ at least in time."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message as stored in the file; times in nanoseconds."""

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class Chunks:
    """The chunks of a record. Raises RecordError if the file is not a record.

    `complete`: the file was finished; otherwise the world was killed or the disk was full, and
    only data after the last flush may be missing. `cut`: bytes after the last complete chunk.
    `indexed`: the summary is intact. `size`: in bytes.
    """

    def __init__(self, path: Path) -> None:
        check_installed()
        self.path = path
        try:
            self.size = path.stat().st_size
            if is_stream(path):
                raise RecordError(f"{path}: a pipe or device; expected a regular file")
            self._file = path.open("rb")
            note_read(path)
        except OSError as error:
            raise RecordError(f"{path}: {error.strerror}") from None
        except ValueError as error:  # The name contains a null character.
            raise RecordError(f"{path}: {error}") from None
        self._damage: dict[int, Damage] = {}
        self._latest: tuple[int, frozenset[str], list[tuple[str, Message]]] = (-1, frozenset(), [])
        try:
            self._scan()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def damage(self) -> list[Damage]:
        """Damage in order: outside of chunks, and in the chunks read so far."""
        return sorted(self._damage.values(), key=lambda damage: damage.begin)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, Message]]:
        """Topic and message of some topics, in order; damaged chunks are skipped."""
        for chunk in range(len(self.places)):
            yield from self.messages_in(chunk, topics) or ()

    def messages_in(self, chunk: int, topics: Collection[str]) -> list[tuple[str, Message]] | None:
        """Topic and message of some topics in one chunk, in order; None if it is damaged."""
        wanted = {number: topic for number, topic in self.topics.items() if topic in topics}
        place = self.places[chunk]
        # A chunk that was found to be damaged is not unpacked again.
        if place.begin in self._damage:
            return None
        known = self._summary.channels.get(place.begin)
        # The summary lists the channels of each chunk, which saves unpacking it.
        if known is not None and known.isdisjoint(wanted):
            return []
        latest, read, messages = self._latest
        if latest == chunk and read.issuperset(topics):
            return [each for each in messages if each[0] in topics]
        # After a keyframe is found, the frames after it are read, often from the same chunk.
        read = frozenset((*topics, KEYFRAME, FRAME))
        kept = {number: topic for number, topic in self.topics.items() if topic in read}
        try:
            messages = list(_messages(_unpacked(self._file, place), kept, place))
            self._latest = chunk, read, messages
            return [each for each in messages if each[0] in topics]
        except Exception as error:  # decompressors raise various exceptions
            self._note(Damage(place.begin, place.end, _why(error)))
            return None

    def torn(self, chunk: int) -> bool:
        """Whether a chunk may be lost between this one and the one before.

        The summary lists all chunks; without it, any damaged bytes may have been one.
        """
        return chunk in self._torn

    # --- the file ---

    def _scan(self) -> None:
        self._check_beginning()
        try:
            scanned = scan(self._file, self.size)
        except RecordError as error:
            raise RecordError(f"{self.path}: {error}") from None
        _check_profile(self.path, scanned.header)
        for damage in scanned.damage:
            self._note(damage)
        # The description is in the first chunk, so nothing can be read without one.
        if not scanned.places:
            raise RecordError(f"{self.path}: it was cut off before anything was written")
        self._summary = read_summary(self._file, self.size)
        self.places, self.indexed = scanned.places, self._summary.sound
        # An intact summary proves that the file was finished, even
        # if the end of the data is damaged.
        self.complete = scanned.complete or self.indexed
        self.cut = 0 if self.complete else scanned.cut
        if scanned.cut and self.complete:
            self._note(Damage(self.size - scanned.cut, self.size, "no record of an MCAP file"))
        begins = [place.begin for place in self.places]
        # With the index, only chunks that are listed and were not found are lost.
        lay = self._summary.channels.keys() - {*begins} if self.indexed else self._damage.keys()
        self._torn = {bisect(begins, at) for at in lay}
        if scanned.complete and not self.indexed:
            self._note(Damage(scanned.end, self.size, "its summary is wrong"))
        self.topics = self._topics()

    def _check_beginning(self) -> None:
        """Reject files that are not records; the beginning of a record may be damaged."""
        begin = self._file.read(256)
        self._file.seek(max(0, self.size - len(MAGIC)))
        known = begin.startswith(MAGIC) or b"minerva-bus" in begin or self._file.read() == MAGIC
        # Zeros may be the beginning of a record that never reached the disk.
        if not known and (begin.strip(b"\0") or not begin):
            raise RecordError(f"{self.path}: not an MCAP file; expected a record of a run")

    def _topics(self) -> dict[int, str]:
        """Channels are in the first chunk and in the summary; ours always have the same ids."""
        try:
            data = _unpacked(self._file, self.places[0])
            first = dict(channels_in(data))
        except Exception as error:  # decompressors raise various exceptions
            self._note(Damage(self.places[0].begin, self.places[0].end, _why(error)))
            first = {}
        return {**self._summary.topics, **first} or dict(enumerate(OWN, 1))

    def _note(self, damage: Damage) -> None:
        self._damage[damage.begin] = damage


def _check_profile(path: Path, header: bytes) -> None:
    """Reject MCAP files of other programs; the header of a record may be damaged."""
    size = int.from_bytes(header[:4], "little")
    profile = header[4 : 4 + size].decode("utf-8", "replace")
    if header and profile != PROFILE and b"minerva" not in header:
        raise RecordError(
            f"{path}: an MCAP file, but not a record of Minerva Bus: its profile is"
            f" {profile[:40]!r}, not {PROFILE!r}"
        )


def _why(error: Exception) -> str:
    return str(error) if isinstance(error, ValueError) else f"its data is wrong: {error}"[:120]


# --- a chunk ---


def _unpacked(file: IO[bytes], place: ChunkLocation) -> bytes:
    """The unpacked data of a chunk. Raises ValueError, and the errors of decompressors."""
    file.seek(place.data)
    packed = file.read(place.size)
    data = _decompressed(packed, place)
    if len(data) > place.unpacked:
        raise ValueError("it unpacks to more than it declares")
    # A checksum of 0 means that there is none (MCAP specification, Chunk).
    if place.crc and zlib.crc32(data) != place.crc:
        raise ValueError("its checksum is wrong")
    return data


def _decompressed(packed: bytes, place: ChunkLocation) -> bytes:
    """At most one byte more than the declared size."""
    # Enough to detect a chunk that unpacks to more, without unpacking all of it.
    most = place.unpacked + 1
    if place.packing == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
            return stream.read(most)
    if place.packing == "lz4":
        frames: Any = import_module("lz4.frame")
        return frames.LZ4FrameDecompressor().decompress(packed, most)
    return packed


def _messages(
    data: bytes, wanted: dict[int, str], place: ChunkLocation
) -> Iterator[tuple[str, Message]]:
    # Bounded, because a few compressed bytes can contain millions of empty messages.
    left = FEWEST_MESSAGES + MESSAGES_PER_BYTE * place.size
    for opcode, begin, end in split(data):
        left -= 1
        if left < 0:
            raise ValueError("it has more messages than a chunk of its size can have")
        if opcode != MESSAGE:
            continue
        if end - begin < _MESSAGE_BEGIN.size:
            raise ValueError("a message in it is too short")
        channel, sequence, log, publish = _MESSAGE_BEGIN.unpack_from(data, begin)
        topic = wanted.get(channel)
        if topic is not None:
            body = data[begin + _MESSAGE_BEGIN.size : end]
            yield topic, Message(channel, sequence, log, publish, body)
