"""Buffer for readings that a generator has received and not yet used in a frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.frame.messages import Readings
from minerva_bus.world.readings import Reading

MAX_READINGS: Final = 1000
"""Readings of one publisher that wait for a frame; the oldest are dropped."""

TAKES: Final = ("newest", "all")


class ReadingBuffer:
    """Readings by topic and publisher, until a tick takes them.

    Of a publisher in step it keeps the readings of one frame. A free-running publisher may be
    faster than the frames: `takes` selects its newest reading, or all since the last frame, of
    which only every `nth` is used. `dropped` is the number of unused readings.
    """

    def __init__(self, takes: str = "newest", nth: int = 1) -> None:
        if takes not in TAKES:
            raise MisuseError(f"takes is {takes!r}; expected {' or '.join(TAKES)}")
        if nth < 1:
            raise MisuseError(f"nth is {nth}; expected a whole number from 1")
        self.dropped: int = 0
        self._limit = MAX_READINGS if takes == "all" else 1
        self._nth = nth
        self._in_step: dict[tuple[str, str], Readings] = {}
        self._free: dict[tuple[str, str], deque[Reading]] = {}
        self._received: dict[tuple[str, str], int] = {}

    def put(self, readings: Readings) -> None:
        """Add readings that have arrived."""
        key = readings.topic, readings.member
        if readings.frame >= 0:
            kept = self._in_step.get(key)
            # Repeated readings of an earlier frame must not replace newer ones.
            if kept is None or kept.frame <= readings.frame:
                self._in_step[key] = readings
            return
        waiting = self._free.setdefault(key, deque())
        for reading in readings.readings:
            # Counted by publisher, so that every nth reading of each is
            # used, independent of their interleaving.
            number = self._received[key] = self._received.get(key, 0) + 1
            if number % self._nth:
                self.dropped += 1
                continue
            waiting.append(reading)
            if len(waiting) > self._limit:
                waiting.popleft()
                self.dropped += 1

    def missing(self, frame: int, sources: Mapping[str, tuple[str, ...]]) -> Iterator[str]:
        """The publishers in step whose readings of a frame have not arrived."""
        for topic, publishers in sorted(sources.items()):
            for publisher in publishers:
                readings = self._in_step.get((topic, publisher))
                if readings is None or readings.frame != frame:
                    yield publisher

    def taken(self, frame: int) -> tuple[Reading, ...]:
        """Remove and return the readings used in a frame, by topic and publisher."""
        if not self._in_step and not self._free:
            return ()
        # Readings of an earlier frame are those of a publisher that has left, or repeated for a
        # newcomer: they were used in their own frame.
        taken = {
            key: message.readings
            for key, message in self._in_step.items()
            if message.frame == frame
        }
        taken |= {key: tuple(waiting) for key, waiting in self._free.items()}
        self._in_step = {
            key: message for key, message in self._in_step.items() if message.frame > frame
        }
        self._free = {}
        return tuple([reading for _, readings in sorted(taken.items()) for reading in readings])

    def clear(self) -> None:
        """Forget all readings, because the member rejoins."""
        self._in_step, self._free = {}, {}
