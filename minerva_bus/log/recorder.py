"""Records a world while it runs, on a thread of its own.

Only the recorder's thread accesses the disk, so frames do not wait for it. Frames are encoded in
memory. If that takes little time (`LIGHT`), the thread that runs the frames does it while it waits
for members: two threads that compete for the interpreter cost more than the work itself. Digests of
large populations, which do not need the interpreter, have a thread of their own.

Up to `WAITING` frames are queued. If the queue is full, the world waits, because a record with gaps
cannot be replayed. If the disk makes no progress for `PATIENCE` seconds, frames are dropped until
it does, and their number is reported. The strings after a gap are still correct, because a frame is
written as the delta from the last written frame. Publishers of sensor data never wait.

If the disk is full, the world continues without a record; flushed data stay readable.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from math import inf
from pathlib import Path
from typing import IO, Final, TypeAlias

from minerva_bus.errors import MinervaError, ProtocolError, RecordError
from minerva_bus.files import reason_of
from minerva_bus.frame.messages import FrameRecord, Readings
from minerva_bus.frame.stimuli import Checkpoint, FrameDone
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.channels import check_installed
from minerva_bus.log.entries import Kept, RecordHeader
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter, open_for_record, part_of, take_name
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.codec import Decoder
from minerva_bus.wording import BackOff
from minerva_bus.world.operator import PersonOperation

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


# --- bounded queues ---


@fast_dataclass
class Pending:
    """An item to write: a frame or a log line.

    `digest`: of the string, if another thread computes it; waited for before it is written.
    """

    write: Callable[[], None]
    is_frame: bool
    digest: Future[bytes] | None = None


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


@fast_dataclass
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


CLOSING_WITHIN: Final = 30.0
"""Seconds that `close` waits for the disk."""

LIGHT: Final = 0.0005
"""Seconds of encoding per frame up to which `idle` does the work."""

REST: Final = 0.01
"""Minimum seconds between two wake-ups of the thread, also for shorter flush intervals."""


# --- the thread ---


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
            if pending.digest is not None:
                self._carefully(pending.digest.result)
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

    def _carefully(self, work: Callable[[], object]) -> None:
        """Note a failure instead of raising it: a record must never end its world."""
        if self.failure:
            return
        try:
            work()
        except OSError as error:
            self.fail(reason_of(error))
        # The world continues after any failure of its record.
        except Exception as error:
            self.fail(f"{type(error).__name__}: {error}")


def shut(stream: IO[bytes]) -> None:
    """Close a file; ignore data that a full disk does not accept."""
    with suppress(OSError):
        stream.close()


HELPED_WITHIN: Final = 4
"""Queued frames that may wait for `idle` before the thread is woken."""

SAID_AFTER: Final = 1.0
"""Seconds of waiting for the disk after which it is reported."""

TURN: Final = 0.001
"""Seconds after which the recorder's thread releases the interpreter's lock. Python's default of
five milliseconds is several frames; releasing it more often costs more than it gains."""


_NO_TIMINGS: Mapping[str, float] = {}


# --- its user ---


class Recorder:
    """Writes the record of one run.

    `flush_seconds`: interval after which all data are written to the disk. `durable`: each frame is
    on the disk before `frame` returns. `say` receives messages for the user, within `frame` or
    `close` and so in the caller's thread. `past`: a record to continue; its contents are copied
    first, and it may have the same name. An existing file of that name is kept, unless `keep_old`
    is false. Raises RecordError if the file cannot be created, and MisuseError if mcap is not
    installed; raises nothing later.
    """

    def __init__(
        self,
        path: Path,
        description: RecordHeader,
        *,
        flush_seconds: float = 2.0,
        durable: bool = False,
        say: Callable[[str], None] = lambda _: None,
        past: Record | None = None,
        keep_old: bool = True,
    ) -> None:
        check_installed()
        self.path = path
        self._say = say
        self._durable = durable
        self._is_helped = False
        self._is_reported = False
        self._is_saying = False
        self._reports = BackOff()
        stream, self._writer = _opened(path, description, past, keep_old=keep_old)
        self._given = self._writer.frames
        # The digest of a large population takes as long as writing it.
        self._digests = ThreadPoolExecutor(1) if self._writer.is_large else None
        self._work = RecordingThread(stream, self._writer, flush_seconds, durable=durable)
        # The shorter of both, because the embedding program may have chosen its own.
        sys.setswitchinterval(min(TURN, sys.getswitchinterval()))

    @property
    def frames(self) -> int:
        """Number of frames that are certain to be in the record."""
        return self._writer.kept

    @property
    def lost(self) -> int:
        """Number of frames that the record lacks; after a failure, that it lacks at most."""
        failed = self._work.failure
        return self._given - self._writer.kept if failed else self._work.queue.lost

    def frame(
        self,
        record: FrameRecord | FrameDone,
        scene: Scene,
        seconds: float,
        timings: Mapping[str, float] = _NO_TIMINGS,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        """Record a frame; `scene` is the string after it, `seconds` the time since the beginning.

        The digest is computed later or by another thread, so no frame waits for it. `timings` are
        in seconds, by name. `checkpoint` is that after the frame; a run can only be resumed if
        there is one.
        """
        self._work.frame = record.frame + 1
        self._given += 1
        try:
            # Copied now, because members may change their saved objects later.
            kept = Kept.of(checkpoint) if checkpoint is not None else None
        except (TypeError, ValueError, OverflowError) as error:
            self._work.fail(f"a member saved data that are not plain: {error}")
        else:
            write = partial(self._writer.frame, record, scene, seconds, timings, kept)
            digests = self._digests if self._work.is_open else None
            digest = digests and digests.submit(getattr, scene, "digest")
            self._put(Pending(write, is_frame=True, digest=digest))
        self._report_failure()

    @property
    def problem(self) -> str:
        """Why frames are not written now; empty if they are."""
        slow = "the disk is too slow" if self._work.queue.is_stuck else ""
        return self._work.failure or slow

    def idle(self) -> None:
        """Encode a queued frame if that is quick and stays in memory; otherwise wake the thread.

        For the caller of `frame` while it waits. After the first call the thread relies on
        further ones.
        """
        self._is_helped = True
        self._work.help()

    def log(self, member: str, text: str, seconds: float, *, warning: bool = False) -> None:
        """Record a line about a member."""
        write = partial(self._writer.log, self._work.frame, seconds, member, text, warning)
        self._put(Pending(write, is_frame=False))

    def noted(self, operation: PersonOperation, seconds: float) -> None:
        """Record what a person did to the world."""
        self._put(Pending(partial(self._writer.noted, operation, seconds), is_frame=False))

    def sensed(self, readings: Readings, seconds: float) -> None:
        """Record readings of a sensor topic, without waiting. From any thread."""
        self._queue(Sensed(readings.topic, readings.member, readings, self._work.frame, seconds))

    def received(self, topic: str, member: str, data: bytes, seconds: float) -> None:
        """As `sensed`, for readings as received from the bus."""
        self._queue(Sensed(topic, member, data, self._work.frame, seconds))

    def _queue(self, sensed: Sensed) -> None:
        if self._work.is_open:
            self._work.backlog.put(sensed)

    def flush(self) -> None:
        """Wait until all frames are on the disk, or until it is too slow."""
        if self._work.is_open:
            self._work.flush(self._waiting)
        self._report_failure()

    def close(self) -> None:
        """Write the remaining data and the index. Further calls do nothing."""
        if self._work.is_closed:
            return
        self._work.close(self._waiting)
        self._report_failure()
        if self._work.failure:
            # More than the last flush has written may be readable.
            with suppress(MinervaError), Record(self.path) as record:
                self._writer.kept = max(self._writer.kept, sum(1 for _ in record.frames()))
            return
        dropped = self._work.backlog.dropped
        if dropped:
            self._say(
                f"{self.path}: {dropped} messages on topics are not in the record:"
                " they arrived faster than they could be written"
            )

    def _put(self, pending: Pending) -> None:
        work = self._work
        if not work.is_open:
            return
        if self._is_saying:
            # This line of the log says that the queue is full: it must not wait for the queue.
            if work.queue.has_room:
                work.queue.put(pending, self._waiting)
            return
        was_stuck = work.queue.is_stuck
        if not work.queue.put(pending, self._waiting):
            if not was_stuck:
                self._say(
                    f"{self.path}: disk too slow; dropping frames from the record until it"
                    " catches up"
                )
        elif self._durable:
            work.queue.wait_until_flushed(self._waiting)
        # A caller that helps encodes small frames itself; waking the thread for each would cost
        # more.
        elif not self._is_helped or self._digests or len(work.queue) > HELPED_WITHIN:
            work.wake.set()

    def _waiting(self, seconds: float) -> None:
        """Report, with back-off, for how long the world has been waiting for the disk."""
        if seconds < SAID_AFTER or self._is_saying or not self._reports.is_due(time.monotonic()):
            return
        self._is_saying = True
        try:
            self._say(
                f"{self.path}: frame {self._work.frame} has been waiting for the disk for"
                f" {seconds:.1f} s"
            )
        finally:
            self._is_saying = False

    def _report_failure(self) -> None:
        if not self._work.failure or self._is_reported:
            return
        self._is_reported = True
        self._say(
            f"{self.path}: {self._work.failure}; the world continues without a record, of which"
            f" {self._writer.kept} frames or more can be read"
        )


def _opened(
    path: Path, description: RecordHeader, past: Record | None, *, keep_old: bool
) -> tuple[IO[bytes], RecordWriter]:
    """The file of a record and its writer, with the contents of `past`. Raises RecordError."""
    part = None if past is None else part_of(path)
    # The copy has a temporary name until it is complete. If the disk fills up or the process is
    # killed before that, the earlier record still exists.
    stream = open_for_record(path) if part is None else open_for_record(part, keep_old=False)
    try:
        writer = RecordWriter(stream, description, past)
        if part is not None:
            take_name(path, keep_old=keep_old)
    except (OSError, RecordError) as error:
        shut(stream)
        if part is not None:
            part.unlink(missing_ok=True)
        if isinstance(error, RecordError):
            raise
        raise RecordError(f"{path}: cannot be written: {error.strerror}") from None
    return stream, writer
