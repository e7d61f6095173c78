"""The record of a run, if one is wanted: made where its frames are."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.messages import Readings
from minerva_bus.launch.resuming import Resumed, differing, option_text
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.settings.kinds import ALL

if TYPE_CHECKING:
    from minerva_bus.log.description import Description
    from minerva_bus.log.reader import Record


class Recording(Protocol):
    """What is told of a run as it goes on; `topics` are those that it wants to hear of."""

    topics: tuple[str, ...]

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over."""
        ...

    def help(self) -> None:
        """Nobody waits for the caller of `frame` just now: what is left to do may be done."""
        ...

    def said(self, member: str, text: str) -> None:
        """Something was said of a member, or printed by it."""
        ...

    def sensed(self, told: Readings) -> None:
        """Something came on a sensor topic; as `heard` from any thread."""
        ...

    def heard(self, topic: str, member: str, data: bytes) -> None:
        """Something came on a sensor topic, over the bus."""
        ...

    def close(self) -> None:
        """The run is over."""
        ...


class Nothing:
    """No record is wanted."""

    topics: tuple[str, ...] = ()

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over."""

    def help(self) -> None:
        """There is time."""

    def said(self, member: str, text: str) -> None:
        """Something was said of a member."""

    def sensed(self, told: Readings) -> None:
        """Something came on a sensor topic."""

    def heard(self, topic: str, member: str, data: bytes) -> None:
        """Something came on a sensor topic, over the bus."""

    def close(self) -> None:
        """The run is over."""


class InFile:
    """A record in a file. Raises RecordError, and MisuseError where mcap is not installed."""

    def __init__(
        self,
        file: WorldFile,
        algorithm: FrameAlgorithm,
        say: Callable[[str], None],
        again: bool,
    ) -> None:
        from minerva_bus.log.description import Description
        from minerva_bus.log.errors import RecordError
        from minerva_bus.log.reader import Record

        self._algorithm = algorithm
        self._say = say
        self.topics = file.record.topics
        self._next = algorithm.frame
        origin = _origin(file, again)
        if origin is not None:
            with Record(origin) as past:
                for what in differing(file.world, past.description.world) if again else ():
                    raise RecordError(f"{origin}: it is the record of another world: {what}")
                self._next = past.end()[0].frame
                told = _retold(past.description, file)
                # What a killed coordinator has left is all in the new one.
                self._record(file, told, say, past, keep_old=not again)
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
        *,
        keep_old: bool = True,
    ) -> None:
        from minerva_bus.log.recorder import Recorder

        self._began = time.monotonic() - (time.time_ns() - told.began) / 1e9
        self._recorder = Recorder(
            Path(file.record.path),
            told,
            flush_seconds=file.record.flush,
            durable=file.record.durable,
            say=say,
            past=past,
            keep_old=keep_old,
        )

    def frame(self, done: s.FrameDone) -> None:
        """A frame is over."""
        if done.frame < self._next:
            return  # It is in the record that a killed coordinator has left.
        if done.frame > self._next:
            self._say(f"frames {self._next} to {done.frame - 1} are not in the record")
        self._next = done.frame + 1
        algorithm = self._algorithm
        checkpoint = algorithm.checkpoint
        self._recorder.frame(done, algorithm.scene, self._seconds(), checkpoint=checkpoint)

    def help(self) -> None:
        """Nobody waits for the caller of `frame` just now."""
        self._recorder.help()

    def said(self, member: str, text: str) -> None:
        """Something was said of a member, or printed by it."""
        self._recorder.log(member, text, self._seconds())

    def sensed(self, told: Readings) -> None:
        """Something came on a sensor topic; from any thread."""
        if ALL in self.topics or told.topic in self.topics:
            self._recorder.sensed(told, self._seconds())

    def heard(self, topic: str, member: str, data: bytes) -> None:
        """Something came on a sensor topic, over the bus; from any thread."""
        self._recorder.heard(topic, member, data, self._seconds())

    def close(self) -> None:
        """The run is over."""
        self._recorder.close()

    def _seconds(self) -> float:
        return time.monotonic() - self._began


def _origin(file: WorldFile, again: bool) -> Path | None:
    """The record that this one goes on from."""
    if again:
        return Path(file.record.path)
    return file.origin if isinstance(file, Resumed) else None


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


def recording(
    file: WorldFile, algorithm: FrameAlgorithm, say: Callable[[str], None], *, again: bool = False
) -> Recording:
    """The record that a world file or a command line asks for.

    `again`: another one was begun by a coordinator that was killed; it goes on, if it can.
    """
    if not file.record.path:
        return Nothing()
    from minerva_bus.log.errors import RecordError

    try:
        return InFile(file, algorithm, say, again)
    except RecordError as error:
        if not again:
            raise
        say(f"{error}; the world goes on without a record")
        return Nothing()


def check_record(file: WorldFile) -> None:
    """Raises MisuseError where a record is wanted that cannot be made here."""
    if file.record.path:
        from minerva_bus.log.extra import check_installed

        check_installed()
