"""Clocks that step back: one rule for all readings that are ordered by time.

A time that is older than the latest one by more than STEP_SECONDS is a step of the clock. It begins
a new segment: what follows is ordered within the segment, and the step itself takes no time. A
smaller difference is a reading that arrives late.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from minerva_bus.world.recordings import PassOver, Recorded

STEP_SECONDS: Final = 1.0
"""Maximum seconds by which a reading is late; an older time is a step of the clock."""

STEPS_BACK: Final = "clock steps back"
"""The counter of such steps."""


class RecordingClock:
    """The time of a recording, from a series of times whose clock may step back.

    `seconds` since the first time, and the number of `steps`.
    """

    def __init__(self) -> None:
        self.steps = 0
        self._begin = self._latest = math.nan
        self._before: tuple[float, float] | None = None

    @property
    def seconds(self) -> float:
        """Seconds since the first time, without steps."""
        return 0.0 if math.isnan(self._begin) else self._latest - self._begin

    def advance(self, time: float) -> float:
        """Advance to the next time of the series; returns the seconds that have passed.

        They are 0 for a step, a late reading, and a time that is not finite.
        """
        if not math.isfinite(time):
            return 0.0
        before, self._before = self._before, None
        # A single old time is damaged: its successor continues from the one before.
        if before is not None and abs(time - before[1]) < time - self._latest:
            self._begin, self._latest = before
        if math.isnan(self._begin):
            self._begin = self._latest = time
        passed = time - self._latest
        if passed < -STEP_SECONDS:
            self.steps += 1
            self._before = self._begin, self._latest
            self._begin, self._latest = self._begin + passed, time
        self._latest = max(self._latest, time)
        return max(0.0, passed)


def seconds_of(times: Iterable[float]) -> list[float]:
    """Seconds since the first of a series of times, without steps."""
    clock, seconds = RecordingClock(), list[float]()
    for time in times:
        clock.advance(time)
        seconds.append(clock.seconds)
    return seconds


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
