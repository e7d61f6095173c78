"""The record of a run, if one is wanted: made where its frames are."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.worldfile import WorldFile


class Recording(Protocol):
    """What is told of a run as it goes on."""

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over."""
        ...

    def said(self, member: str, text: str) -> None:
        """Something was said of a member, or printed by it."""
        ...

    def close(self) -> None:
        """The run is over."""
        ...


class Nothing:
    """No record is wanted."""

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over."""

    def said(self, member: str, text: str) -> None:
        """Something was said of a member."""

    def close(self) -> None:
        """The run is over."""


class InFile:
    """A record in a file. Raises RecordError, and MisuseError where mcap is not installed."""

    def __init__(
        self, file: WorldFile, algorithm: FrameAlgorithm, say: Callable[[str], None]
    ) -> None:
        from minerva_bus.record.description import Description
        from minerva_bus.record.recorder import Recorder

        options = {name: str(value) for name, value in file.options.items()}
        described = Description(file.world, file.text, file.rate, options, began=time.time_ns())
        self._algorithm = algorithm
        self._began = time.monotonic()
        self._recorder = Recorder(
            Path(file.record.path),
            described,
            flush_seconds=file.record.flush,
            durable=file.record.durable,
            say=say,
        )

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over."""
        self._recorder.frame(done.record, self._algorithm.scene, self._seconds())

    def said(self, member: str, text: str) -> None:
        """Something was said of a member, or printed by it."""
        self._recorder.log(member, text, self._seconds())

    def close(self) -> None:
        """The run is over."""
        self._recorder.close()

    def _seconds(self) -> float:
        return time.monotonic() - self._began


def recording(file: WorldFile, algorithm: FrameAlgorithm, say: Callable[[str], None]) -> Recording:
    """The record that a world file or a command line asks for."""
    return InFile(file, algorithm, say) if file.record.path else Nothing()


def check_record(file: WorldFile) -> None:
    """Raises MisuseError where a record is wanted that cannot be made here."""
    if file.record.path:
        from minerva_bus.record.extra import check_installed

        check_installed()
