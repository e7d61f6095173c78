"""Recording never disturbs the world, with a slow or a full disk."""

import errno
import io
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path
from typing import ClassVar, cast

import pytest

from minerva_bus.api import running as records
from minerva_bus.errors import MisuseError, RecordError
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import record_writer
from minerva_bus.log import recorder as module
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.log.recorder import HELPED_WITHIN, Recorder
from tests.log.recorded_runs import description, happened, record_of, strings_of

mcap = pytest.importorskip("mcap")


class Disk(io.BytesIO):
    """A file that blocks until it is released, and is full after `full_after` bytes.

    `when_asked` is called once, at the next write.
    """

    def __init__(self, full_after=None):
        super().__init__()
        self.full_after = full_after
        self.free = threading.Event()
        self.free.set()
        self.asked = threading.Event()
        self.when_asked: Callable[[], object] | None = None
        self.kept = b""

    def write(self, data):
        self.asked.set()
        if self.when_asked is not None:
            call, self.when_asked = self.when_asked, None
            call()
        self.free.wait()
        if self.full_after is not None and self.tell() + len(data) > self.full_after:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)

    def close(self):
        self.kept = self.getvalue()


def recorder_on(monkeypatch, disk, **settings):
    said = []
    monkeypatch.setattr(module, "open_for_record", lambda path: disk)
    file, _ = happened("meadow")
    settings = {"say": said.append, **settings}
    return Recorder(Path("run.mcap"), description(file), **settings), said


def recorder_in(folder, **settings):
    """The path of a new record, its recorder, and the frames of a run."""
    file, frames = happened("meadow")
    path = folder / "run.mcap"
    return path, Recorder(path, description(file), **settings), frames


def put(recorder, frames):
    for record, string in frames:
        recorder.frame(record, string, 0.0)


@pytest.mark.parametrize("large", [0, record_writer.LARGE])
@pytest.mark.parametrize("durable", [False, True])
def test_a_run_is_recorded(durable, large, tmp_path, monkeypatch):
    monkeypatch.setattr(record_writer, "LARGE", large)
    said = []
    path, recorder, frames = recorder_in(tmp_path, durable=durable, say=said.append)
    recorder.log("steps", "hello", 0.0)
    put(recorder, frames)
    recorder.close()
    recorder.close()
    assert not said
    assert recorder.frames == len(frames)
    with Record(path) as record:
        assert record.complete
        assert [string for _, string in record.strings(check=True)] == strings_of("meadow")[1:]
        assert [line.text for line in record.log()] == ["hello"]


