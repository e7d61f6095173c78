"""Locates the chunks of an MCAP file, even if it is cut off or damaged.

MCAP readers start with the index at the end of a file. The record of a crashed world has no
end, so this scanner moves from record to record without reading chunks. After invalid data it
continues at the next complete chunk.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO, Final

from minerva_bus.log.errors import RecordError

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


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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
