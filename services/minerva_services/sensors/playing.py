"""Recordings, played into a world at the pace at which they were made, or at another one."""

from __future__ import annotations

import math
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from itertools import dropwhile, tee
from pathlib import Path
from typing import ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.world.compensation import Compensator
from minerva_bus.world.readings import Mount
from minerva_bus.world.recordings import Recorded, Recording, RecordingError
from minerva_bus.world.services import Emit
from minerva_services.bridging import Bridge, Source, SourceError
from minerva_services.bridging.bridge import Said

LONGEST_GAP: Final = 5.0
"""Recorded seconds that are waited for at most from one reading to the next."""

ALONE: Final = 0.1
"""Recorded seconds that a round lasts where all readings of a recording have one time."""


NOT_CORRECTED: Final = "scans not corrected"
WHY_NOT_CORRECTED: Final = (
    "a scan is not corrected for the robot's motion, for there is no odometry of its time"
)


def due_times(stamps: Iterable[float], speed: float) -> Iterator[float]:
    """When each reading is due, in seconds after the first, for the stamps of them all in order.

    Never earlier than the one before: what has an older stamp is due with what came before it. A
    jump of the clock, forward or back, by more than LONGEST_GAP lasts that long or no time, and
    the time goes on from there. With speed 0 all is due at once.
    """
    due, latest = 0.0, math.nan
    for stamp in stamps:
        passed = stamp - latest
        if passed > 0 and speed:
            due += min(passed, LONGEST_GAP) / speed
        if not -LONGEST_GAP <= passed <= 0 and math.isfinite(stamp):
            latest = stamp
        yield due


@dataclass(frozen=True, slots=True)
class Pace:
    """How to play: so many times as fast (0: as fast as it goes), from so many seconds on.

    Raises MisuseError.
    """

    speed: float = 1.0
    loop: bool = False
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name, number in (("speed", self.speed), ("offset", self.offset)):
            if not 0 <= number < math.inf:
                raise MisuseError(f"{name} is {number}; expected a number from 0")


@dataclass(frozen=True, slots=True)
class Mounting:
    """What overrides where a recording says that its sensors sit; None leaves it. See `Mount`.

    Raises MisuseError.
    """

    x: float | None = None
    y: float | None = None
    angle: float | None = None

    def __post_init__(self) -> None:
        for name, found in (("x", self.x), ("y", self.y), ("angle", self.angle)):
            number = isinstance(found, int | float) and not isinstance(found, bool)
            if found is not None and not (number and math.isfinite(found)):
                raise MisuseError(f"mount_{name} is {found!r}; expected a number")

    def over(self, recorded: Mount) -> Mount:
        """The recorded mount with what is overridden."""
        return Mount(
            recorded.x if self.x is None else float(self.x),
            recorded.y if self.y is None else float(self.y),
            recorded.angle if self.angle is None else float(self.angle),
        )


def checked_offset(seconds: float) -> float:
    """The option `time_offset`. Raises MisuseError."""
    if not math.isfinite(seconds):
        raise MisuseError(f"time_offset is {seconds}; expected seconds")
    return seconds


class Player:
    """A source that plays a recording."""

    def __init__(
        self,
        recording: Recording,
        pace: Pace,
        time_offset: float = 0.0,
        uncorrected: Callable[[], None] = lambda: None,
        alone: float = ALONE,
    ) -> None:
        """`time_offset` and `uncorrected` as a Compensator has them.

        `alone` is the recorded seconds of a round where all of a recording have one time.
        """
        self._recording = recording
        self._pace = pace
        self._alone = alone
        self._compensation = time_offset, uncorrected

    def read(self, stop: threading.Event) -> Iterator[Said]:
        """The readings with their topics, each when it is due. Raises SourceError."""
        try:
            begin = time.monotonic()
            lasted = yield from self._round(begin, stop)
            while self._pace.loop and not stop.is_set():
                # The next round is due by the clock, so rounds do not get longer by their work.
                begin = max(begin + lasted, time.monotonic() - lasted)
                if stop.wait(max(0.0, begin - time.monotonic())):
                    return
                lasted = yield from self._round(begin, stop)
        except RecordingError as error:
            raise SourceError(str(error)) from None

    def close(self) -> None:
        self._recording.close()

    def _round(self, begun: float, stop: threading.Event) -> Generator[Said, None, float]:
        """Play it once; the seconds from its begin to that of another round."""
        readings = Compensator(*self._compensation).all(self._recording.readings())
        stamped, played = tee(_from(self._pace.offset, readings))
        stamps = (one.stamp for one in stamped)
        due, number = 0.0, 0
        for due, one in zip(due_times(stamps, self._pace.speed), played, strict=True):
            number += 1
            wait = begun + due - time.monotonic()
            if stop.wait(wait) if wait > 0 else stop.is_set():
                return 0.0
            yield one.topic, one.reading
        if not number:
            raise SourceError(
                f"there is nothing to play after {self._pace.offset:g} s; take a smaller offset"
            )
        return due + self._gap(due, number)

    def _gap(self, lasted: float, number: int) -> float:
        """The seconds between two rounds: as from one of its readings to the next."""
        if not self._pace.speed:
            return 0.0
        return lasted / (number - 1) if lasted else self._alone / self._pace.speed


def _from(offset: float, readings: Iterator[Recorded]) -> Iterator[Recorded]:
    """Those from so many seconds after the first on."""
    first = next(readings, None)
    if first is None:
        return
    if not offset:
        yield first
    begin = first.stamp + offset
    yield from dropwhile(lambda one: one.stamp < begin, readings) if offset else readings


class Playing(Bridge):
    """A bridge whose source is a recording in a file. Raises MisuseError."""

    reconnects = False
    source_option: ClassVar[str] = "file"

    def __init__(self, file: str, pace: Pace, time_offset: float = 0.0) -> None:
        super().__init__()
        self.source = file
        self._pace = pace
        self._time_offset = checked_offset(time_offset)
        if not Path(file).exists():
            raise MisuseError(f"there is no file {file!r}; expected a recording, check its name")

    @abstractmethod
    def recording(self) -> Recording:
        """Open the recording. Raises RecordingError."""

    def open(self) -> Source:
        try:
            return Player(self.recording(), self._pace, self._time_offset, self._uncorrected)
        except RecordingError as error:
            raise SourceError(str(error)) from None

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Play it; what is wrong with the file is told once, for it would be so again."""
        try:
            super().run(emit, stop)
        except SourceError as error:
            self.failed = True
            self.count("failures")
            self._say(str(error))

    def _uncorrected(self) -> None:
        self.pass_over(NOT_CORRECTED, f"{self.source}: {WHY_NOT_CORRECTED}")

    def pass_over(self, what: str, line: str) -> None:
        """Count what is passed over, and tell of the first of its kind."""
        if what not in self._counts:
            self._say(f"{line}; more of these are counted as {what!r}")
        self.count(what)
