"""The chunks of a record: where they are, what is intact in them, and what is lost.

MCAP readers start with the index at the end of a file. The record of a crashed world has no end, so
the scanner moves from record to record of the file without reading chunks. After invalid data it
continues at the next complete chunk. A chunk with a wrong checksum is skipped as a whole and
reported. No chunk is unpacked beyond its declared size, or beyond the limits of a record.

A frame stores how it changes the string of the frame before. After damaged bytes the string is
known again if the frame numbers continue without a gap, because then no frame was lost, or at the
next keyframe.
"""

from __future__ import annotations

import re
import struct
import zlib
from bisect import bisect
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Final

from minerva_bus.errors import RecordError
from minerva_bus.files import is_stream, note_read, similar
from minerva_bus.log import channels as c
from minerva_bus.log.channels import FRAME, KEYFRAME, OWN, PROFILE, check_installed
from minerva_bus.log.entries import Keyframe
from minerva_bus.values import fast_dataclass

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD: Final = struct.Struct("<BQ")
"""Head of each record of an MCAP file: opcode and length of the body."""

HEADER, FOOTER, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 0x01, 0x02, 0x04, 0x05, 0x06, 0x07
_CHUNK_INDEX, _ATTACHMENT, _METADATA, _DATA_END = 0x08, 0x09, 0x0C, 0x0F
_SUMMARY: Final = b"\x02\x03\x04\x08\x0a\x0b\x0d\x0e"
"""Opcodes allowed after the end of the data."""

_CHUNK_BEGIN: Final = struct.Struct("<QQQII")
_FOOTER: Final = struct.Struct("<BQQQI")
_LENGTH: Final = struct.Struct("<Q")
_LEAST: Final = _CHUNK_BEGIN.size + 4 + _LENGTH.size
_SHOWN: Final = 64
"""Bytes of a record that are checked to decide whether it is valid."""

_BLOCKS: Final = (1 << 12, 1 << 20)
"""Bytes searched at once: few at first, because the next chunk is often near."""

MAX_DAMAGE: Final = 256 << 20
"""Bytes in which the next chunk is searched: a sparse file may have any length."""

_WHOLE: Final = re.compile(
    rb"(?=\x06.{7}\x00.{28}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)|\x0f\x04\x00{7})", re.DOTALL
)
"""Possible beginnings of a chunk or of the end of data (MCAP specification, Chunk, Data End)."""

FLOOR: Final = 256 << 20
CHUNK_FLOOR: Final = 80 << 20
RATIO: Final = 1000
"""A chunk unpacks to at most CHUNK_FLOOR bytes, all chunks to FLOOR, plus RATIO for each packed
byte. Frames differ, so records never compress that well; decompression bombs do."""


@fast_dataclass
class ChunkLocation:
    """Location of a chunk: its record is at byte `begin`, its `size` packed bytes at `data`.

    `first`: time of its first message in nanoseconds. `unpacked`: size before compression.
    """

    begin: int
    first: int
    unpacked: int
    crc: int
    packing: str
    data: int
    size: int

    @property
    def end(self) -> int:
        """Offset of the byte after it."""
        return self.data + self.size


@fast_dataclass
class Damage:
    """Unreadable bytes of a file, from `begin` to `end` (exclusive), and the reason."""

    begin: int
    end: int
    why: str


@dataclass(slots=True)
class ScannedFile:
    """Result of a scan: chunks in order, and the damage between them.

    `complete`: the end of the data was scanned, after which there is only a summary, at byte
    `end`. Otherwise `cut` bytes at the end are not part of a complete record. `header`: body of
    the first record.
    """

    places: list[ChunkLocation] = field(default_factory=list[ChunkLocation])
    damage: list[Damage] = field(default_factory=list[Damage])
    complete: bool = False
    end: int = 0
    cut: int = 0
    header: bytes = b""


def scan(file: IO[bytes], size: int) -> ScannedFile:
    """Scan a file of this many bytes. It need not begin with MCAP's magic bytes."""
    scanned = ScannedFile()
    left = FLOOR + RATIO * size
    at = 0
    if _read(file, 0, len(MAGIC)) == MAGIC:
        at = len(MAGIC)
    while at < size and not scanned.complete:
        head = _Head.read(file, at, size)
        # Invalid bytes: the length cannot be trusted, so the next record has to be searched.
        if head is None:
            at = _next_record(file, at, size, scanned)
            continue
        place = head.place()
        # The chunk is skipped without being unpacked; the scan continues behind it.
        if place is not None and place.unpacked > min(left, CHUNK_FLOOR + RATIO * place.size):
            scanned.damage.append(Damage(at, head.end, "it unpacks to more than a file may hold"))
        elif place is not None:
            left -= place.unpacked
            scanned.places.append(place)
        elif head.opcode == HEADER:
            scanned.header = head.body
        scanned.complete = head.opcode == _DATA_END
        at = head.end
    scanned.end = at
    return scanned


