"""Damage of a record that costs no frame, because no reader of ours uses these bytes.

Other tools for MCAP find messages by the indexes and times of chunks, and show the beginning. After
these, the checksum of all data shows what is left: a bit that keeps each part valid.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from io import BytesIO
from typing import IO, Final

from minerva_bus.log.channels import PROFILE
from minerva_bus.log.chunks import (
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    RECORD,
    Damage,
    Losses,
    ScannedFile,
    scan,
    split,
)
from minerva_bus.log.entries import RecordHeader
from minerva_bus.log.record import Record

_MESSAGE: Final = struct.Struct("<HIQ")
"""Channel, number and time of a message."""

_METADATA: Final = 0x0C
_DATA_END: Final = struct.Struct("<BQI")
_LIBRARY: Final = re.compile(r"minerva-bus \S+")
_BLOCK: Final = 1 << 20


def all_losses(record: Record) -> Losses:
    """The losses of a record, with the damage that no reader meets."""
    losses = record.losses()
    with record.path.open("rb") as file:
        scanned = scan(file, record.size)
        unmet = [
            *_wrong_beginning(file, scanned, record.description),
            *_wrong_chunks(file, scanned, losses),
        ]
        met = {damage.begin for damage in losses.damage}
        unmet = [damage for damage in unmet if damage.begin not in met]
        if not met and not unmet:
            unmet = [*_wrong_data(file, scanned)]
    return replace(
        losses, damage=tuple(sorted((*losses.damage, *unmet), key=lambda each: each.begin))
    )


def _wrong_beginning(
    file: IO[bytes], scanned: ScannedFile, description: RecordHeader
) -> Iterator[Damage]:
    """Records before the first chunk that are not those of this world."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Header, Metadata

    world = description.world
    named = {"world": world.name, "seed": str(world.seed), "dt": repr(world.dt)}
    file.seek(0)
    data = file.read(scanned.places[0].begin)
    for opcode, begin, end in _records(data, len(MAGIC)):
        stream = ReadDataStream(BytesIO(data[begin:end]))
        right = True
        try:
            if opcode == HEADER:
                header = Header.read(stream)
                right = header.profile == PROFILE and bool(_LIBRARY.fullmatch(header.library))
            elif opcode == _METADATA:
                metadata = Metadata.read(stream)
                right = (metadata.name, metadata.metadata) == ("minerva", named)
        except Exception:  # mcap raises various exceptions for invalid data
            right = False
        if not right:
            yield Damage(begin - RECORD.size, end, "not the beginning of this record")


def _wrong_chunks(file: IO[bytes], scanned: ScannedFile, losses: Losses) -> Iterator[Damage]:
    """Wrong times of intact chunks, and records after them that are not their indexes."""
    damaged = sorted(damage.begin for damage in losses.damage)
    ends = [*(place.begin for place in scanned.places[1:]), scanned.end]
    for place, end in zip(scanned.places, ends, strict=True):
        if place.begin not in damaged:
            end = min([end, *(at for at in damaged if at > place.begin)])
            file.seek(place.begin)
            yield from _wrong(file.read(end - place.begin), place.begin)


def _wrong(data: bytes, offset: int) -> Iterator[Damage]:
    """The wrong parts of a chunk's record and those after it, at this byte of the file."""
    (_, begin, end), *others = _records(data)
    times, right = _right(data[begin:end])
    if data[begin : begin + len(times)] != times:
        yield Damage(offset, offset + begin + len(times), "not the times of its chunk")
    for opcode, begin, end in others:
        if opcode == MESSAGE_INDEX and data[begin:end] not in right:
            yield Damage(offset + begin - RECORD.size, offset + end, "not the index of its chunk")


def _wrong_data(file: IO[bytes], scanned: ScannedFile) -> Iterator[Damage]:
    """All data, if their checksum is wrong; older records and those that were cut off have none."""
    end = scanned.end - _DATA_END.size
    file.seek(max(0, end))
    last = file.read(_DATA_END.size)
    if not scanned.complete or not (wanted := _DATA_END.unpack(last)[2]):
        return
    file.seek(0)
    crc, left = 0, end
    for block in iter(partial(file.read, _BLOCK), b""):
        crc, left = zlib.crc32(block[: max(0, left)], crc), left - len(block)
    if crc != wanted:
        yield Damage(0, scanned.end, "the checksum of all data is wrong")


def _records(data: bytes, at: int = 0) -> Iterator[tuple[int, int, int]]:
    """Opcode and body range of each record, of which the last one may be cut off."""
    while at + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, at)
        begin, at = at + RECORD.size, at + RECORD.size + length
        yield opcode, begin, at


def _right(chunk: bytes) -> tuple[bytes, set[bytes]]:
    """The first and the last time of a chunk, and its indexes.

    An index has for each channel the times of its messages, and where they are.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    read = Chunk.read(ReadDataStream(BytesIO(chunk)))
    data = get_chunk_data_stream(read)[0].read(read.uncompressed_size)
    entries: dict[int, bytes] = {}
    times: list[int] = []
    for opcode, begin, _ in split(data):
        if opcode == MESSAGE:
            channel, _, time = _MESSAGE.unpack_from(data, begin)
            entry = struct.pack("<QQ", time, begin - RECORD.size)
            entries[channel] = entries.get(channel, b"") + entry
            times.append(time)
    span = struct.pack("<QQ", min(times, default=0), max(times, default=0))
    indexes = {
        channel: struct.pack("<HI", channel, len(entry)) for channel, entry in entries.items()
    }
    return span, {head + entries[channel] for channel, head in indexes.items()}
