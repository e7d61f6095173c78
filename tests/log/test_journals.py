"""The length of a journal, and its keyframes."""

import os

import pytest
from harbour import harbour

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import FrameInputs
from minerva_bus.launch.run_outputs import next_epoch
from minerva_bus.log import journal
from minerva_bus.log.journal import Journal, read_journal
from minerva_bus.wire.codec import stamp, stamped

INPUTS = FrameInputs(0, (), {}, {}, (), (), {})


@pytest.fixture
def written(tmp_path):
    kept = Journal(tmp_path / "w.journal", 1, FrameAlgorithm(harbour().read().world))
    yield kept
    kept.close(over=True)


def frames_until(written, condition):
    return next(count for count in range(1, 10_000) if not written.frame(INPUTS) and condition())


def test_a_journal_does_not_grow_with_each_rewriting(written, monkeypatch):
    monkeypatch.setattr(journal, "MIN_REWRITE_BYTES", 1)
    counts, saved, world = [], [], harbour().read().world
    for _ in range(3):
        counts.append(frames_until(written, lambda: written.is_long))
        # The former journal has its name until all else is saved.
        written.rewrite(lambda: saved.append(len(read_journal(written.path, world).inputs)))
    assert saved == counts
    assert len(set(counts)) == 1


def test_keyframes_have_many_frames_between_them_that_are_longer(written, monkeypatch):
    frames = frames_until(written, lambda: written.is_keyframe_due)
    assert frames == journal.KEY_FRAMES
    written.add_keyframe()
    assert frames_until(written, lambda: written.is_keyframe_due) == frames
    monkeypatch.setattr(journal, "KEY_RATIO", 100)
    written.rewrite()
    assert not written.is_keyframe_due
    assert frames_until(written, lambda: written.is_keyframe_due) > frames


def test_writes_may_be_partial(tmp_path, monkeypatch):
    """As on a disk that is nearly full."""
    world, write = harbour().read().world, os.write
    monkeypatch.setattr(journal.os, "write", lambda file, data: write(file, data[:7]))
    written = Journal(tmp_path / "w.journal", 1, FrameAlgorithm(world))
    written.members(["a", "b"])
    monkeypatch.undo()
    assert read_journal(written.path, world).members == {"a", "b"}


@pytest.mark.parametrize("now", [-86_400.5, 0.5])
def test_epochs_rise_from_0_with_any_clock(now, tmp_path):
    world = harbour().read().world
    first = next_epoch(None, now)
    assert (first, stamped(stamp(first))[0]) == (0, 0)
    Journal(tmp_path / "w.journal", first, FrameAlgorithm(world))
    assert next_epoch(read_journal(tmp_path / "w.journal", world), now) == 1


def test_frames_that_a_paused_world_may_run_are_deducted_not_noted_again(written):
    written.pace(30.0, 5)
    written.frame(INPUTS)
    size = written.path.stat().st_size
    written.pace(30.0, 4)
    assert written.path.stat().st_size == size
    written.pace(30.0, 3)
    assert written.path.stat().st_size > size


def test_only_its_owner_may_read_a_journal(tmp_path):
    path = tmp_path / "own" / "w.journal"
    Journal(path, 1, FrameAlgorithm(harbour().read().world)).close(over=False)
    assert [each.stat().st_mode & 0o777 for each in (path, path.parent)] == [0o600, 0o700]
