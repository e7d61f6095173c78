"""Writing all that is intact in a damaged record into a new one: `minerva recover`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.log.losses import Losses
from minerva_bus.log.reader import Record
from minerva_bus.log.writer import RecordWriter
from minerva_bus.outputs import check_new, replacing
from minerva_bus.wording import counted


@dataclass(frozen=True, slots=True)
class Recovered:
    """A record that was written of what another one still had."""

    path: Path
    frames: int
    losses: Losses

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        return {"record": str(self.path), "frames": self.frames} | self.losses.plain()

    def lines(self) -> list[str]:
        """As a person reads it."""
        losses = self.losses
        shown = [f"{self.path}: {counted(self.frames, 'frame')}"]
        if losses.damage:
            shown += [f"damaged: {losses.damaged}", f"lost: {losses.frames}"]
        elif losses.cut:
            shown.append(f"cut off: its last {losses.cut:,} bytes are of no whole chunk")
        else:
            shown.append("nothing was damaged")
        return shown


def recovered_name(path: Path) -> Path:
    """Where a record is recovered to, if nobody says."""
    return path.with_name(f"{path.stem}.recovered{path.suffix}")


def recover(path: Path, into: Path) -> Recovered:
    """Write what is intact in a record into a new file, as a complete record.

    Raises RecordError where nothing can be used, and MisuseError where the file is there already
    or cannot be written.
    """
    with Record(path) as record:
        check_new(into, "record")
        losses = record.losses()
        try:
            with replacing(into) as stream:
                writer = RecordWriter(stream, record.description, record)
                writer.finish()
        except OSError as error:
            raise MisuseError(f"{into}: cannot be written: {error.strerror}") from None
    return Recovered(into, writer.frames, losses)
