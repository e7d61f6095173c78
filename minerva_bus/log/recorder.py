"""Records a world while it runs, on a thread of its own.

Only the recorder's thread accesses the disk, so frames do not wait for it. Frames are encoded in
memory. If that takes little time (`recording_thread.LIGHT`), the thread that runs the frames does
it while it waits for members: two threads that compete for the interpreter cost more than the work
itself.

Up to `WAITING` frames are queued. If the queue is full, the world waits, because a record with gaps
cannot be replayed. If the disk makes no progress for `PATIENCE` seconds, frames are dropped until
it does, and their number is reported. The strings after a gap are still correct, because a
frame is written as the delta from the last written frame.

If the disk is full, the world continues without a record; flushed data stay readable.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import IO, Final

from minerva_bus.frame.inputs import Checkpoint
from minerva_bus.frame.messages import FrameRecord, Readings
from minerva_bus.frame.pace import BackOff
from minerva_bus.frame.stimuli import FrameDone
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.checkpoints import Kept
from minerva_bus.log.description import Description
from minerva_bus.log.errors import RecordError, check_installed
from minerva_bus.log.mcap_file import open_for_record, part_of, take_name
from minerva_bus.log.queues import Pending, Sensed
from minerva_bus.log.reader import Record
from minerva_bus.log.recording_thread import RecordingThread, shut
from minerva_bus.log.writer import RecordWriter
from minerva_bus.world.operator import PersonOperation

HELPED_WITHIN: Final = 4
"""Queued frames that may wait for `idle` before the thread is woken."""

SAID_AFTER: Final = 1.0
"""Seconds of waiting for the disk after which it is reported."""

TURN: Final = 0.001
"""Seconds after which the recorder's thread releases the interpreter's lock. Python's default of
five milliseconds is several frames; releasing it more often costs more than it gains."""


_NO_TIMINGS: Mapping[str, float] = {}


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
        self._say = say
        self._durable = durable
        self._is_helped = False
        self._is_reported = False
        self._is_saying = False
        self._reports = BackOff()
        stream, self._writer = _opened(path, description, past, keep_old=keep_old)
        self._work = RecordingThread(stream, self._writer, flush_seconds, durable=durable)
        # The shorter of both, because the embedding program may have chosen its own.
        sys.setswitchinterval(min(TURN, sys.getswitchinterval()))

    @property
    def frames(self) -> int:
        """Number of frames that are certain to be in the record."""
        return self._writer.kept

    @property
    def lost(self) -> int:
        """Number of frames that were dropped because the disk was too slow."""
        return self._work.queue.lost

    def frame(
        self,
        record: FrameRecord | FrameDone,
        scene: Scene,
        seconds: float,
        timings: Mapping[str, float] = _NO_TIMINGS,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        """Record a frame; `scene` is the string after it, `seconds` the time since the beginning.

        The digest is computed when the frame is written, so no frame waits for it. `timings` are
        in seconds, by name. `checkpoint` is that after the frame; a run can only be resumed if
        there is one.
        """
        self._work.frame = record.frame + 1
        try:
            # Copied now, because members may change their saved objects later.
            kept = Kept.of(checkpoint) if checkpoint is not None else None
        except (TypeError, ValueError, OverflowError) as error:
            self._work.fail(f"a member saved data that are not plain: {error}")
        else:
            write = partial(self._writer.frame, record, scene, seconds, timings, kept)
            self._put(Pending(write, is_frame=True))
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
        # Reported at the end, because a message for each dropped frame would fill the log.
        if self.lost:
            self._say(
                f"{self.path}: {self.lost} frames are not in the record: the disk was too slow"
            )
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
        # A caller that helps encodes small frames itself; waking the
        # thread for each would cost more.
        elif not self._is_helped or len(work.queue) > HELPED_WITHIN:
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
            f" {self._writer.kept} frames can be read"
        )


def _opened(
    path: Path, description: Description, past: Record | None, *, keep_old: bool
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
