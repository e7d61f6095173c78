"""Copies the intact parts of a damaged record to a new one: `minerva recover`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.log.errors import RecordError
from minerva_bus.log.losses import Losses
from minerva_bus.log.reader import Record
from minerva_bus.log.writer import RecordWriter
from minerva_bus.outputs import check_new, replacing
from minerva_bus.wording import counted


@dataclass(frozen=True, slots=True)
class Recovered:
    """Result of a recovery: the new record, its number of frames, and the losses."""

    path: Path
    frames: int
    losses: Losses

    def plain(self) -> dict[str, Any]:
        """The result as a JSON object."""
        return {"record": str(self.path), "frames": self.frames} | self.losses.plain()

    def lines(self) -> list[str]:
        """The result as lines of text."""
        losses = self.losses
        shown = [f"{self.path}: {counted(self.frames, 'frame')}"]
        # The reader warns of damage.
        if losses.cut and not losses.damage:
            shown.append(f"cut off: its last {losses.cut:,} bytes belong to no complete chunk")
        elif not losses.damage:
            shown.append("nothing was damaged")
        return shown


def recovered_name(path: Path) -> Path:
    """Default path of a recovered record."""
    return path.with_name(f"{path.stem}.recovered{path.suffix}")


def recover(path: Path, into: Path) -> Recovered:
    """Copy the intact parts of a record to a new, complete record.

    Raises RecordError if no frame is intact, and MisuseError if the file exists or cannot be
    written.
    """
    with Record(path) as record:
        check_new(into, "record")
        losses = record.losses()
        if losses.damage and next(record.frames(), None) is None:
            raise RecordError(f"{path}: no frame in it is intact")
        try:
            # A recovery that fails leaves no half-written record.
            with replacing(into) as stream:
                writer = RecordWriter(stream, record.description, record)
                writer.finish()
        except OSError as error:
            raise MisuseError(f"{into}: cannot be written: {error.strerror}") from None
    return Recovered(into, writer.frames, losses)
