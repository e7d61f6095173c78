"""What a region has received, as entries of a journal, from which its frames can be repeated.

    entry = source (4 bytes, little-endian), length of the data (4 bytes), data

A region depends on nothing but the world and these messages: parcels of other regions, and the
coordinator's requests and orders. A checkpoint, which is always the first entry, replaces those
before it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import Final, TypeAlias

COORDINATOR: Final = (1 << 32) - 1
CHECKPOINT: Final = (1 << 32) - 2
"""Stand for a region in entries with messages of the coordinator, and with a checkpoint."""

JOURNAL: Final = "journal"
"""Key in the saved data of a region's `ticked` and `welcome`: the entries since the last report,
and all of them."""

PROCESS: Final = "process"
"""Key in the saved data of a region's `welcome` and `ticked`: the number of the region's process,
which tells its reports from those that a former process had sent before it ended."""

_HEAD: Final = struct.Struct("<II")

Entry: TypeAlias = tuple[int, bytes]
"""The source of a message, and its bytes."""


def encoded(source: int, data: bytes) -> bytes:
    """An entry as bytes."""
    return _HEAD.pack(source, len(data)) + data


def entries(journal: bytes) -> Iterator[Entry]:
    """The whole entries of a journal, whose last entry may be cut off."""
    begin = 0
    while begin + _HEAD.size <= len(journal):
        source, length = _HEAD.unpack_from(journal, begin)
        begin += _HEAD.size
        if begin + length > len(journal):
            return
        yield source, journal[begin : begin + length]
        begin += length


class KeptJournals:
    """The journals of regions that have no file for them, as the coordinator keeps them."""

    def __init__(self, saved: Mapping[str, bytes]) -> None:
        """`saved` is what `all` has returned."""
        self._journals = {region: bytearray(journal) for region, journal in saved.items()}

    def add(self, region: str, reported: bytes) -> None:
        """Add the entries of a report."""
        source, _ = next(entries(reported), (0, b""))
        if source == CHECKPOINT:
            self._journals[region] = bytearray()
        self._journals.setdefault(region, bytearray()).extend(reported)

    def of(self, region: str) -> bytes | None:
        """The journal of a region; None if it has not reported any entry."""
        journal = self._journals.get(region)
        return None if journal is None else bytes(journal)

    def all(self) -> Mapping[str, bytes]:
        """All journals, by region."""
        return {region: bytes(journal) for region, journal in self._journals.items()}
