"""A record has all state to resume after its last complete frame, with the same future."""

import errno
import io
import struct

import pytest

from minerva_bus.errors import RecordError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import Checkpoint
from minerva_bus.grammar.events import single
from minerva_bus.launch.past import read_resumed
from minerva_bus.launch.run_outputs import recording
from minerva_bus.launch.toml_tables import option_text, toml_value
from minerva_bus.log import channels as c
from minerva_bus.log.chunks import Chunks
from minerva_bus.log.entries import Kept, Keyframe, decode_checkpoint, encode_checkpoint
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.wire.plain import ON_DISK
from minerva_bus.wire.strings_codec import Reader
from tests.log.recorded_runs import (
    CHECKPOINTS,
    ROOT,
    bytes_of,
    description,
    happened,
    record_of,
    world_file,
)

mcap = pytest.importorskip("mcap")

NOISE = {"drive_noise": "0.05", "turn_noise": "1.0", "laser_noise": "0.02"}
RUNS = {
    "meadow": (ROOT / "worlds/minerva_worlds/meadow/meadow.toml", {"frames": 24}),
    "flock": (
        ROOT / "worlds/minerva_worlds/flock/flock.toml",
        {"frames": 16, "options": {"birds": "80"}},
    ),
    "plants": (ROOT / "worlds/minerva_worlds/plants/plants.toml", {"frames": 14}),
    "robot": ("robot", {"frames": 16, "until": "", "options": NOISE}),
    "robots": ("robot", {"frames": 16, "until": "", "options": {**NOISE, "robots": "2"}}),
}


def lived(file, stop=None):
    """Run a world in this process, with a record if its file has one; returns digests and events by frame."""
    algorithm, digests = FrameAlgorithm(file.world), {}
    record = recording(file, algorithm, lambda text: pytest.fail(text))

    def watch(message):
        if isinstance(message, s.FrameDone):
            record.frame_done(message)
            digests[message.frame] = message.record.digest, list(single(message.events))

    runner = InProcessRunner(
        algorithm, [process.make_member() for process in file.processes], watch
    )
    runner.start()
    while runner.ended is None and algorithm.frame != stop:
        runner.handle(s.Begin())
    record.close()
    return digests


@pytest.mark.parametrize("name", RUNS)
def test_a_run_that_is_stopped_anywhere_goes_on_as_if_it_never_was(name, tmp_path):
    world, overrides = RUNS[name]
    whole = lived(world_file(world, **overrides))
    cut, on = tmp_path / "cut.mcap", tmp_path / "on.mcap"
    for stop in (1, 2, 9, max(whole)):
        lived(world_file(world, record=str(cut), **overrides), stop)
        resumed = read_resumed(cut, "", Overrides(record=str(on)))
        assert resumed.world.past.frame == stop
        assert lived(resumed) == {n: digest for n, digest in whole.items() if n >= stop}
        with Record(on) as record:
            digests = [frame.digest for frame, _ in record.strings(check=True)]
        assert digests == [digest for digest, _ in whole.values()]


def test_a_run_that_was_resumed_is_resumed(tmp_path):
    world, overrides = RUNS["meadow"]
    whole, path = lived(world_file(world, **overrides)), tmp_path / "run.mcap"
    lived(world_file(world, record=str(path), **overrides), 5)
    for stop in (9, 15, None):
        after = lived(read_resumed(path, "", Overrides()), stop)
        assert after.items() <= whole.items()
    with Record(path) as record:
        assert [frame.digest for frame in record.frames()] == [
            digest for digest, _ in whole.values()
        ]
        assert record.complete


def test_a_full_disk_leaves_a_resumed_record_unchanged(tmp_path, monkeypatch):
    def full(writer):
        raise OSError(errno.ENOSPC, "No space left on device")

    world, overrides = RUNS["meadow"]
    path = tmp_path / "run.mcap"
    lived(world_file(world, record=str(path), **overrides), 5)
    before = path.read_bytes()
    monkeypatch.setattr(RecordWriter, "flush", full)
    with pytest.raises(RecordError, match="cannot be written: No space left on device"):
        lived(read_resumed(path, "", Overrides()))
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
    assert path.read_bytes() == before


