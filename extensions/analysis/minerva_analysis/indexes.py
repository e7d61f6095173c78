"""The indexes of messages between the chunks of a record, checked.

No reader of ours uses them, so their damage costs no frame; other tools for MCAP find messages by
them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Final

from minerva_bus.log.chunks import MESSAGE, MESSAGE_INDEX, RECORD, Damage, Losses, scan, split

_MESSAGE: Final = struct.Struct("<HIQ")
"""Channel, number and time of a message."""


def wrong_indexes(path: Path, losses: Losses) -> Iterator[Damage]:
    """Records between intact chunks that are not the indexes of the messages before them.

    `losses`: of this record; bytes between chunks that are no records are among them.
    """
    damaged = sorted(damage.begin for damage in losses.damage)
    with path.open("rb") as file:
        scanned = scan(file, path.stat().st_size)
        ends = [*(place.begin for place in scanned.places[1:]), scanned.end]
        for place, end in zip(scanned.places, ends, strict=True):
            if place.begin not in damaged:
                end = min([end, *(at for at in damaged if at > place.begin)])
                file.seek(place.begin)
                yield from _wrong(file.read(end - place.begin), place.begin)


def _wrong(data: bytes, offset: int) -> Iterator[Damage]:
    """The wrong indexes in a chunk's record and those after it, at this byte of the file."""
    (_, begin, end), *others = _records(data)
    right = _right(data[begin:end])
    for opcode, begin, end in others:
        if opcode == MESSAGE_INDEX and data[begin:end] not in right:
            yield Damage(offset + begin - RECORD.size, offset + end, "not the index of its chunk")


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode and body range of each record, of which the last one may be cut off."""
    at = 0
    while at + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, at)
        begin, at = at + RECORD.size, at + RECORD.size + length
        yield opcode, begin, at


def _right(chunk: bytes) -> set[bytes]:
    """The indexes of a chunk: for each channel the times of its messages, and where they are."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    read = Chunk.read(ReadDataStream(BytesIO(chunk)))
    data = get_chunk_data_stream(read)[0].read(read.uncompressed_size)
    entries: dict[int, bytes] = {}
    for opcode, begin, _ in split(data):
        if opcode == MESSAGE:
            channel, _, time = _MESSAGE.unpack_from(data, begin)
            entry = struct.pack("<QQ", time, begin - RECORD.size)
            entries[channel] = entries.get(channel, b"") + entry
    return {struct.pack("<HI", channel, len(entry)) + entry for channel, entry in entries.items()}
