"""Bounded queue of sensor data to be recorded; publishers never wait for it."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.messages import Readings
from minerva_bus.wire.codec import Decoder

MESSAGES: Final = 1024
BYTES: Final = 64 << 20
"""Bytes that may be queued; further data are dropped."""


@dataclass(frozen=True, slots=True)
class Sensed:
    """Data of a sensor topic: readings, or the bytes received from the bus.

    `frame` was in progress when they arrived, `seconds` after the record began, by the clock.
    """

    topic: str
    member: str
    data: Readings | bytes
    frame: int
    seconds: float

    @property
    def size(self) -> int:
        """Size in bytes, if received from the bus."""
        return len(self.data) if isinstance(self.data, bytes) else 0

    def readings(self) -> Readings:
        """The readings. Raises ProtocolError for invalid data."""
        if isinstance(self.data, Readings):
            return self.data
        return Decoder().readings(self.topic, self.member, self.data)


class Backlog:
    """A queue with any number of writers and one reader; `put` neither waits nor decodes.

    `dropped` counts data for which there was no room, or that were invalid.
    """

    def __init__(self) -> None:
        self.dropped: int = 0
        self._lock = threading.Lock()
        self._waiting: deque[Sensed] = deque()
        self._bytes = 0

    def put(self, sensed: Sensed) -> None:
        """Queue data, if there is room."""
        with self._lock:
            if len(self._waiting) >= MESSAGES or self._bytes + sensed.size > BYTES:
                self.dropped += 1
            else:
                self._waiting.append(sensed)
                self._bytes += sensed.size

    @property
    def waiting(self) -> int:
        """Number of queued items."""
        return len(self._waiting)

    def take(self) -> tuple[Sensed, Readings] | None:
        """The next item and its readings, or None if the queue is empty."""
        while True:
            with self._lock:
                if not self._waiting:
                    return None
                sensed = self._waiting.popleft()
                self._bytes -= sensed.size
            try:
                return sensed, sensed.readings()
            except ProtocolError:
                with self._lock:
                    self.dropped += 1
