"""The journal of a region: in a file, or kept by the coordinator of the world.

A process that replaces one that was killed reads the journal, runs its frames again and continues.
A journal that begins with a checkpoint has later frames only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

from minerva_bus.regions.journal import CHECKPOINT, encoded, entries
from minerva_bus.runtime.region_links import ParcelArrived

CHECKPOINT_BYTES: Final = 4 << 20
"""Bytes of a journal, beyond the size of a checkpoint, after which a checkpoint replaces it."""

MIN_CHECKPOINT_FRAMES: Final = 10
MAX_CHECKPOINT_FRAMES: Final = 200
"""Frames of a journal after which a checkpoint replaces it, at least and at most.

While a process repeats them, other regions wait. A checkpoint of some ten thousand bytes takes a
tenth of the time of a frame, so for ten frames it costs a hundredth.
"""

MAX_BYTES: Final = 64 << 20
"""Bytes after which a journal without checkpoints is given up: a world without an end would fill
the disk, and repeating its frames would take as long as the run."""


class RegionJournal(ABC):
    """The messages of a region since its last checkpoint, or since frame 0.

    `bytes_per_frame`: those of checkpoints, so that large ones are rare.
    """

    bytes_per_frame: int

    def __init__(self) -> None:
        self._frames = self._size = self._checkpoint_size = 0

    @property
    @abstractmethod
    def exists(self) -> bool:
        """Whether there is a journal to continue from, which may be empty."""

    @abstractmethod
    def read(self) -> Iterator[ParcelArrived]:
        """The messages as they arrived; the first entry may be a checkpoint."""

    @abstractmethod
    def open(self) -> None:
        """Begin to write, after the last entry."""

    @abstractmethod
    def write(self, arrived: ParcelArrived) -> None:
        """Write a message before the next parcel of the region acknowledges it."""

    @abstractmethod
    def begin_again(self, checkpoint: bytes) -> None:
        """Replace all messages by a checkpoint."""

    @property
    @abstractmethod
    def is_written(self) -> bool:
        """Whether messages are written."""

    def continue_from(self, kept: bytes | None) -> None:
        """Take the journal that the coordinator has sent, if it keeps one for this region."""

    def unreported(self) -> bytes:
        """Remove and return the entries that the next report must have."""
        return b""

    def is_due(self) -> bool:
        """Whether a checkpoint is due before the frame that begins."""
        if not self.is_written:
            return False
        self._frames += 1
        # A checkpoint that is longer than what it replaces would take more time than it saves.
        is_long = self._size > CHECKPOINT_BYTES + self._checkpoint_size
        frames = max(MIN_CHECKPOINT_FRAMES, self._checkpoint_size // self.bytes_per_frame)
        return is_long or self._frames > min(frames, MAX_CHECKPOINT_FRAMES)

    def _note_checkpoint(self, checkpoint: bytes) -> None:
        self._checkpoint_size, self._frames, self._size = len(checkpoint), 0, 0


class FileJournal(RegionJournal):
    """A journal in a file, which does not exist any more once it has been given up."""

    bytes_per_frame = 64 << 10

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._file: BinaryIO | None = None

    @property
    def exists(self) -> bool:
        return self._path.exists()

    @property
    def is_written(self) -> bool:
        return self._file is not None

    def read(self) -> Iterator[ParcelArrived]:
        if not self.exists:
            return
        whole = 0
        with self._path.open("r+b") as file:
            for source, data in entries(file.read()):
                whole += len(encoded(source, data))
                yield ParcelArrived(source, data)
            # The process was killed while it wrote the last entry.
            file.truncate(whole)

    def open(self) -> None:
        self._file = self._path.open("ab", buffering=0)
        self._size = self._file.tell()

    def write(self, arrived: ParcelArrived) -> None:
        """Write a message that survives the process, or give up a journal that is too long."""
        if self._file is None:
            return
        entry = encoded(arrived.source, arrived.data)
        self._file.write(entry)
        self._size += len(entry)
        if self._size > MAX_BYTES:
            self._file.close()
            self._file = None
            self._path.unlink()

    def begin_again(self, checkpoint: bytes) -> None:
        if self._file is not None:
            self._file.close()
        draft = self._path.with_suffix(".draft")
        draft.write_bytes(encoded(CHECKPOINT, checkpoint))
        # At once, so that a process that is killed here leaves one of the two files.
        draft.rename(self._path)
        self.open()
        self._note_checkpoint(checkpoint)


class ReportedJournal(RegionJournal):
    """A journal that travels to the coordinator of the world with the reports of the region.

    A process on any machine can continue from it. A checkpoint takes its share of a line between
    machines.
    """

    bytes_per_frame = 4 << 10

    def __init__(self) -> None:
        super().__init__()
        self._kept: bytes | None = None
        self._unreported = bytearray()
        self._is_open = False

    @property
    def exists(self) -> bool:
        return self._kept is not None

    @property
    def is_written(self) -> bool:
        return self._is_open

    def read(self) -> Iterator[ParcelArrived]:
        for source, data in entries(self._kept or b""):
            # The report of a repeated frame has them again: the successor of a coordinator may
            # lack the former report. Those of no frame yet are then in the journal twice.
            self._unreported += encoded(source, data)
            yield ParcelArrived(source, data)

    def open(self) -> None:
        self._is_open, self._size = True, len(self._kept or b"")
        self._kept = None

    def continue_from(self, kept: bytes | None) -> None:
        self._kept = kept

    def write(self, arrived: ParcelArrived) -> None:
        if self._is_open:
            entry = encoded(arrived.source, arrived.data)
            self._unreported += entry
            self._size += len(entry)

    def begin_again(self, checkpoint: bytes) -> None:
        self._unreported = bytearray(encoded(CHECKPOINT, checkpoint))
        self._note_checkpoint(checkpoint)

    def unreported(self) -> bytes:
        reported, self._unreported = bytes(self._unreported), bytearray()
        return reported