def _next_record(file: IO[bytes], at: int, size: int, scanned: ScannedFile) -> int:
    """Offset of the next complete record after invalid data, or the end of the file."""
    for begin in _candidates(file, at + 1, min(size, at + MAX_DAMAGE)):
        if _Head.read(file, begin, size) is not None:
            scanned.damage.append(Damage(at, begin, "no record of an MCAP file"))
            return begin
    if size - at > MAX_DAMAGE:
        advice = f"; a copy cut there has the frames before: truncate --size={at} COPY"
        raise RecordError(
            f"no record of an MCAP file in {MAX_DAMAGE:,} bytes from byte {at:,} on"
            f"{advice if scanned.places else ''}"
        )
    scanned.cut = size - at
    return size


def _candidates(file: IO[bytes], at: int, size: int) -> Iterator[int]:
    """Offsets from a byte on at which a chunk or the end of the data may begin."""
    block, largest = _BLOCKS
    while at < size:
        # Some bytes of the next block are read, too, because a beginning may span both.
        data = _read(file, at, block + _SHOWN)
        # A search takes a hundred times as long as this test, and unwritten data are zeros.
        for match in _WHOLE.finditer(data if data.strip(b"\0") else b""):
            if match.start() < block:
                yield at + match.start()
        at += block
        block = min(2 * block, largest)


@fast_dataclass
class _Head:
    """A complete record: its offset, opcode, length, and the first bytes of its body."""

    at: int
    opcode: int
    length: int
    body: bytes

    @property
    def end(self) -> int:
        """Offset of the byte after it."""
        return self.at + RECORD.size + self.length

    @classmethod
    def read(cls, file: IO[bytes], at: int, size: int) -> _Head | None:
        """The record at an offset, or None if there is no complete and valid one."""
        begin = _read(file, at, RECORD.size + _SHOWN)
        if len(begin) < RECORD.size:
            return None
        opcode, length = RECORD.unpack_from(begin)
        head = cls(at, opcode, length, begin[RECORD.size :])
        if head.end > size or not head.fits():
            return None
        # Random bytes may look like the end of the data, so the next byte must be plausible, too.
        if head.opcode == _DATA_END and _read(file, head.end, 1) not in _SUMMARY:
            return None
        return head

    def fits(self) -> bool:
        """Whether its body fits its opcode: the lengths in it must agree."""
        if self.opcode == CHUNK:
            return self.place() is not None
        if self.opcode == MESSAGE_INDEX:
            inner = int.from_bytes(self.body[2:6], "little")
            return self.length == inner + 6 and inner % 16 == 0
        if self.opcode == _DATA_END:
            return self.length == 4
        if self.opcode == _METADATA:
            named = int.from_bytes(self.body[:4], "little")
            inner = int.from_bytes(self.body[4 + named : 8 + named], "little")
            # After a longer name, the second length is beyond the bytes that were read.
            return named > _SHOWN - 8 or self.length == named + inner + 8
        return self.opcode == _ATTACHMENT or (self.opcode == HEADER and self.at <= len(MAGIC))

    def place(self) -> ChunkLocation | None:
        """Location of the chunk, or None if the record is not a chunk."""
        if self.opcode != CHUNK or len(self.body) < _LEAST:
            return None
        first, _, unpacked, crc, named = _CHUNK_BEGIN.unpack_from(self.body)
        # The longest name of a compression method has four letters.
        packing = self.body[_CHUNK_BEGIN.size : _CHUNK_BEGIN.size + min(named, 4)]
        begin = _CHUNK_BEGIN.size + named + _LENGTH.size
        if named != len(packing) or packing not in (b"", b"lz4", b"zstd"):
            return None
        (size,) = _LENGTH.unpack_from(self.body, begin - _LENGTH.size)
        if begin + size != self.length:
            return None
        data = self.at + RECORD.size + begin
        return ChunkLocation(self.at, first, unpacked, crc, packing.decode(), data, size)


def _read(file: IO[bytes], at: int, count: int) -> bytes:
    file.seek(at)
    return file.read(count)


# --- the summary ---


