"""Frames of a running world that its record on the disk has."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

from minerva_bus.errors import MisuseError, RecordError
from minerva_bus.log.record import Record

RECORD_SECONDS: Final = 10.0
"""Longest time, in seconds, that a running world takes to write its frames to the disk."""

POLL_SECONDS: Final = 0.05


def wait_for_frame(path: Path, frame: int) -> None:
    """Wait until a frame of a record is on the disk. Raises MisuseError after RECORD_SECONDS."""
    until = time.monotonic() + RECORD_SECONDS
    while (last := _last(path)) < frame:
        if time.monotonic() > until:
            raise MisuseError(
                f"{path} ends with frame {last}, not {frame}, after {RECORD_SECONDS:g} s; flush it"
                " more often (--flush), or choose an earlier frame"
            )
        time.sleep(POLL_SECONDS)


def last_written(path: Path) -> int:
    """The frame whose initial string is the last on the disk; -1 if the record cannot be read."""
    try:
        return _last(path)
    except RecordError:
        return -1


def _last(path: Path) -> int:
    with Record(path) as record:
        return record.last()[0]
