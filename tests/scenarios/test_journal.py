"""Journals: wherever cut off, they contain all whole frames; each has one writer."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_any_schedule import SETTINGS

from minerva_bus.errors import Followed, RecordError
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import FrameDone, Publish
from minerva_bus.log import journal
from minerva_bus.log.entries import Kept, RecordHeader, encode_checkpoint, encode_header
from minerva_bus.log.journal import Journal, read_journal, resume_from
from tests.memory_bus import BEGIN, MemoryBus


def kept(algorithm):
    """The checkpoint as bytes, so that events in columns are compared by content."""
    return encode_checkpoint(Kept.of(algorithm.checkpoint), None)


both = pytest.mark.parametrize("name", SETTINGS)


class Written:
    """A world that runs in memory, with its journal."""

    def __init__(self, path, name, epoch=7):
        setting = SETTINGS[name]
        self.path, self.world = path, setting.world
        self.bus = MemoryBus(setting.world, setting.members, [self._observe])
        self.journal = Journal(path, epoch, self.bus.algorithm)
        self.bus.start()
        self.bus.settle()

    def _observe(self, notice):
        if isinstance(notice, FrameDone):
            self.journal.members(member.name for member in self.bus.algorithm.members.index.active)
            self.journal.frame(notice.inputs)
            if self.journal.is_long:
                self.journal.rewrite()

    def read(self):
        past = read_journal(self.path, self.world)
        algorithm, seen = FrameAlgorithm(past.world), []
        resume_from(past, algorithm, lambda done: seen.append(done.record.digest.hex()))
        return past, algorithm, seen


@pytest.mark.parametrize(("configured", "expected"), [(20.0, 30.0), (0.0, 0.0), (50.0, 50.0)])
def test_a_rate_that_people_set_stays_unless_another_one_is_configured(
    tmp_path, configured, expected
):
    world = SETTINGS["pond"].world
    started = encode_header(RecordHeader(world, rate=20.0))
    journal = Journal(tmp_path / "w.journal", 7, FrameAlgorithm(world), started)
    journal.pace(30.0, None)
    assert read_journal(tmp_path / "w.journal", world).rate_for(configured) == expected


@both
def test_a_journal_restores_the_state(tmp_path, name):
    written = Written(tmp_path / "w.journal", name)
    for frame in range(6):
        written.bus.frame()
        past, algorithm, seen = written.read()
        assert (past.epoch, algorithm.frame) == (7, frame + 1)
        assert seen == written.bus.digests
        assert kept(algorithm) == kept(written.bus.algorithm)
        assert algorithm.shown == written.bus.algorithm.shown
        assert past.members == set(SETTINGS[name].members)


@both
def test_a_rewritten_journal_continues_from_its_keyframe(tmp_path, name, monkeypatch):
    monkeypatch.setattr(journal, "MIN_REWRITE_BYTES", 1)
    monkeypatch.setattr(journal, "REWRITE_RATIO", 0)
    written = Written(tmp_path / "w.journal", name)
    for frame in range(6):
        written.bus.frame()
        past, algorithm, _ = written.read()
        assert past.inputs == []
        assert past.world.past.frame == frame + 1
        assert algorithm.scene.digest.hex() == written.bus.digests[-1]
        assert algorithm.shown == written.bus.algorithm.shown
        assert kept(algorithm) == kept(written.bus.algorithm)


@both
def test_a_successor_from_a_rewritten_journal_gives_the_same_strings(tmp_path, name):
    """This includes views: hosts send their next views as patches of those already shown."""
    for frames in range(1, 7):
        written = Written(tmp_path / f"{frames}.journal", name)
        for _ in range(frames):
            written.bus.frame()
            if written.bus.algorithm.frame == max(1, frames - 2):
                written.journal.rewrite()
        _, successor, _ = written.read()
        written.bus.kill_coordinator(successor)
        written.journal._algorithm = successor
        written.bus.run()
        assert written.bus.digests == SETTINGS[name].undisturbed[0]


@both
def test_cut_off_anywhere_it_has_all_whole_frames(tmp_path, name):
    written = Written(tmp_path / "w.journal", name)
    ends = [written.path.stat().st_size]
    for _ in range(6):
        written.bus.frame()
        ends.append(written.path.stat().st_size)
    data = written.path.read_bytes()
    for cut in sorted({*range(0, len(data), 997), *ends, ends[3] - 1}):
        written.path.write_bytes(data[:cut])
        whole = sum(end <= cut for end in ends)
        if not whole:
            continue  # It has no header or no frame yet.
        _, algorithm, seen = written.read()
        assert algorithm.frame == whole - 1
        assert seen == written.bus.digests[: whole - 1]


def test_a_bit_that_is_wrong_ends_it_there(tmp_path):
    written = Written(tmp_path / "w.journal", "pond")
    written.bus.frame()
    end = written.path.stat().st_size
    written.bus.frame()
    data = bytearray(written.path.read_bytes())
    data[end + 40] ^= 1
    written.path.write_bytes(data)
    past, algorithm, _ = written.read()
    assert algorithm.frame == 1
    assert past.lost == len(data) - end


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(["flip", "zero", "cut", "append"]), st.floats(0, 1), st.integers(1, 300)
)  # fmt: skip
def test_damage_costs_no_earlier_frame_and_is_reported(six_frames, how, where, much):
    written, ends = six_frames
    data = written.path.read_bytes()
    at = int(where * (len(data) - 1))
    broken = {
        "flip": data[:at] + bytes([data[at] ^ 1 << much % 8]) + data[at + 1 :],
        "zero": data[:at] + bytes(len(data[at : at + much])) + data[at + much :],
        "cut": data[:at],
        "append": data + data[at : at + much] + b"\xff",
    }[how]
    intact = sum(end <= (len(data) if how == "append" else at) for end in ends)
    written.path.write_bytes(broken)
    try:
        past, algorithm, seen = written.read()
    except RecordError as error:
        assert intact == 0
        assert "damaged" in str(error)
    except AttributeError:
        assert broken == b""
    else:
        assert algorithm.frame >= intact - 1
        assert seen == written.bus.digests[: len(seen)]
        assert past.lost or how == "cut" or broken == data
    finally:
        written.path.write_bytes(data)


@pytest.fixture(scope="module")
def six_frames(tmp_path_factory):
    written = Written(tmp_path_factory.mktemp("journals") / "w.journal", "pond")
    ends = [written.path.stat().st_size]
    for _ in range(6):
        written.bus.frame()
        ends.append(written.path.stat().st_size)
    return written, ends


def test_a_succeeded_coordinator_stops_writing(tmp_path):
    first = Written(tmp_path / "w.journal", "pond")
    first.bus.frame()
    followers = []

    def follow():
        followers.append(Written(tmp_path / "w.journal", "pond", epoch=8))

    # Also if that happens while it rewrites its journal.
    for work in (lambda: first.journal.rewrite(follow), first.bus.frame):
        with pytest.raises(Followed, match="another coordinator runs the world"):
            work()
    [second] = followers
    second.bus.frame()
    assert second.read()[0].epoch == 8
    first.journal.close(over=True)
    assert second.path.exists()
    second.journal.close(over=True)
    assert not second.path.exists()


def test_the_journal_of_another_world_is_refused(tmp_path):
    written = Written(tmp_path / "w.journal", "pond")
    with pytest.raises(RecordError, match="belongs to another world"):
        read_journal(written.path, replace(written.world, seed=99))
    written.path.write_bytes(b"no journal at all, but long enough to be one")
    with pytest.raises(RecordError, match="the beginning of this journal is damaged"):
        read_journal(written.path, written.world)
    written.path.write_bytes(b"")
    assert read_journal(written.path, written.world) is None
    assert read_journal(tmp_path / "none", written.world) is None


def test_people_s_events_between_two_frames_are_not_lost(tmp_path):
    written = Written(tmp_path / "w.journal", "pond")
    written.bus.frame()
    algorithm = written.bus.algorithm
    for _ in range(2):  # The second event equals that of the previous frame.
        written.bus.handle(Publish(written.world.vocabulary.events["eAdd"](n=3)))
        written.journal.waiting(algorithm.ordered)
        _, again, _ = written.read()
        assert kept(again) == kept(algorithm)
        assert again.checkpoint.inbox
        written.bus.step(BEGIN)
        written.bus.settle()
        assert written.read()[1].checkpoint.inbox == {}
