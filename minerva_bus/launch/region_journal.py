"""The journal of a region: the messages that it has received, from which frames can be repeated.

A region depends on nothing but the world and these messages: parcels of other regions, and the
coordinator's requests and orders. So a process that replaces one that was killed reads the journal,
runs all frames again and continues.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

from minerva_bus.runtime.region_links import ParcelArrived

MAX_BYTES: Final = 64 << 20
"""Size at which a journal is given up, because the file of a world without an end would fill the
disk, and repeating its frames would take as long as the run."""

COORDINATOR: Final = (1 << 32) - 1
"""Stands for a region in entries with messages of the coordinator."""

_HEAD: Final = struct.Struct("<II")


class RegionJournal:
    """A journal in a file, which does not exist any more once it has been given up."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO | None = None

    @property
    def exists(self) -> bool:
        """Whether there is a file, which may be empty."""
        return self._path.exists()

    def read(self) -> Iterator[ParcelArrived]:
        """The messages of the file, in the order of their arrival."""
        if not self.exists:
            return
        whole = 0
        with self._path.open("r+b") as file:
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                source, length = _HEAD.unpack(head)
                data = file.read(length)
                if len(data) < length:
                    break
                whole = file.tell()
                yield ParcelArrived(source, data)
            # The process was killed while it wrote the last entry.
            file.truncate(whole)

    def open(self) -> None:
        """Begin to write, at the end of the file."""
        self._file = self._path.open("ab", buffering=0)

    def write(self, arrived: ParcelArrived) -> None:
        """Write a message that survives the process, or give up a journal that is too long."""
        if self._file is None:
            return
        self._file.write(_HEAD.pack(arrived.source, len(arrived.data)) + arrived.data)
        if self._file.tell() > MAX_BYTES:
            self._file.close()
            self._file = None
            self._path.unlink()