def test_a_coordinator_that_follows_does_not_go_on_in_the_record_of_another_world(tmp_path):
    world, overrides = RUNS["meadow"]
    path, said = tmp_path / "run.mcap", []
    lived(world_file(world, record=str(path), **overrides), 5)
    before = path.read_bytes()
    other = world_file(world, record=str(path), seed=5, **overrides)
    recording(other, FrameAlgorithm(other.world), said.append, again=True).close()
    assert said == [
        f"{path}: it is the record of another world: seed 7 is recorded, 5 is wanted;"
        " the world continues without a record"
    ]
    assert path.read_bytes() == before


def test_settings_of_a_resumed_run_apply_to_the_next_one(tmp_path):
    world, overrides = RUNS["flock"]
    path = tmp_path / "run.mcap"
    lived(world_file(world, record=str(path), **overrides), 5)
    lived(read_resumed(path, "", Overrides(frames=30, name="later")), 12)
    last = read_resumed(path, "", Overrides())
    assert (last.world.frames, last.world.name, last.options["birds"]) == (30, "later", 80)
    with Record(path) as record:
        assert record.description.world.scene == record.string(0) != last.world.scene


@pytest.mark.parametrize("name", ["meadow", "flock", "robot"])
def test_a_record_that_is_cut_off_has_its_last_whole_checkpoint(name, tmp_path):
    _, frames = happened(name)
    data = bytes_of(name, flush_every=3, finished=False)
    digests = [happened(name)[0].world.scene.digest, *(string.digest for string, _ in frames)]
    with record_of(data, tmp_path) as record:
        first = record._chunks.places[1].begin
    for size in range(first, len(data), max(1, (len(data) - first) // 12)):
        with record_of(data[:size], tmp_path) as record:
            checkpoint, scene = record.end()
            assert scene.digest == digests[checkpoint.frame]
            if checkpoint.frame:
                kept = CHECKPOINTS[name, None][checkpoint.frame - 1]
                assert Kept.of(checkpoint).saved == kept.saved
                assert checkpoint.emitted == kept.checkpoint.emitted
                assert checkpoint.inbox == kept.checkpoint.inbox


def test_a_checkpoint_lists_new_data(tmp_path):
    vocabulary = happened("meadow")[0].world.vocabulary
    event = vocabulary.events["eStep"]()
    reader = Reader(vocabulary, ON_DISK)
    first = Checkpoint(3, {"a": {"n": 1}, "b": {"n": [2.5]}}, (event,), {"x": (event, event)})
    second = Checkpoint(4, {"a": {"n": 1}, "b": {"n": [3]}}, reached=frozenset("pq"))
    third = Checkpoint(6, second.saved, reached=frozenset("pqr"), reaching=frozenset(["AFox"]))
    listed, before = Checkpoint(), None
    for string in (first, second, third):
        kept = Kept.of(string)
        step = decode_checkpoint(encode_checkpoint(kept, before), reader)
        assert step.whole == (before is None)
        listed, before = step.after(listed), kept
        assert listed == string
    assert decode_checkpoint(encode_checkpoint(Kept.of(second), Kept.of(first)), reader).new == (
        Checkpoint(4, {"b": {"n": [3]}}, reached=frozenset("pq"))
    )
    assert encode_checkpoint(Kept.of(Checkpoint(7, third.saved, (), {}, third.reached,
                             third.reaching)), Kept.of(third)) == b""  # fmt: skip


def written(checkpoints, folder, last=None):
    """A record of frames with these checkpoints, optionally with one more of a torn frame."""
    file, frames = happened("meadow")
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    for (record, string), checkpoint in zip(frames, checkpoints, strict=False):
        writer.frame(record, string, 0.0, {}, Kept.of(checkpoint))
        writer.flush()
    if last is not None:
        writer._file.put(
            c.CHECKPOINT, encode_checkpoint(Kept.of(last), None), last.frame, 0.0, last.frame
        )
    writer.finish()
    return record_of(stream.getvalue(), folder)


def test_delivered_events_are_not_repeated(tmp_path):
    event = happened("meadow")[0].world.vocabulary.events["eStep"]()
    saved = {"a": {"n": 1}}
    checkpoints = [Checkpoint(1, saved, (event,), {"x": (event,)}), Checkpoint(2, saved)]
    checkpoints.append(Checkpoint(3, saved))
    with written(checkpoints[:1], tmp_path) as record:
        assert record.end()[0] == checkpoints[0]
    with written(checkpoints, tmp_path) as record:
        assert record.end()[0] == checkpoints[2]


def test_the_checkpoint_of_a_frame_that_was_cut_off_does_not_count(tmp_path):
    checkpoints = [Checkpoint(1, {"a": {"n": 1}}), Checkpoint(2, {"a": {"n": 2}})]
    torn = Checkpoint(3, {"a": {"n": 3}})
    with written(checkpoints, tmp_path, torn) as record:
        assert record.end()[0] == checkpoints[1]
        topics = [topic for topic, _ in record.messages(2)]
        assert topics.count(c.CHECKPOINT) == 2


def test_later_changes_are_not_in_an_earlier_checkpoint():
    state = {"n": 1}
    kept = Kept.of(Checkpoint(1, {"a": state}))
    state["n"] = 2
    assert kept.saved != Kept.of(Checkpoint(1, {"a": state})).saved


def test_checkpoints_are_small(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes_of("robot"))
    chunks = Chunks(path)
    sizes: dict[str, int] = {c.CHECKPOINT: 0, c.FRAME: 0}
    for topic, message in chunks.messages(sizes):
        sizes[topic] += len(message.data)
    chunks.close()
    assert 0 < sizes[c.CHECKPOINT] < sizes[c.FRAME] / 10


def test_a_record_without_checkpoints_is_reported(tmp_path):
    file, frames = happened("meadow")
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    for record, string in frames:
        writer.frame(record, string, 0.0, {})
    writer.finish()
    with record_of(stream.getvalue(), tmp_path) as record:
        assert record.intact_end() == Keyframe(len(frames), frames[-1][1])
        with pytest.raises(RecordError, match="it has no checkpoints, so the run cannot be res"):
            record.end()


@pytest.mark.parametrize(
    "data", [b"\x90", b"\xc1", struct.pack("<d", 1.0)], ids=["empty", "never", "float"]
)
def test_an_invalid_checkpoint_is_rejected(data):
    reader = Reader(happened("meadow")[0].world.vocabulary, ON_DISK)
    with pytest.raises(Exception, match=r"checkpoint|msgpack|list"):
        decode_checkpoint(data, reader)


@pytest.mark.parametrize(
    "value", ["a text", True, 3, 2.5, [1, "b"], {"kitchen": [3.0, 4.5]}, {"a b": False}, 1e-7]
)
def test_options_are_read_back_as_they_were(value):
    shown = option_text(value)
    assert (shown if isinstance(value, str) else toml_value(shown)) == value


def test_waiting_events_of_people_are_in_the_frame(tmp_path):
    world, overrides = RUNS["meadow"]
    file = world_file(world, record=str(tmp_path / "cut.mcap"), **overrides)
    algorithm = FrameAlgorithm(file.world)
    record = recording(file, algorithm, lambda text: pytest.fail(text))
    order = file.world.vocabulary.events["eStep"]()

    def watch(message):
        if isinstance(message, s.FrameDone):
            algorithm.inbox.events["~order"] = [order] if message.frame == 3 else []
            record.frame_done(message)

    runner = InProcessRunner(
        algorithm, [process.make_member() for process in file.processes], watch
    )
    runner.start()
    while algorithm.frame < 4:
        runner.handle(s.Begin())
    record.close()
    past = read_resumed(tmp_path / "cut.mcap", "", Overrides()).world.past
    assert past.inbox == {"~order": (order,)}
