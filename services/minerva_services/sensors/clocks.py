"""What readers of recordings and sensors report: skipped data, and clocks that step back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from minerva_bus.log.recordings import STEP_SECONDS, PassOver, Recorded, RecordingClock

STEPS_BACK: Final = "clock steps back"
"""The counter of such steps."""


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
    """Finds steps back of sensors' clocks, each named by the topic of its readings."""

    def __init__(self) -> None:
        self._latest: dict[str, float] = {}

    def step(self, topic: str, time: float) -> str:
        """Description of a step back to the next time of a clock; empty if there is none."""
        back = self._latest.get(topic, time) - time
        self._latest[topic] = time
        return f"the clock of {topic} steps back by {back:.1f} s" if back > STEP_SECONDS else ""


def watched(readings: Iterable[Recorded], path: Path, pass_over: PassOver) -> Iterator[Recorded]:
    """All readings of a recording; reports where the clocks of its sensors step back."""
    sensors, recorder = ClockWatch(), RecordingClock()
    for recorded in readings:
        recorder.advance(recorded.stamp)
        if step := sensors.step(recorded.topic, recorded.reading.time):
            pass_over(STEPS_BACK, f"{path}: {step}, {recorder.seconds:.1f} s after the beginning")
        yield recorded