@pytest.mark.parametrize("seconds", [-43_200, 0])
def test_a_clock_before_1970_counts_as_1970(seconds, tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    monkeypatch.setattr(time, "time_ns", lambda: seconds * 10**9)
    run = records.record("meadow", path, frames=4)
    with Record(path) as early:
        assert early.description.began == 0
        assert early.complete
        assert [frame.number for frame, _ in early.strings(check=True)] == [0, 1, 2, 3]
    # Then the clock is set, and later its battery is empty again.
    monkeypatch.setattr(time, "time_ns", lambda: 2 * 10**18)
    assert records.resume(path, frames=6).frames == run.frames + 2
    later = records.record("meadow", path, frames=4)
    assert later.digest == run.digest
    monkeypatch.setattr(time, "time_ns", lambda: seconds * 10**9)
    records.resume(path, frames=6)
    with Record(path) as done:
        wall = [frame.seconds for frame in done.frames()]
        assert len(wall) == 6
        assert min(wall) >= 0.0


def test_a_log_line_appears_in_its_frame(tmp_path):
    path, recorder, frames = recorder_in(tmp_path)
    for record, string in frames[:5]:
        recorder.frame(record, string, 0.0)
        recorder.log("foxes", f"after {record.frame}", 0.0, warning=True)
    recorder.close()
    with Record(path) as read:
        assert [(line.time, line.text) for line in read.log()] == [
            (pytest.approx((n + 1) * happened("meadow")[0].world.dt), f"after {n}")
            for n in range(5)
        ]


def test_durable_frames_are_there_before_the_next(tmp_path):
    path, recorder, frames = recorder_in(tmp_path, durable=True)
    for record, string in frames[:4]:
        recorder.frame(record, string, 0.0)
        with Record(path) as so_far:
            assert not so_far.complete
            assert so_far.string(record.frame + 1) == string
    recorder.close()


def test_an_interrupt_in_the_midst_of_a_frame_leaves_it_whole(tmp_path, monkeypatch):
    disk = Disk()
    recorder, said = recorder_on(monkeypatch, disk, durable=True)
    frames = happened("meadow")[1]
    put(recorder, frames[:4])
    disk.when_asked = partial(signal.pthread_kill, threading.get_ident(), signal.SIGINT)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            recorder.frame(*frames[4], 0.0)
    finally:
        signal.signal(signal.SIGINT, before)
    recorder.close()
    assert not said
    with record_of(disk.kept, tmp_path) as record:
        assert [string for _, string in record.strings(check=True)] == strings_of("meadow")[1:6]


def test_written_frames_are_flushed_after_a_while(tmp_path):
    path, recorder, frames = recorder_in(tmp_path, flush_seconds=0.01)
    recorder.frame(*frames[0], 0.0)
    while recorder.frames < 1:
        threading.Event().wait(0.005)
    with Record(path) as so_far:
        assert so_far.string(1) == frames[0][1]
    recorder.close()


@pytest.mark.skipif(not hasattr(os, "posix_fadvise"), reason="this system has no posix_fadvise")
def test_the_system_begins_to_write_each_chunk_before_a_flush(tmp_path, monkeypatch):
    parts = []
    monkeypatch.setattr(record_writer, "CHUNK", 4_000)
    monkeypatch.setattr(os, "posix_fadvise", lambda file, *part: parts.append(part))
    path, recorder, frames = recorder_in(tmp_path, flush_seconds=1000.0)
    put(recorder, frames)
    recorder.close()
    ends = [0, 0, *(begin + size for begin, size, _ in parts)]
    # Each chunk twice: what the system has written by then leaves the memory.
    assert [begin for begin, _, _ in parts] == ends[:-2]
    assert sorted(set(ends[1:])) == ends[1:]
    assert {advice for _, _, advice in parts} == {os.POSIX_FADV_DONTNEED}
    assert path.stat().st_size / 2 < ends[-1] < path.stat().st_size


def test_a_flush_leaves_all_frames_in_the_file(tmp_path):
    path, recorder, frames = recorder_in(tmp_path, flush_seconds=1000.0)
    put(recorder, frames[:4])
    recorder.flush()
    with Record(path) as so_far:
        assert so_far.string(4) == frames[3][1]
    recorder.close()


def test_a_flush_ends_if_the_disk_stands_still(monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.01)
    disk = Disk()
    recorder, _ = recorder_on(monkeypatch, disk)
    disk.free.clear()
    recorder.frame(*happened("meadow")[1][0], 0.0)
    recorder.flush()
    assert recorder.frames == 0
    disk.free.set()
    recorder.close()


@pytest.mark.parametrize("durable", [False, True])
@pytest.mark.parametrize("room", [9_000, 12_000, 20_000])
def test_a_full_disk_is_reported_once_and_written_frames_are_readable(
    durable, room, tmp_path, monkeypatch
):
    disk = Disk(full_after=room)
    recorder, said = recorder_on(monkeypatch, disk, durable=durable, flush_seconds=0.0)
    put(recorder, happened("meadow")[1])
    recorder.close()
    [message] = said
    assert message.startswith(
        "run.mcap: No space left on device; the world continues without a record, of which"
    )
    with record_of(disk.kept, tmp_path) as record:
        read = [string for _, string in record.strings(check=True)]
    assert not record.complete
    assert int(message.rpartition("of which ")[2].split(" frames or more")[0]) <= len(read) < 60
    assert recorder.lost == 60 - recorder.frames
    assert read == strings_of("meadow")[1 : len(read) + 1]


def test_a_disk_that_is_full_from_the_beginning():
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    file, _ = happened("meadow")
    with pytest.raises(RecordError, match="/dev/full: cannot be written: No space left"):
        Recorder(Path("/dev/full"), description(file))


def test_a_place_where_nothing_can_be_written(tmp_path):
    file, _ = happened("meadow")
    with pytest.raises(RecordError, match="cannot be written: No such file"):
        Recorder(tmp_path / "none" / "run.mcap", description(file))


def test_a_thread_that_is_to_flush_at_once_waits_to_be_called(monkeypatch):
    class Watched(threading.Event):
        waited: ClassVar[list] = []

        def wait(self, timeout=None):
            self.waited.append(timeout)
            return super().wait(timeout)

    monkeypatch.setattr(threading, "Event", Watched)
    recorder, _ = recorder_on(monkeypatch, Disk(), flush_seconds=0.0)
    while len(Watched.waited) < 3:
        recorder.idle()
    recorder.close()
    assert 0.0 not in Watched.waited


@pytest.mark.parametrize("large", [0, record_writer.LARGE])
def test_an_unencodable_value_ends_the_record_but_not_the_world(large, monkeypatch):
    monkeypatch.setattr(record_writer, "LARGE", large)
    recorder, said = recorder_on(monkeypatch, Disk())
    record, _ = happened("meadow")[1][0]
    recorder.frame(record, cast("Scene", "no string"), 0.0)
    recorder.close()
    assert len(said) == 1
    assert "the world continues without a record" in said[0]


def test_a_disk_that_stands_still_holds_nothing_up_for_long(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.01)
    disk = Disk()
    recorder, said = recorder_on(monkeypatch, disk, flush_seconds=0.0)
    disk.free.clear()
    disk.asked.clear()
    frames = happened("meadow")[1]
    recorder.frame(*frames[0], 0.0)
    disk.asked.wait()  # The thread is blocked in a write and takes no more frames.
    put(recorder, frames[1:50])
    assert recorder.lost == 49 - module.WAITING
    assert [text for text in said if "disk too slow; dropping frames" in text] == said[:1]
    disk.free.set()
    while recorder.frames < 50 - recorder.lost:
        threading.Event().wait(0.005)
    put(recorder, frames[50:])
    recorder.close()
    with record_of(disk.kept, tmp_path) as record:
        read = {frame.number: string for frame, string in record.strings(check=True)}
    assert len(read) == 60 - recorder.lost
    assert read[59] == frames[59][1]


def test_the_world_waits_for_a_slow_disk_and_nothing_is_lost(tmp_path, monkeypatch):
    disk = Disk()
    recorder, said = recorder_on(monkeypatch, disk, flush_seconds=0.0)
    disk.free.clear()
    done = threading.Event()

    def world():
        put(recorder, happened("meadow")[1])
        done.set()

    monkeypatch.setattr(module, "PATIENCE", 60.0)
    happened("meadow")
    thread = threading.Thread(target=world)
    thread.start()
    assert not done.wait(0.05)
    disk.free.set()
    thread.join()
    recorder.close()
    assert not said
    with record_of(disk.kept, tmp_path) as record:
        assert len(list(record.frames())) == 60


@pytest.mark.parametrize("durable", [False, True])
@pytest.mark.parametrize("ends", [False, True])
def test_a_world_that_waits_for_the_disk_says_so(durable, ends, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SAID_AFTER", 0.01)
    monkeypatch.setattr(module, "LOOK_SECONDS", 0.01)
    monkeypatch.setattr(module, "LOOK_SECONDS", 0.01)
    disk, said = Disk(), []

    def say(text):
        said.append(text)
        # As a world does, whose record has its log, too.
        recorder.log("record", text, 0.0)
        disk.free.set()

    recorder, _ = recorder_on(monkeypatch, disk, say=say, durable=durable, flush_seconds=0.0)
    if not ends:
        disk.free.clear()
    put(recorder, happened("meadow")[1])
    if ends:
        recorder.flush()
        disk.free.clear()
    recorder.close()
    assert re.fullmatch(
        r"run\.mcap: frame \d+ has been waiting for the disk for \d+\.\d s", said[0]
    )
    assert recorder.lost == 0
    with record_of(disk.kept, tmp_path) as record:
        assert len(list(record.frames())) == 60


def test_written_frames_are_flushed_while_others_wait(monkeypatch):
    kept, frame = [], RecordWriter.frame
    left = iter(happened("meadow")[1])

    def written(self, *what):
        kept.append(self.kept)
        put(recorder, islice(left, 1))
        frame(self, *what)

    monkeypatch.setattr(RecordWriter, "frame", written)
    recorder, _ = recorder_on(monkeypatch, Disk(), flush_seconds=0.0)
    recorder.frame(*next(left), 0.0)
    while len(kept) < 60:
        threading.Event().wait(0.005)
    recorder.close()
    assert kept == list(range(60))


def test_an_earlier_record_is_kept(tmp_path):
    for count in (1, 2, 3):
        path, recorder, frames = recorder_in(tmp_path)
        put(recorder, frames[:count])
        recorder.close()
    with Record(path) as new, Record(tmp_path / "run.old.mcap") as old:
        assert len(list(new.frames())) == 3
        assert len(list(old.frames())) == 2


def test_without_the_library_nothing_is_touched(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    path = tmp_path / "run.mcap"
    path.write_text("an earlier one")
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[record\]'"):
        Recorder(path, description(happened("meadow")[0]))
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[record\]'"):
        Record(path)
    assert path.read_text() == "an earlier one"


def writers_of(monkeypatch):
    """Names of the threads that write frames, in order."""
    threads, frame = [], RecordWriter.frame

    def written(self, *what):
        threads.append(threading.current_thread().name)
        frame(self, *what)

    monkeypatch.setattr(RecordWriter, "frame", written)
    return threads


def test_small_frames_are_written_by_an_idle_thread(monkeypatch):
    writers = writers_of(monkeypatch)
    monkeypatch.setattr(module, "LIGHT", 60.0)
    monkeypatch.setattr(record_writer, "ALONE", record_writer.CHUNK)  # One chunk is enough.
    recorder, said = recorder_on(monkeypatch, Disk(), flush_seconds=60.0)
    recorder.idle()
    for record, string in happened("meadow")[1]:
        recorder.frame(record, string, 0.0)
        recorder.idle()
        recorder.idle()
    assert writers == ["MainThread"] * 60
    recorder.close()
    assert not said
    assert recorder.frames == 60


@pytest.mark.parametrize("why", ["much to do", "much in memory"])
def test_large_frames_are_left_to_the_thread(why, monkeypatch):
    writers = writers_of(monkeypatch)
    if why == "much to do":
        monkeypatch.setattr(module, "LIGHT", -1.0)
    else:
        monkeypatch.setattr(RecordWriter, "has_room", property(lambda self: False))
    recorder, _ = recorder_on(monkeypatch, Disk(), flush_seconds=60.0)
    recorder.idle()
    frames = happened("meadow")[1]
    for record, string in frames[:2]:
        recorder.frame(record, string, 0.0)
        recorder.idle()
        while len(writers) <= record.frame:
            threading.Event().wait(0.001)
    recorder.close()
    assert writers[1] == "recorder"


def test_a_large_string_is_left_to_the_thread(monkeypatch):
    """A key frame with the whole string can be due after a small frame."""
    whole, put = [], RecordWriter._put_keyframe

    def written(self, *what):
        whole.append(threading.current_thread().name)
        put(self, *what)

    monkeypatch.setattr(RecordWriter, "_put_keyframe", written)
    monkeypatch.setattr(module, "LIGHT", 60.0)
    monkeypatch.setattr(record_writer, "KEY_AFTER", 4)
    monkeypatch.setattr(
        record_writer, "SMALL", 4_000
    )  # Less than the string, more than most frames.
    recorder, said = recorder_on(monkeypatch, Disk(), flush_seconds=60.0)
    recorder.idle()
    for record, string in happened("meadow")[1]:
        recorder.frame(record, string, 0.0)
        while recorder._work.queue:
            recorder.idle()
    recorder.close()
    assert not said
    assert whole[0] == "MainThread"  # The recorder writes the first string before any frame.
    assert set(whole[1:]) == {"recorder"}


def test_frames_are_written_without_help(monkeypatch):
    writers = writers_of(monkeypatch)
    recorder, _ = recorder_on(monkeypatch, Disk(), flush_seconds=60.0)
    recorder.idle()  # The only call of `idle`.
    put(recorder, happened("meadow")[1][: HELPED_WITHIN + 1])
    while len(writers) <= HELPED_WITHIN:
        threading.Event().wait(0.001)
    recorder.close()
    assert set(writers) == {"recorder"}


def test_the_helping_thread_never_waits_for_the_disk(monkeypatch):
    disk = Disk()
    recorder, _ = recorder_on(monkeypatch, disk, flush_seconds=0.01)
    disk.free.clear()
    disk.asked.clear()
    frames = happened("meadow")[1]
    recorder.frame(*frames[0], 0.0)
    disk.asked.wait()  # The thread is blocked in a write.
    for record, string in frames[1 : module.WAITING]:
        recorder.frame(record, string, 0.0)
        recorder.idle()
    disk.free.set()
    recorder.close()
    assert recorder.frames == module.WAITING
    assert not recorder.lost


def test_frames_are_in_order_with_either_writer(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "LIGHT", 60.0)
    writers = writers_of(monkeypatch)
    disk = Disk()
    recorder, _ = recorder_on(monkeypatch, disk, flush_seconds=0.01)
    for record, string in happened("meadow")[1]:
        recorder.frame(record, string, 0.0)
        if record.frame % 3:
            recorder.idle()
    recorder.close()
    assert len(writers) == 60
    with record_of(disk.kept, tmp_path) as record:
        assert [string for _, string in record.strings(check=True)] == strings_of("meadow")[1:]
