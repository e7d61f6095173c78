"""Recording a world while it runs.

Only a thread of its own goes to the disk, so a frame is not held up by it. What a frame leaves to
write is put together in memory, and that, where it is `LIGHT`, by whoever runs the frames while it
has to wait for others anyway: two threads that want the interpreter at the same time cost more
than the work itself. All else the thread does.

Up to `WAITING` frames wait. When they are as many, the world waits too, since a record with holes
cannot be replayed; when the disk does nothing at all for `PATIENCE` seconds, frames are left out
until it goes on, and how many is said. The strings of the frames behind a hole are right all the
same: what is written of a frame is what differs from the last frame that was written.

Where the disk is full, the world goes on without a record, and what was flushed stays readable.
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
from minerva_bus.log.backlog import Backlog, Heard
from minerva_bus.log.checkpoints import Kept
from minerva_bus.log.description import Description
from minerva_bus.log.errors import RecordError
from minerva_bus.log.extra import check_installed
from minerva_bus.log.reader import Record
from minerva_bus.log.writer import RecordWriter, open_for_record, part_of, take_name

WAITING: Final = 16
HELPED_WITHIN: Final = 4
"""Frames that may wait for a helper before the thread is called."""

PATIENCE: Final = 1.0
CLOSING_WITHIN: Final = 30.0
TURN: Final = 0.001
"""Seconds that the writing thread keeps the interpreter's lock while a frame's wants it: Python's
own five milliseconds are several frames, and giving way unasked costs more than it brings."""

LIGHT: Final = 0.0005
"""Seconds of work on a frame that may be done while others are waited for."""

REST: Final = 0.01
"""Seconds that the thread waits at least to be called, however often there is to be flushed."""

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

    `flush_seconds`: so often all that there is reaches the disk. `durable`: every frame does,
    before `frame` returns. `say` hears, within `frame` or `close` and so in the caller's thread,
    what the people who watch should know. `past` is the record after whose end the world goes on:
    all that is in it comes first, and it may have the same name. What has that name is kept beside
    it, unless `keep_old` is false. Raises RecordError where the file cannot be begun, and
    MisuseError where mcap is not installed; later, nothing is raised.
    """

    def __init__(
        self,
        path: Path,
        told: Description,
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
        self._told = False
        self._frame: int = 0
        self._durable = durable
        self._flush_seconds = 0.0 if durable else flush_seconds
        self._flush_at = time.monotonic() + self._flush_seconds
        if past is None:
            self._stream = open_for_record(path)
        else:
            self._stream = open_for_record(part_of(path), keep_old=False)
        try:
            self._writer = RecordWriter(self._stream, told, past)
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
        self._helped = False
        self._light = True
        self._stuck = False
        self._closed = False
        self._heard = Backlog()
        self._dropped: int = 0
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()
        sys.setswitchinterval(min(TURN, sys.getswitchinterval()))

    @property
    def frames(self) -> int:
        """How many frames are sure to be in the record."""
        return self._writer.kept

    def frame(
        self,
        record: FrameRecord | FrameDone,
        scene: Scene,
        seconds: float,
        timings: Mapping[str, float] = _NONE,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        """Record a frame; `scene` is the string after it, `seconds` the clock since the beginning.

        Its digest is reckoned when it is written, so that no frame waits for it.
        `timings` are in seconds, by name. The `checkpoint` is that after the frame; without it, a
        world cannot go on from there.
        """
        self._frame = record.frame + 1
        try:
            kept = Kept.of(checkpoint) if checkpoint is not None else None
        except (TypeError, ValueError, OverflowError) as error:
            self._failure = self._failure or f"a member saved what is no plain data: {error}"
        else:
            self._put(_FrameItem(record, scene, seconds, timings, kept))
        self._tell_failure()

    def help(self) -> None:
        """Write what waits, if that is little and may stay in memory; else the thread will.

        For the caller of `frame`, when it has nothing to do. Who calls it once has to go on: the
        thread then relies on it.
        """
        self._helped = True
        if self._durable or not (self._items or self._heard.waiting):
            return
        little = self._light and self._writer.has_room
        if self._heard.waiting or not (little and self._flush_seconds):
            self._called.set()
        elif self._writing.acquire(blocking=False):
            try:
                self._write_next()
            finally:
                self._writing.release()

    def log(self, member: str, text: str, seconds: float, *, warning: bool = False) -> None:
        """Record a line about a member."""
        self._put(_LogItem(self._frame, seconds, member, text, warning))

    def sensed(self, told: Readings, seconds: float) -> None:
        """Record what came on a sensor topic; nothing waits for that. From any thread."""
        self._hear(Heard(told.topic, told.member, told, self._frame, seconds))

    def heard(self, topic: str, member: str, data: bytes, seconds: float) -> None:
        """As `sensed`, of readings as the bus has brought them."""
        self._hear(Heard(topic, member, data, self._frame, seconds))

    def _hear(self, one: Heard) -> None:
        if not (self._failure or self._closed):
            self._heard.put(one)

    def close(self) -> None:
        """Write what is left, and the index. More than once does no harm."""
        if self._closed:
            return
        self._closed = True
        self._called.set()
        self._thread.join(CLOSING_WITHIN)
        if self._thread.is_alive():
            self._failure = self._failure or "the disk does not answer"
        self._tell_failure()
        if self.lost:
            self._say(f"{self.path}: {self.lost} frames are not in the record: the disk was slow")
        if self._heard.dropped:
            self._say(
                f"{self.path}: {self._heard.dropped} messages on topics are not in the record: they"
                " came faster than they were written"
            )

    def _put(self, item: _Item) -> None:
        if self._failure or self._closed:
            return
        if not self._has_room():
            self._leave_out(item)
            return
        self._items.append(item)
        self._given += 1
        self._stuck = False
        if self._durable:
            self._await_disk()
        elif not self._helped or len(self._items) > HELPED_WITHIN:
            self._called.set()

    def _await_disk(self) -> None:
        """Let the thread write: an interrupt ends the waiting for it, and not what it does."""
        while self._flushed < self._given:
            self._written.clear()
            self._called.set()
            if self._flushed < self._given:
                self._written.wait()

    def _has_room(self) -> bool:
        """Whether one more can wait, now or before patience ends; a queue that waits costs more."""
        until = 0.0 if self._stuck else time.monotonic() + PATIENCE
        while len(self._items) >= WAITING:
            self._called.set()
            if time.monotonic() >= until:
                return False
            time.sleep(0.001)
        return True

    def _leave_out(self, item: _Item) -> None:
        if not self._stuck:
            self._say(f"{self.path}: the disk does not keep up; frames are left out until it does")
        self._stuck = True
        self.lost += isinstance(item, _FrameItem)

    def _tell_failure(self) -> None:
        if not self._failure or self._told:
            return
        self._told = True
        self._say(
            f"{self.path}: {self._failure}; the world goes on without a record, of which"
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
        self._carefully(self._write_heard)
        self._carefully(self._writer.finish)
        _shut(self._stream)

    def _write_all(self) -> None:
        """Write all that waits, and flush when it is time: a fast world always lets some wait."""
        more = True
        while more:
            with self._writing:  # Whoever else may want to write gets in between.
                self._write_next()
                self._carefully(self._write_heard)
                if time.monotonic() >= self._flush_at:
                    self._carefully(self._writer.flush)
                    self._flushed = self._taken
                    self._flush_at = time.monotonic() + self._flush_seconds
            more = bool(self._items)

    def _write_next(self) -> None:
        """Write what has waited longest, if another has not; `_writing` is held."""
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

    def _write_heard(self) -> None:
        """Write what waits of sensor topics, unless the world waits; more may come all the time."""
        seconds = 0.0
        for _ in range(self._heard.waiting):
            found = self._heard.take() if len(self._items) < WAITING else None
            if found is None:
                break
            one, told = found
            seconds = one.seconds
            self._writer.sensed(told, one.frame, seconds)
        if self._heard.dropped > self._dropped:
            new, self._dropped = self._heard.dropped - self._dropped, self._heard.dropped
            self._writer.dropped(new, self._frame, seconds)

    def _carefully(self, work: Callable[[], None]) -> None:
        """Whatever goes wrong with a record must not end its world."""
        if self._failure:
            return
        try:
            work()
        except OSError as error:
            self._failure = error.strerror or str(error)
        except Exception as error:
            self._failure = f"{type(error).__name__}: {error}"


def _shut(stream: IO[bytes]) -> None:
    """Close a file; what a full disk has not taken is given up."""
    try:
        stream.close()
    except OSError:
        return
