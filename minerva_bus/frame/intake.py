"""What a generator has heard on its sensor topics and not yet taken into a frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.frame.messages import Readings
from minerva_bus.world.readings import Reading

WAITING: Final = 1000
"""Readings of one publisher that wait for a frame, at most; the oldest are dropped."""

TAKES: Final = ("newest", "all")


class Intake:
    """Readings by topic and publisher, until a tick takes them.

    Of a publisher in step there are those of one frame. One that runs freely may be faster than
    the frames: `takes` says whether its newest reading counts or all that have come since, and of
    these only every `nth`. What does not count is counted in `dropped`.
    """

    def __init__(self, takes: str = "newest", nth: int = 1) -> None:
        if takes not in TAKES:
            raise MisuseError(f"takes is {takes!r}; expected {' or '.join(TAKES)}")
        if nth < 1:
            raise MisuseError(f"nth is {nth}; expected a whole number from 1")
        self.dropped: int = 0
        self._longest = WAITING if takes == "all" else 1
        self._nth = nth
        self._in_step: dict[tuple[str, str], Readings] = {}
        self._free: dict[tuple[str, str], deque[Reading]] = {}
        self._heard: dict[tuple[str, str], int] = {}

    def put(self, readings: Readings) -> None:
        """Keep what has come."""
        key = readings.topic, readings.member
        if readings.frame >= 0:
            kept = self._in_step.get(key)
            if kept is None or kept.frame <= readings.frame:
                self._in_step[key] = readings
            return
        waiting = self._free.setdefault(key, deque())
        for reading in readings.readings:
            heard = self._heard[key] = self._heard.get(key, 0) + 1
            if heard % self._nth:
                self.dropped += 1
                continue
            waiting.append(reading)
            if len(waiting) > self._longest:
                waiting.popleft()
                self.dropped += 1

    def missing(self, frame: int, sources: Mapping[str, tuple[str, ...]]) -> Iterator[str]:
        """The publishers in step whose readings of a frame are not there yet."""
        for topic, publishers in sorted(sources.items()):
            for publisher in publishers:
                readings = self._in_step.get((topic, publisher))
                if readings is None or readings.frame != frame:
                    yield publisher

    def taken(self) -> tuple[Reading, ...]:
        """The readings that count now, by topic and publisher; free ones count once."""
        if not self._in_step and not self._free:
            return ()
        found = {key: one.readings for key, one in self._in_step.items()}
        found |= {key: tuple(waiting) for key, waiting in self._free.items()}
        self._free = {}
        return tuple([reading for _, mine in sorted(found.items()) for reading in mine])

    def clear(self) -> None:
        """Forget what was heard before the world was lost from sight."""
        self._in_step, self._free = {}, {}
