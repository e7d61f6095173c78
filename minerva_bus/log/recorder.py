"""Records a world while it runs, on a thread of its own.

Only the recorder's thread accesses the disk, so frames do not wait for it. Frames are encoded in
memory. If that takes little time (`LIGHT`), the thread that runs the frames does it while it waits
for members: two threads that compete for the interpreter cost more than the work itself.

Up to `WAITING` frames are queued. If the queue is full, the world waits too, because a record with
gaps cannot be replayed. If the disk makes no progress for `PATIENCE` seconds, frames are dropped
until it does, and their number is reported. The strings after a gap are still correct, because a
frame is written as the delta from the last written frame.

If the disk is full, the world continues without a record; flushed data stay readable.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Final

from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.messages import FrameRecord, Readings
from minerva_bus.frame.stimuli import FrameDone
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.backlog import Backlog, Sensed
from minerva_bus.log.checkpoints import Kept
from minerva_bus.log.description import Description
from minerva_bus.log.errors import RecordError
from minerva_bus.log.extra import check_installed
from minerva_bus.log.reader import Record
from minerva_bus.log.writer import RecordWriter, open_for_record, part_of, take_name

WAITING: Final = 16
HELPED_WITHIN: Final = 4
"""Queued frames that may wait for `idle` before the thread is woken."""

PATIENCE: Final = 1.0
CLOSING_WITHIN: Final = 30.0
TURN: Final = 0.001
"""Seconds after which the recorder's thread releases the interpreter's lock. Python's default of
five milliseconds is several frames; releasing it more often costs more than it gains."""

LIGHT: Final = 0.0005
"""Seconds of encoding per frame up to which `idle` does the work."""

REST: Final = 0.01
"""Minimum seconds between two wake-ups of the thread, however short the flush interval."""

_NONE: Mapping[str, float] = {}


@dataclass(frozen=True, slots=True)
class _FrameItem:
    record: FrameRecord | FrameDone
    scene: Scene
    seconds: float
    timings: Mapping[str, float]
    kept: Kept | None


@dataclass(frozen=True, slots=True)
class _LogItem:
    frame: int
    seconds: float
    member: str
    text: str
    warning: bool


_Item = _FrameItem | _LogItem


class Recorder:
    """Writes the record of one run.

    `flush_seconds`: interval after which all data are written to the disk. `durable`: each frame is
    on the disk before `frame` returns. `say` receives messages for people, within `frame` or
    `close` and so in the caller's thread. `past`: a record to continue; its contents are copied
    first, and it may have the same name. An existing file of that name is kept, unless `keep_old`
    is false. Raises RecordError if the file cannot be created, and MisuseError if mcap is not
    installed; raises nothing later.
    """

    def __init__(
        self,
        path: Path,
        description: Description,
        *,
        flush_seconds: float = 2.0,
        durable: bool = False,
        say: Callable[[str], None] = lambda _: None,
        past: Record | None = None,
        keep_old: bool = True,
    ) -> None:
        check_installed()
        self.path = path
        self.lost: int = 0
        self._say = say
        self._failure = ""
        self._is_reported = False
        self._frame: int = 0
        self._durable = durable
        self._flush_seconds = 0.0 if durable else flush_seconds
        self._flush_at = time.monotonic() + self._flush_seconds
        if past is None:
            self._stream = open_for_record(path)
        else:
            self._stream = open_for_record(part_of(path), keep_old=False)
        try:
            self._writer = RecordWriter(self._stream, description, past)
            if past is not None:
                take_name(path, keep_old=keep_old)
        except (OSError, RecordError) as error:
            _shut(self._stream)
            if past is not None:
                part_of(path).unlink(missing_ok=True)
            if isinstance(error, RecordError):
                raise
            raise RecordError(f"{path}: cannot be written: {error.strerror}") from None
        self._items: deque[_Item] = deque()
        self._given = self._taken = self._flushed = 0
        self._writing = threading.Lock()
        self._called = threading.Event()
        self._written = threading.Event()
        self._is_helped = False
        self._light = True
        self._stuck = False
        self._closed = False
        self._backlog = Backlog()
        self._dropped: int = 0
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()
        sys.setswitchinterval(min(TURN, sys.getswitchinterval()))

    @property
    def frames(self) -> int:
        """Number of frames that are certainly in the record."""
        return self._writer.kept

    def frame(
        self,
        record: FrameRecord | FrameDone,
        scene: Scene,
        seconds: float,
        timings: Mapping[str, float] = _NONE,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        """Record a frame; `scene` is the string after it, `seconds` the time since the beginning.

        The digest is computed when the frame is written, so no frame waits for it. `timings` are
        in seconds, by name. `checkpoint` is that after the frame; a run can only be resumed if
        there is one.
        """
        self._frame = record.frame + 1
        try:
            kept = Kept.of(checkpoint) if checkpoint is not None else None
        except (TypeError, ValueError, OverflowError) as error:
            self._failure = self._failure or f"a member saved data that are not plain: {error}"
        else:
            self._put(_FrameItem(record, scene, seconds, timings, kept))
        self._report_failure()

    def idle(self) -> None:
        """Encode a queued frame if that is quick and stays in memory; otherwise wake the thread.

        For the caller of `frame` while it waits. After the first call the thread relies on
        further ones.
        """
        self._is_helped = True
        if self._durable or not (self._items or self._backlog.waiting):
            return
        little = self._light and self._writer.has_room
        if self._backlog.waiting or not (little and self._flush_seconds):
            self._called.set()
        elif self._writing.acquire(blocking=False):
            try:
                self._write_next()
            finally:
                self._writing.release()

    def log(self, member: str, text: str, seconds: float, *, warning: bool = False) -> None:
        """Record a line about a member."""
        self._put(_LogItem(self._frame, seconds, member, text, warning))

    def sensed(self, readings: Readings, seconds: float) -> None:
        """Record readings of a sensor topic, without waiting. From any thread."""
        self._queue(Sensed(readings.topic, readings.member, readings, self._frame, seconds))

    def received(self, topic: str, member: str, data: bytes, seconds: float) -> None:
        """As `sensed`, for readings as received from the bus."""
        self._queue(Sensed(topic, member, data, self._frame, seconds))

    def _queue(self, sensed: Sensed) -> None:
        if not (self._failure or self._closed):
            self._backlog.put(sensed)

    def close(self) -> None:
        """Write the remaining data and the index. Further calls do nothing."""
        if self._closed:
            return
        self._closed = True
        self._called.set()
        self._thread.join(CLOSING_WITHIN)
        if self._thread.is_alive():
            self._failure = self._failure or "the disk does not respond"
        self._report_failure()
        if self.lost:
            self._say(
                f"{self.path}: {self.lost} frames are not in the record: the disk was too slow"
            )
        if self._backlog.dropped:
            self._say(
                f"{self.path}: {self._backlog.dropped} messages on topics are not in the record:"
                " they arrived faster than they could be written"
            )

    def _put(self, item: _Item) -> None:
        if self._failure or self._closed:
            return
        if not self._has_room():
            self._drop(item)
            return
        self._items.append(item)
        self._given += 1
        self._stuck = False
        if self._durable:
            self._await_disk()
        elif not self._is_helped or len(self._items) > HELPED_WITHIN:
            self._called.set()

    def _await_disk(self) -> None:
        """Wait for the thread: an interrupt ends the wait, but not the write."""
        while self._flushed < self._given:
            self._written.clear()
            self._called.set()
            if self._flushed < self._given:
                self._written.wait()

    def _has_room(self) -> bool:
        """Whether the queue has room, now or within `PATIENCE`. Polling is cheaper than locks."""
        until = 0.0 if self._stuck else time.monotonic() + PATIENCE
        while len(self._items) >= WAITING:
            self._called.set()
            if time.monotonic() >= until:
                return False
            time.sleep(0.001)
        return True

    def _drop(self, item: _Item) -> None:
        if not self._stuck:
            self._say(
                f"{self.path}: disk too slow; dropping frames from the record until it catches up"
            )
        self._stuck = True
        self.lost += isinstance(item, _FrameItem)

    def _report_failure(self) -> None:
        if not self._failure or self._is_reported:
            return
        self._is_reported = True
        self._say(
            f"{self.path}: {self._failure}; the world continues without a record, of which"
            f" {self._writer.kept} frames can be read"
        )

    # --- in the thread ---

    def _run(self) -> None:
        while not self._closed:
            rest = max(REST, self._flush_at - time.monotonic())
            self._called.wait(None if self._durable else rest)
            self._called.clear()
            self._write_all()
            self._written.set()
        self._write_all()
        self._carefully(self._write_sensed)
        self._carefully(self._writer.finish)
        _shut(self._stream)

    def _write_all(self) -> None:
        """Write all queued data; flush on time even if a fast world always queues more."""
        more = True
        while more:
            with self._writing:  # Released after each item, so that `idle` can write too.
                self._write_next()
                self._carefully(self._write_sensed)
                if time.monotonic() >= self._flush_at:
                    self._carefully(self._writer.flush)
                    self._flushed = self._taken
                    self._flush_at = time.monotonic() + self._flush_seconds
            more = bool(self._items)

    def _write_next(self) -> None:
        """Write the oldest queued item; the caller holds `_writing`."""
        if self._items:
            began = time.thread_time()
            item = self._items.popleft()
            self._taken += 1
            self._carefully(partial(self._write, item))
            if isinstance(item, _FrameItem):
                self._light = time.thread_time() - began <= LIGHT

    def _write(self, item: _Item) -> None:
        if isinstance(item, _FrameItem):
            self._writer.frame(item.record, item.scene, item.seconds, item.timings, item.kept)
        else:
            self._writer.log(item.frame, item.seconds, item.member, item.text, item.warning)

    def _write_sensed(self) -> None:
        """Write queued readings, unless the world waits for the queue of frames."""
        seconds = 0.0
        for _ in range(self._backlog.waiting):
            taken = self._backlog.take() if len(self._items) < WAITING else None
            if taken is None:
                break
            sensed, readings = taken
            seconds = sensed.seconds
            self._writer.sensed(readings, sensed.frame, seconds)
        if self._backlog.dropped > self._dropped:
            new, self._dropped = self._backlog.dropped - self._dropped, self._backlog.dropped
            self._writer.dropped(new, self._frame, seconds)

    def _carefully(self, work: Callable[[], None]) -> None:
        """Note a failure instead of raising it: a record must never end its world."""
        if self._failure:
            return
        try:
            work()
        except OSError as error:
            self._failure = error.strerror or str(error)
        except Exception as error:
            self._failure = f"{type(error).__name__}: {error}"


def _shut(stream: IO[bytes]) -> None:
    """Close a file; ignore data that a full disk does not accept."""
    try:
        stream.close()
    except OSError:
        return
