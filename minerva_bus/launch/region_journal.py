"""The journal of a region: the messages that it has received, from which frames can be repeated.

A region depends on nothing but the world and these messages: parcels of other regions, and the
coordinator's requests and orders. So a process that replaces one that was killed reads the journal,
runs its frames again and continues. A journal that begins with a checkpoint has later frames only.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

from minerva_bus.runtime.region_links import ParcelArrived

CHECKPOINT_BYTES: Final = 16 << 20
CHECKPOINT_FRAMES: Final = 200
"""Bytes and frames of a journal after which a checkpoint replaces it: repeating them takes time."""

MAX_BYTES: Final = 64 << 20
"""Bytes after which a journal without checkpoints is given up: a world without an end would fill
the disk, and repeating its frames would take as long as the run."""

COORDINATOR: Final = (1 << 32) - 1
CHECKPOINT: Final = (1 << 32) - 2
"""Stand for a region in entries with messages of the coordinator, and with a checkpoint."""

_HEAD: Final = struct.Struct("<II")


class RegionJournal:
    """A journal in a file, which does not exist any more once it has been given up."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self._begin = 0
        self._frames = 0

    @property
    def exists(self) -> bool:
        """Whether there is a file, which may be empty."""
        return self._path.exists()

    def read(self) -> Iterator[ParcelArrived]:
        """The messages of the file as they arrived; the first entry may be a checkpoint."""
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
        if self._file.tell() - self._begin > MAX_BYTES:
            self._file.close()
            self._file = None
            self._path.unlink()

    def is_due(self) -> bool:
        """Whether a checkpoint is due before the frame that begins."""
        if self._file is None:
            return False
        self._frames += 1
        size = self._file.tell() - self._begin
        # A checkpoint that is longer than what it replaces would take more time than it saves.
        return size > CHECKPOINT_BYTES + self._begin or self._frames > CHECKPOINT_FRAMES

    def begin_again(self, checkpoint: bytes) -> None:
        """Replace all messages by a checkpoint."""
        if self._file is not None:
            self._file.close()
        draft = self._path.with_suffix(".draft")
        draft.write_bytes(_HEAD.pack(CHECKPOINT, len(checkpoint)) + checkpoint)
        # At once, so that a process that is killed here leaves one of the two files.
        draft.rename(self._path)
        self.open()
        self._begin, self._frames = len(checkpoint), 0