@fast_dataclass
class FileSummary:
    """Summary at the end of a finished file: topics by channel, and channels by chunk.

    `sound`: the summary is intact.
    """

    sound: bool
    topics: Mapping[int, str] = field(default_factory=dict[int, str])
    channels: Mapping[int, frozenset[int]] = field(default_factory=dict[int, frozenset[int]])


def read_summary(file: IO[bytes], size: int) -> FileSummary:
    """The summary of a finished file, which has a checksum of its own."""
    end = size - len(MAGIC) - _FOOTER.size
    footer = _read(file, max(0, end), _FOOTER.size + len(MAGIC))
    if end < 0 or footer[_FOOTER.size :] != MAGIC:
        return FileSummary(False)
    opcode, _, begin, _, crc = _FOOTER.unpack_from(footer)
    if opcode != FOOTER or not 0 < begin <= end:
        return FileSummary(False)
    data = _read(file, begin, end - begin)
    # The checksum covers the summary and the footer up to the checksum itself.
    if zlib.crc32(footer[: _FOOTER.size - 4], zlib.crc32(data)) != crc:
        return FileSummary(False)
    return _summarized(data)


def _summarized(data: bytes) -> FileSummary:
    from mcap.data_stream import ReadDataStream
    from mcap.records import ChunkIndex

    channels: dict[int, frozenset[int]] = {}
    try:
        for opcode, begin, end in split(data):
            if opcode == _CHUNK_INDEX:
                index = ChunkIndex.read(ReadDataStream(BytesIO(data[begin:end])))
                channels[index.chunk_start_offset] = frozenset(index.message_index_offsets)
        return FileSummary(True, dict(channels_in(data)), channels)
    except Exception:  # mcap raises various exceptions for invalid data
        return FileSummary(False)


def channels_in(data: bytes) -> Iterator[tuple[int, str]]:
    """Id and topic of each channel that data declare before messages. Raises ValueError.

    mcap raises further exceptions for invalid data.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel

    for opcode, begin, end in split(data):
        if opcode == MESSAGE:
            return  # Channels precede all messages.
        if opcode == CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(data[begin:end])))
            yield channel.id, channel.topic


def split(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode and body range of each record in these bytes. Raises ValueError."""
    at = 0
    while at < len(data):
        begin = at + RECORD.size
        if begin > len(data):
            raise ValueError("it ends in the midst of a record")
        opcode, length = RECORD.unpack_from(data, at)
        at = begin + length
        if at > len(data):
            raise ValueError("it ends in the midst of a record")
        if not 0 < opcode < _DATA_END:
            raise ValueError(f"it has a record of opcode {opcode}, which may not be there")
        yield opcode, begin, at


_MESSAGE_BEGIN: Final = struct.Struct("<HIQQ")
FEWEST_MESSAGES: Final = 100
MESSAGES_PER_BYTE: Final = 4
"""Maximum messages of a chunk, plus this many per packed byte: messages differ at least in time."""


# --- messages in the intact chunks ---


@fast_dataclass
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
            raise RecordError(f"{path}: {error.strerror}{similar(path)}") from None
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
        self._damage.update((damage.begin, damage) for damage in scanned.damage)
        # The description is in the first chunk, so nothing can be read without one.
        if not scanned.places:
            raise RecordError(f"{self.path}: it was cut off before anything was written")
        self._summary = read_summary(self._file, self.size)
        self.places, self.indexed = scanned.places, self._summary.sound
        # The bytes at the end prove that the file was finished, even if the end of the data and the
        # summary are damaged.
        end = _read(self._file, max(0, self.size - len(MAGIC)), len(MAGIC))
        self.complete = scanned.complete or end == MAGIC
        self.cut = 0 if self.complete else scanned.cut
        if scanned.cut and self.complete:
            self._note(Damage(self.size - scanned.cut, self.size, "no record of an MCAP file"))
        begins = [place.begin for place in self.places]
        # With the index, only chunks that are listed and were not found are lost.
        lay = self._summary.channels.keys() - {*begins} if self.indexed else self._damage.keys()
        self._torn = {bisect(begins, at) for at in lay}
        if scanned.complete and not self.indexed:
            # Of a summary that is missing as a whole, the last byte stands for the place.
            begin = min(scanned.end, self.size - 1)
            self._note(Damage(begin, self.size, "its summary is wrong"))
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


# --- usable frames after damage ---


