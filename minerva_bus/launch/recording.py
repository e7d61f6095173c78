"""The record of a run, if one is wanted: made where its frames are."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.resuming import Resumed, option_text
from minerva_bus.launch.worldfile import WorldFile

if TYPE_CHECKING:
    from minerva_bus.record.description import Description
    from minerva_bus.record.reader import Record


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
        from minerva_bus.record.reader import Record

        self._algorithm = algorithm
        if isinstance(file, Resumed):
            with Record(file.origin) as past:
                self._record(file, _retold(past.description, file), say, past)
            return
        options = {name: option_text(value) for name, value in file.options.items()}
        began, path = time.time_ns(), str(file.path)
        told = Description(file.world, file.text, file.rate, options, began=began, path=path)
        self._record(file, told, say)

    def _record(
        self,
        file: WorldFile,
        told: Description,
        say: Callable[[str], None],
        past: Record | None = None,
    ) -> None:
        from minerva_bus.record.recorder import Recorder

        self._began = time.monotonic() - (time.time_ns() - told.began) / 1e9
        self._recorder = Recorder(
            Path(file.record.path),
            told,
            flush_seconds=file.record.flush,
            durable=file.record.durable,
            say=say,
            past=past,
        )

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over."""
        algorithm = self._algorithm
        checkpoint = algorithm.checkpoint
        self._recorder.frame(done.record, algorithm.scene, self._seconds(), checkpoint=checkpoint)

    def said(self, member: str, text: str) -> None:
        """Something was said of a member, or printed by it."""
        self._recorder.log(member, text, self._seconds())

    def close(self) -> None:
        """The run is over."""
        self._recorder.close()

    def _seconds(self) -> float:
        return time.monotonic() - self._began


def _retold(told: Description, file: WorldFile) -> Description:
    """What a record says of its world when it goes on, perhaps to another end."""
    wanted = file.world
    world = replace(
        told.world,
        name=wanted.name,
        frames=wanted.frames,
        until=wanted.until,
        expected=wanted.expected,
    )
    options = {name: option_text(value) for name, value in file.options.items()}
    return replace(
        told, world=world, file=file.text, rate=file.rate, options=options, path=str(file.path)
    )


def recording(file: WorldFile, algorithm: FrameAlgorithm, say: Callable[[str], None]) -> Recording:
    """The record that a world file or a command line asks for."""
    return InFile(file, algorithm, say) if file.record.path else Nothing()


def check_record(file: WorldFile) -> None:
    """Raises MisuseError where a record is wanted that cannot be made here."""
    if file.record.path:
        from minerva_bus.record.extra import check_installed

        check_installed()
