"""Playback of recordings at their original or another speed."""

from __future__ import annotations

import math
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import dropwhile, tee
from pathlib import Path
from typing import ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.files import is_stream
from minerva_bus.grammar.events import Event
from minerva_bus.log.recordings import (
    Compensator,
    Recorded,
    Recording,
    RecordingClock,
    RecordingError,
)
from minerva_bus.world.readings import Mount
from minerva_bus.world.services import Emit
from minerva_services.bridging import Bridge, Source, SourceError
from minerva_services.bridging.bridge import SourceItem

MAX_GAP_SECONDS: Final = 5.0
"""Maximum gap in recorded seconds that playback waits between readings."""

LAST_SECONDS: Final = 0.1
"""Duration of a loop in recorded seconds if all readings have the same time."""


NOT_CORRECTED: Final = "scans not corrected"
WHY_NOT_CORRECTED: Final = (
    "a scan is not corrected for the robot's motion: no odometry covers its time"
)


def due_times(stamps: Iterable[float], speed: float) -> Iterator[float]:
    """When each reading is due, in seconds after the first, given all stamps in order.

    Never decreasing: a late reading is due together with its predecessor. A gap of more than
    MAX_GAP_SECONDS takes that long, and a step back of the clock no time; playback continues from
    there. With speed 0 everything is due immediately.
    """
    due, clock = 0.0, RecordingClock()
    for stamp in stamps:
        passed = clock.advance(stamp)
        if speed:
            due += min(passed, MAX_GAP_SECONDS) / speed
        yield due


@dataclass(frozen=True, slots=True)
class PlaybackPace:
    """How a recording is played. Raises MisuseError.

    Args:
        speed: playback speed relative to the recording; 0: as fast as possible.
        loop: start over at the end.
        offset: seconds to skip at the start.

    """

    speed: float = 1.0
    loop: bool = False
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name, number in (("speed", self.speed), ("offset", self.offset)):
            if not 0 <= number < math.inf:
                raise MisuseError(f"{name} is {number}; expected a number from 0")


@dataclass(frozen=True, slots=True)
class MountOverride:
    """Overrides of a recording's sensor mount; None keeps the recorded value. Raises MisuseError.

    Args:
        mount_x: sensor position, metres ahead of the robot's centre; by default as recorded.
        mount_y: metres to the left, likewise.
        mount_angle: degrees, likewise.

    """

    mount_x: float | None = None
    mount_y: float | None = None
    mount_angle: float | None = None

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if value is not None and not (number and math.isfinite(value)):
                raise MisuseError(f"{name} is {value!r}; expected a number")

    def over(self, recorded: Mount) -> Mount:
        """The recorded mount with overrides applied."""
        return Mount(
            recorded.x if self.mount_x is None else float(self.mount_x),
            recorded.y if self.mount_y is None else float(self.mount_y),
            recorded.angle if self.mount_angle is None else float(self.mount_angle),
        )


def checked_offset(seconds: float) -> float:
    """Validate the option `time_offset`. Raises MisuseError."""
    if not math.isfinite(seconds):
        raise MisuseError(f"time_offset is {seconds}; expected seconds")
    return seconds


def item_of(recorded: Recorded) -> SourceItem:
    """What a bridge publishes of something recorded."""
    reading = recorded.reading
    return reading if isinstance(reading, Event) else (recorded.topic, reading)


class Player:
    """A source that plays a recording."""

    def __init__(
        self,
        recording: Recording,
        pace: PlaybackPace,
        time_offset: float = 0.0,
        uncorrected: Callable[[], None] = lambda: None,
        alone: float = LAST_SECONDS,
        why_empty: Callable[[], str] = str,
    ) -> None:
        """`time_offset` and `uncorrected` are those of a Compensator.

        `alone` is the duration of a loop, in recorded seconds, if all readings have the same time;
        `why_empty` returns the end of the error if there are none.
        """
        self._recording = recording
        self._pace = pace
        self._alone = alone
        self._compensation = time_offset, uncorrected
        self._why_empty = why_empty

    def read(self, stop: threading.Event) -> Iterator[SourceItem]:
        """The readings with their topics, each when it is due. Raises SourceError."""
        try:
            begin = time.monotonic()
            lasted = yield from self._round(begin, stop)
            while self._pace.loop and not stop.is_set():
                # Loops are scheduled by the clock, so processing time does not stretch them.
                begin = max(begin + lasted, time.monotonic() - lasted)
                if stop.wait(max(0.0, begin - time.monotonic())):
                    return
                lasted = yield from self._round(begin, stop)
        except RecordingError as error:
            raise SourceError(str(error)) from None

    def close(self) -> None:
        self._recording.close()

    def _round(self, begun: float, stop: threading.Event) -> Generator[SourceItem, None, float]:
        """Play once; the result is the time in seconds until the next loop starts."""
        readings = Compensator(*self._compensation).all(self._recording.readings())
        # `zip` advances both in step, so `tee` never buffers more than one reading.
        stamped, played = tee(_from(self._pace.offset, readings))
        stamps = (item.stamp for item in stamped)
        due, number = 0.0, 0
        for due, item in zip(due_times(stamps, self._pace.speed), played, strict=True):
            number += 1
            wait = begun + due - time.monotonic()
            if stop.wait(wait) if wait > 0 else stop.is_set():
                return 0.0
            yield item_of(item)
        if not number:
            offset = self._pace.offset
            after = f" after {offset:g} s; use a smaller offset" if offset else ""
            raise SourceError(f"nothing to play{after}{self._why_empty()}")
        return due + self._gap(due, number)

    def _gap(self, lasted: float, number: int) -> float:
        """Seconds between two loops: the mean gap between readings."""
        if not self._pace.speed:
            return 0.0
        return lasted / (number - 1) if lasted else self._alone / self._pace.speed


def _from(offset: float, readings: Iterator[Recorded]) -> Iterator[Recorded]:
    """The readings from `offset` seconds after the first."""
    clock = RecordingClock()

    def is_early(item: Recorded) -> bool:
        clock.advance(item.stamp)
        return clock.seconds < offset

    return dropwhile(is_early, readings)


class Playing(Bridge):
    """A bridge whose source is a recording in a file. Raises MisuseError."""

    reconnects = False
    source_option: ClassVar[str] = "file"

    def __init__(self, file: str, pace: PlaybackPace, time_offset: float = 0.0) -> None:
        super().__init__()
        self.source = file
        self._pace = pace
        self._time_offset = checked_offset(time_offset)
        if not Path(file).exists():
            raise MisuseError(f"file {file!r} does not exist; expected a recording, check the name")
        if is_stream(file):
            raise MisuseError(f"file {file!r} is a pipe or device; expected a recording")

    @abstractmethod
    def recording(self) -> Recording:
        """Open the recording. Raises RecordingError."""

    def open(self) -> Source:
        try:
            return Player(self.recording(), self._pace, self._time_offset, self._uncorrected)
        except RecordingError as error:
            raise SourceError(str(error)) from None

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Play it; errors are logged once, because a file does not recover."""
        try:
            super().run(emit, stop)
        except SourceError as error:
            self.failed = True
            self.count("failures")
            self._log(str(error))

    def _uncorrected(self) -> None:
        self.pass_over(NOT_CORRECTED, f"{self.source}: {WHY_NOT_CORRECTED}")
