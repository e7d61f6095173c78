"""Sensor data that waits to be written: bounded, for nobody waits for a record of it."""

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
"""So much may wait; what comes meanwhile is dropped."""


@dataclass(frozen=True, slots=True)
class Heard:
    """What came on a topic: in the midst of which frame, and when by the clock, in seconds.

    `told` are the readings, or the bytes that the bus brought.
    """

    topic: str
    member: str
    told: Readings | bytes
    frame: int
    seconds: float

    @property
    def size(self) -> int:
        """Bytes, where it came over the bus."""
        return len(self.told) if isinstance(self.told, bytes) else 0

    def readings(self) -> Readings:
        """The readings. Raises ProtocolError for what are none."""
        if isinstance(self.told, Readings):
            return self.told
        return Decoder().readings(self.topic, self.member, self.told)


class Backlog:
    """Filled by any threads, emptied by one; `put` neither waits nor reads what it is given.

    `dropped` counts what has not been taken: there was no room, or it was none that could be read.
    """

    def __init__(self) -> None:
        self.dropped: int = 0
        self._lock = threading.Lock()
        self._waiting: deque[Heard] = deque()
        self._bytes = 0

    def put(self, one: Heard) -> None:
        """Let something wait, where there is room."""
        with self._lock:
            if len(self._waiting) >= MESSAGES or self._bytes + one.size > BYTES:
                self.dropped += 1
            else:
                self._waiting.append(one)
                self._bytes += one.size

    @property
    def waiting(self) -> int:
        """How many wait."""
        return len(self._waiting)

    def take(self) -> tuple[Heard, Readings] | None:
        """The next one, as readings; None where nothing waits."""
        while True:
            with self._lock:
                if not self._waiting:
                    return None
                one = self._waiting.popleft()
                self._bytes -= one.size
            try:
                return one, one.readings()
            except ProtocolError:
                with self._lock:
                    self.dropped += 1
