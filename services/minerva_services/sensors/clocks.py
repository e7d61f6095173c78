"""What readers of recordings and sensors report: skipped data, steps of clocks, shared topics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

from minerva_bus.grammar.events import Event
from minerva_bus.log.recordings import STEP_SECONDS, PassOver, Recorded, RecordingClock

STEPS_BACK: Final = "clock steps back"
SHARED_TOPIC: Final = "sensors on one topic"
"""The counters of such steps, and of further sensors on a topic."""

_MAX_NAMED: Final = 5
_MAX_SENSORS: Final = 100
"""Number of sensors of a topic whose times are remembered."""


class FirstSkip:
    """Passes skipped data on, and keeps the first reason for an error if nothing remains."""

    def __init__(self, pass_over: PassOver) -> None:
        self._pass_over = pass_over
        self._line = ""

    def __call__(self, what: str, line: str) -> None:
        """Skip data (a `PassOver`)."""
        self._line = self._line or line
        self._pass_over(what, line)

    def reason(self, path: Path) -> str:
        """The end of an error about a file: why its first data were skipped, if any were."""
        return f"; {self._line.removeprefix(f'{path}: ')}" if self._line else ""


class ClockWatch:
    """Finds steps back of sensors' clocks, and topics that several sensors share.

    A sensor is known by the topic of its readings and by the frame of its messages, if they have
    one.
    """

    def __init__(self) -> None:
        self._latest: dict[str, dict[str, float]] = {}

    def problems(self, topic: str, time: float, frame: str = "") -> Iterator[tuple[str, str]]:
        """What is wrong with the next reading of a sensor: counters and descriptions."""
        sensors = self._latest.setdefault(topic, {})
        if sensors and frame not in sensors:
            several = ", ".join([*sensors, frame][:_MAX_NAMED])
            yield SHARED_TOPIC, f"{topic} has readings of {several}; give each sensor its own topic"
        back = sensors.get(frame, time) - time
        if len(sensors) >= _MAX_SENSORS:
            sensors.clear()
        sensors[frame] = time
        if back > STEP_SECONDS:
            of = f"{topic} ({frame})" if frame else topic
            yield STEPS_BACK, f"the clock of {of} steps back by {back:.1f} s"


def watched(
    readings: Iterable[Recorded], path: Path, pass_over: PassOver, frame: Callable[[], str] = str
) -> Iterator[Recorded]:
    """All readings of a recording; reports what `ClockWatch` finds.

    `frame` returns that of the latest reading.
    """
    sensors, recorder = ClockWatch(), RecordingClock()
    for recorded in readings:
        recorder.advance(recorded.stamp)
        if not isinstance(recorded.reading, Event):
            for what, line in sensors.problems(recorded.topic, recorded.reading.time, frame()):
                pass_over(what, f"{path}: {line} ({recorder.seconds:.1f} s after the beginning)")
        yield recorded
