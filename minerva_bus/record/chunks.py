"""The whole chunks of an MCAP file, also of one that was cut off anywhere.

A reader of MCAP files begins at their end, where the index is. A record whose world has crashed
has no end, so this one goes along the file from its beginning, over chunks without reading them.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from minerva_bus.outputs import note_read
from minerva_bus.record.channels import PROFILE
from minerva_bus.record.errors import RecordError
from minerva_bus.record.extra import check_installed

if TYPE_CHECKING:
    from mcap.records import Channel, Message

MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = struct.Struct("<BQ")
_TIMES: Final = struct.Struct("<QQ")
_HEADER, _FOOTER, _CHUNK, _MESSAGE_INDEX, _DATA_END = 0x01, 0x02, 0x06, 0x07, 0x0F
_PRIVATE: Final = 0x80


@dataclass(frozen=True, slots=True)
class Place:
    """Where a chunk lies: at byte `begin`; `first` and `last` are times in nanoseconds.

    `channels` are the ids of those that have messages in it; None where nobody knows.
    """

    begin: int
    first: int
    last: int
    channels: frozenset[int] | None


class Chunks:
    """The chunks of one file of ours. Raises RecordError where it is none.

    `complete`: it was finished; otherwise its world was killed or its disk was full, and what is
    missing is at most what came after the last flush. `size` is in bytes.
    """

    def __init__(self, path: Path) -> None:
        check_installed()
        self.path = path
        self.complete = False
        try:
            self._file = path.open("rb")
            note_read(path)
            self.size = path.stat().st_size
        except OSError as error:
            raise RecordError(f"{path}: {error.strerror}") from None
        try:
            self.places = self._scanned(self._file)
            self.topics = self._topics()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(self, topics: Collection[str], begin: int = 0) -> Iterator[tuple[str, Message]]:
        """Topic and message, in order, of some topics, from this chunk on."""
        for chunk in range(begin, len(self.places)):
            yield from self.messages_in(chunk, topics)

    def messages_in(self, chunk: int, topics: Collection[str]) -> Iterator[tuple[str, Message]]:
        """Topic and message, in order, of some topics, in this chunk."""
        wanted = {number: topic for number, topic in self.topics.items() if topic in topics}
        known = self.places[chunk].channels
        if known is not None and known.isdisjoint(wanted):
            return
        for one in self._records(self.places[chunk]):
            topic = wanted.get(getattr(one, "channel_id", -1))
            if topic is not None:
                yield topic, one

    def _topics(self) -> dict[int, str]:
        """All channels are in the first chunk."""
        if not self.places:
            raise RecordError(f"{self.path}: it was cut off before anything was in it")
        channels: list[Channel] = [one for one in self._records(self.places[0]) if _channel(one)]
        return {one.id: one.topic for one in channels}

    # --- the file ---

    def _scanned(self, file: IO[bytes]) -> list[Place]:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordError(f"{self.path}: this is no MCAP file")
        found: list[Place] = []
        indexed: set[int] = set()
        at = file.tell()
        while (head := self._head(file, at)) is not None:
            opcode, length, body = head
            if opcode == _HEADER:
                self._check_profile(body)
            elif opcode == _CHUNK:
                _note(found, indexed)
                first, last = _TIMES.unpack_from(body)
                found.append(Place(at, first, last, None))
            elif opcode == _MESSAGE_INDEX:
                indexed.add(int.from_bytes(body[:2], "little"))
            elif opcode == _DATA_END:
                self.complete = True
                _note(found, indexed)
                break
            at += _HEAD.size + length
        return found

    def _head(self, file: IO[bytes], at: int) -> tuple[int, int, bytes] | None:
        """Opcode, length and the first bytes of a record that is there as a whole."""
        file.seek(at)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        opcode, length = _HEAD.unpack(head)
        known = 0 < opcode <= _DATA_END or opcode >= _PRIVATE
        if not known or at + _HEAD.size + length > self.size:
            return None
        if opcode == _CHUNK and length < _TIMES.size:
            return None
        return opcode, length, file.read(min(length, 256))

    def _check_profile(self, body: bytes) -> None:
        size = int.from_bytes(body[:4], "little")
        profile = body[4 : 4 + size].decode("utf-8", "replace")
        if profile != PROFILE:
            raise RecordError(
                f"{self.path}: an MCAP file, but no record of Minerva Bus: its profile is"
                f" {profile[:40]!r}, not {PROFILE!r}"
            )

    def _records(self, place: Place) -> list[Any]:
        """All that is in a chunk; nothing where the last one of a file that was cut is torn."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk
        from mcap.stream_reader import breakup_chunk

        self._file.seek(place.begin + _HEAD.size)
        try:
            chunk = Chunk.read(ReadDataStream(self._file))
            return list(breakup_chunk(chunk, validate_crc=True))
        except Exception as error:
            if place is self.places[-1] and not self.complete and len(self.places) > 1:
                return []
            raise RecordError(
                f"{self.path}: the chunk at byte {place.begin} is damaged ({type(error).__name__})"
            ) from None


def _channel(record: Any) -> bool:
    return type(record).__name__ == "Channel"


def _note(found: list[Place], indexed: set[int]) -> None:
    """The index of the last chunk is known as a whole when what follows it begins."""
    if found and indexed:
        found[-1] = replace(found[-1], channels=frozenset(indexed))
    indexed.clear()