class IntactMessages:
    """Iterates over the chunks `begin` to `end` (exclusive), in order.

    `start` is the frame whose string is known at the beginning. `decode` decodes a keyframe.
    During iteration, `lost` lists frames whose strings are unknown, `tears` counts places with
    lost bytes, and `open` is whether no string is known after frame `reached` - 1.
    """

    def __init__(
        self, chunks: Chunks, decode: Callable[[bytes], Keyframe], begin: int, start: int, end: int
    ) -> None:
        self._chunks = chunks
        self._decode = decode
        self._range = range(begin, end)
        self.reached = start
        self.tears: int = 0
        self.lost: list[range] = []
        self.open = False
        self._base: Keyframe | None = None

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, Message, Keyframe | None]]:
        """Topic and message of some topics, without lost frames and their checkpoints.

        The first frame after lost ones is returned with the keyframe before it.
        """
        for chunk in self._range:
            torn = self._chunks.torn(chunk)
            self._note(torn=torn)
            # A tear before the first chunk precedes the keyframe from which the iteration starts.
            self.tears -= torn and chunk == self._range.start
            # Frames and keyframes are always read, because they determine which strings are known.
            messages = self._chunks.messages_in(chunk, {*topics, c.KEYFRAME, c.FRAME})
            self._note(torn=messages is None)
            for topic, message in messages or ():
                if topic == c.KEYFRAME and self.open:
                    self._restart(message.data)
                if self._counts(topic, message.sequence) and topic in topics:
                    yield topic, message, self._taken_base(topic)
        self._note(torn=self._chunks.torn(self._range.stop))

    def _note(self, *, torn: bool) -> None:
        self.tears += torn
        self.open = self.open or torn

    def _taken_base(self, topic: str) -> Keyframe | None:
        base = self._base if topic == c.FRAME else None
        if topic == c.FRAME:
            self._base = None
        return base

    def _restart(self, data: bytes) -> None:
        keyframe = self._decode(data)
        self.open = False
        # Otherwise no frame is missing, and the damaged bytes contained something else.
        if keyframe.number > self.reached:
            self.lost.append(range(self.reached, keyframe.number))
            self._base = keyframe
        else:
            self._base = None
        self.reached = max(keyframe.number, self.reached)

    def _counts(self, topic: str, number: int) -> bool:
        if topic == c.CHECKPOINT:  # It precedes the frame after which it is valid.
            return not self.open or number <= self.reached + 1
        if topic == c.INPUTS:
            return not self.open or number <= self.reached
        if topic == c.KEYFRAME:
            return self._base is None
        if topic != c.FRAME:
            return True
        # The frame after the last known one follows without a gap,
        # so nothing was lost between them.
        self.open = self.open and number > self.reached
        if not self.open:
            self.reached = max(self.reached, number + 1)
        return not self.open


SHOWN: Final = 5
"""Maximum number of ranges of lost frames that are listed."""


# --- what is lost ---


@fast_dataclass
class Losses:
    """The parts of a record that cannot be used.

    `damage`: unreadable bytes. `cut`: bytes at the end outside of complete chunks. `lost`:
    ranges of frames; frames from number `open_from` on, if there were any, are lost too.
    """

    damage: tuple[Damage, ...]
    cut: int
    lost: tuple[range, ...]
    open_from: int | None

    @property
    def damaged(self) -> str:
        """Damaged places as text, or an empty string."""
        if not self.damage:
            return ""
        first, more = self.damage[0], len(self.damage) - 1
        others = f", and {more:,} more places" if more > 1 else ", and one more place"
        where = f"bytes {first.begin:,} to {first.end - 1:,} ({first.why})"
        return where + (others if more else "")

    @property
    def frames(self) -> str:
        """Frames lost by the damage as text, or an empty string."""
        if not self.damage:
            return ""
        named = [_range_text(frames) for frames in self.lost[:SHOWN]]
        if len(self.lost) > SHOWN:
            named.append(f"{sum(map(len, self.lost[SHOWN:])):,} more")
        if self.open_from is not None:
            named.append(f"all from frame {self.open_from:,} on")
        return ", ".join(named) or "no frame"

    def message(self, path: Path) -> str:
        """One line about the damage of the record at a path, or an empty string."""
        return f"{path} is damaged: {self.damaged}; lost: {self.frames}" if self.damage else ""

    def plain(self) -> dict[str, Any]:
        """As a JSON object; `lost_from` is null if the end is intact."""
        return {
            "damage": [{"begin": d.begin, "end": d.end, "why": d.why} for d in self.damage],
            "cut": self.cut,
            "lost": [[frames.start, frames.stop - 1] for frames in self.lost],
            "lost_from": self.open_from,
        }


def _range_text(frames: range) -> str:
    if len(frames) == 1:
        return f"frame {frames.start:,}"
    return f"frames {frames.start:,} to {frames.stop - 1:,}"
