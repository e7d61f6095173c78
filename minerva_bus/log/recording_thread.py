"""The thread that writes a record, and its queues."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import IO, Final

from minerva_bus.log.queues import LOOK_SECONDS, PATIENCE, Backlog, FrameQueue, Waiting
from minerva_bus.log.writer import RecordWriter

CLOSING_WITHIN: Final = 30.0
"""Seconds that `close` waits for the disk."""

LIGHT: Final = 0.0005
"""Seconds of encoding per frame up to which `idle` does the work."""

REST: Final = 0.01
"""Minimum seconds between two wake-ups of the thread, also for shorter flush intervals."""


class RecordingThread:
    """The thread that writes a record, and its queues.

    `frame`: number of the frame in progress. `failure`: the reason why writing has
    stopped, or an empty string.
    """

    def __init__(
        self, stream: IO[bytes], writer: RecordWriter, flush_seconds: float, *, durable: bool
    ) -> None:
        self.frame: int = 0
        self.failure = ""
        self.is_closed = False
        self.wake = threading.Event()
        self.queue = FrameQueue(self.wake)
        self.backlog = Backlog()
        self._stream = stream
        self._writer = writer
        self._durable = durable
        self._flush_seconds = 0.0 if durable else flush_seconds
        self._flush_at = time.monotonic() + self._flush_seconds
        self._writing = threading.Lock()
        self._is_light = True
        self._is_urgent = False
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    # --- for the caller's thread ---

    @property
    def is_open(self) -> bool:
        """Whether recording is still possible."""
        return not (self.failure or self.is_closed)

    def fail(self, reason: str) -> None:
        """Stop recording; the first reason is kept."""
        self.failure = self.failure or reason

    def help(self) -> None:
        """Write a queued frame if that is quick and stays in memory; otherwise wake the thread."""
        if self._durable or not (self.queue or self.backlog.waiting):
            return
        # With a flush interval of 0 each frame is flushed to the disk, which only the thread may
        # access.
        is_quick = self._is_light and self._writer.has_room and self._flush_seconds
        if self.backlog.waiting or not is_quick:
            self.wake.set()
        # If the thread is writing already, the frames must not wait for it.
        elif self._writing.acquire(blocking=False):
            try:
                self._write_next()
            finally:
                self._writing.release()

    def flush(self, waiting: Waiting) -> None:
        """Write all queued items, and wait until they are written; see `FrameQueue`."""
        self._is_urgent = True
        self.queue.wait_until_flushed(waiting, PATIENCE)

    def close(self, waiting: Waiting) -> None:
        """Write all queued items, and end."""
        self.is_closed = True
        self.wake.set()
        since = time.monotonic()
        while (waited := time.monotonic() - since) < CLOSING_WITHIN and self._thread.is_alive():
            waiting(waited)
            self._thread.join(min(CLOSING_WITHIN - waited, LOOK_SECONDS))
        if self._thread.is_alive():
            self.fail("the disk does not respond")

    # --- in the thread ---

    def _run(self) -> None:
        while not self.is_closed:
            rest = max(REST, self._flush_at - time.monotonic())
            # A durable record is flushed by each frame, so nothing is due without one.
            self.wake.wait(None if self._durable else rest)
            self.wake.clear()
            self._write_all()
        self._write_all()
        self._carefully(self._write_sensed)
        self._carefully(self._writer.finish)
        shut(self._stream)

    def _write_all(self) -> None:
        """Write all queued data; flush on time even if a fast world always queues more."""
        more = True
        while more:
            with self._writing:  # Released after each item, so that `help` can write too.
                self._write_next()
                self._carefully(self._write_sensed)
                is_last = self._is_urgent and not self.queue
                if is_last or time.monotonic() >= self._flush_at:
                    self._is_urgent = self._is_urgent and not is_last
                    self._carefully(self._writer.flush)
                    self.queue.mark_flushed()
                    self._flush_at = time.monotonic() + self._flush_seconds
            more = bool(self.queue)

    def _write_next(self) -> None:
        """Write the oldest item; the caller holds `_writing`."""
        # CPU time of this thread alone: waiting for the interpreter does not count.
        began = time.thread_time()
        pending = self.queue.take()
        if pending is not None:
            self._carefully(pending.write)
            if pending.is_frame:
                self._is_light = time.thread_time() - began <= LIGHT

    def _write_sensed(self) -> None:
        """Write queued readings, unless the world waits for the queue of frames."""
        backlog, seconds = self.backlog, 0.0
        # Bounded by the current number: with a fast sensor the loop would otherwise never end.
        for _ in range(backlog.waiting):
            taken = backlog.take() if self.queue.has_room else None
            if taken is None:
                break
            sensed, readings = taken
            seconds = sensed.seconds
            self._writer.sensed(readings, sensed.frame, seconds)
        dropped = backlog.dropped - backlog.recorded_drops
        if dropped:
            backlog.recorded_drops += dropped
            self._writer.dropped(dropped, self.frame, seconds)

    def _carefully(self, work: Callable[[], None]) -> None:
        """Note a failure instead of raising it: a record must never end its world."""
        if self.failure:
            return
        try:
            work()
        except OSError as error:
            self.fail(error.strerror or str(error))
        # The world continues after any failure of its record.
        except Exception as error:
            self.fail(f"{type(error).__name__}: {error}")


def shut(stream: IO[bytes]) -> None:
    """Close a file; ignore data that a full disk does not accept."""
    try:
        stream.close()
    except OSError:
        return
