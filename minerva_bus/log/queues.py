"""Bounded queues of the recorder's thread: for frames and log lines, and for sensor data.

A world waits for room in the first, because a record with gaps cannot be replayed. Publishers of
sensor data never wait.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Final, TypeAlias

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.messages import Readings
from minerva_bus.wire.codec import Decoder

MESSAGES: Final = 1024
BYTES: Final = 64 << 20
"""Bytes that may be queued; further data are dropped."""

WAITING: Final = 16
"""Frames and log lines that may be queued."""

PATIENCE: Final = 5.0
"""Seconds that a world waits for room in the queue before frames are dropped."""

LOOK_SECONDS: Final = 0.5
"""Interval in which a wait for the disk calls `waiting`, at most."""

Waiting: TypeAlias = Callable[[float], None]
"""Called during a wait for the disk with the seconds so far."""


@dataclass(frozen=True, slots=True)
class Pending:
    """An item to write: a frame or a log line."""

    write: Callable[[], None]
    is_frame: bool


class FrameQueue:
    """A queue from the thread of the frames to the recorder's thread, which `wake` wakes.

    `lost` counts dropped frames. The other counts are of items that were put, taken and flushed;
    each is changed by one thread at a time, so none needs a lock.
    """

    def __init__(self, wake: threading.Event) -> None:
        self.lost: int = 0
        self.is_stuck = False
        self._put_count: int = 0
        self._taken_count: int = 0
        self._flushed_count: int = 0
        self._wake = wake
        self._has_flushed = threading.Event()
        self._items: deque[Pending] = deque()

    def __len__(self) -> int:
        return len(self._items)

    def put(self, pending: Pending, waiting: Waiting) -> bool:
        """Queue an item if there is room now or within `PATIENCE`; returns whether there was.

        `waiting` is called meanwhile. While the queue is stuck, that is after a drop, `put` does
        not wait.
        """
        # After a drop the disk is known to be slow, so the world must
        # not wait so long for each frame.
        since = time.monotonic()
        patience = 0.0 if self.is_stuck else PATIENCE
        while len(self._items) >= WAITING:
            self._wake.set()
            waited = time.monotonic() - since
            if waited >= patience:
                self.is_stuck = True
                self.lost += pending.is_frame
                return False
            waiting(waited)
            time.sleep(0.001)  # Polling is cheaper than a lock for each frame.
        self._items.append(pending)
        self._put_count += 1
        self.is_stuck = False
        return True

    def take(self) -> Pending | None:
        """Remove and return the oldest item, or None."""
        if not self._items:
            return None
        self._taken_count += 1
        return self._items.popleft()

    @property
    def has_room(self) -> bool:
        """Whether `put` would not wait."""
        return len(self._items) < WAITING

    def mark_flushed(self) -> None:
        """Note that all items taken are on the disk."""
        self._flushed_count = self._taken_count
        self._has_flushed.set()

    def wait_until_flushed(self, waiting: Waiting, within: float = inf) -> None:
        """Wait until all items put are on the disk; an interrupt ends the wait, not the write.

        `waiting` is called meanwhile. `within`: seconds after which the wait ends.
        """
        since = time.monotonic()
        while self._flushed_count < self._put_count:
            self._has_flushed.clear()
            self._wake.set()
            waited = time.monotonic() - since
            if waited >= within:
                return
            waiting(waited)
            # Checked again, because a flush may have ended just before the event was cleared.
            if self._flushed_count < self._put_count:
                self._has_flushed.wait(min(within - waited, LOOK_SECONDS))


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

    `dropped` counts data for which there was no room, or that were invalid; `recorded_drops` those
    that the record mentions.
    """

    def __init__(self) -> None:
        self.dropped: int = 0
        self.recorded_drops: int = 0
        self._lock = threading.Lock()
        self._waiting: deque[Sensed] = deque()
        self._bytes = 0

    def put(self, sensed: Sensed) -> None:
        """Queue data, if there is room."""
        with self._lock:  # Readings arrive on threads of the bus.
            # Two limits, because a message may be an image or a few numbers.
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
                # Decoding follows outside of the lock, so that
                # threads of the bus never wait for it.
                if not self._waiting:
                    return None
                sensed = self._waiting.popleft()
                self._bytes -= sensed.size
            try:
                return sensed, sensed.readings()
            except ProtocolError:
                with self._lock:
                    self.dropped += 1
