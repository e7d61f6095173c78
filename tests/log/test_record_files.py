"""Records round-trip from any position, also through other MCAP readers."""

import io
import json

import pytest

from minerva_bus.errors import RecordError
from minerva_bus.grammar.events import single
from minerva_bus.log import channels as c
from minerva_bus.log import chunks, record_writer
from minerva_bus.log.entries import encode_frame, encode_header
from minerva_bus.log.record_writer import RecordWriter
from tests.log.recorded_runs import (
    bytes_of,
    description,
    fits,
    happened,
    others,
    record_of,
    strings_of,
)

mcap = pytest.importorskip("mcap")

NAMES = ["meadow", "flock", "robot"]


@pytest.mark.parametrize("name", NAMES)
def test_frames_and_strings_survive_a_round_trip(name, tmp_path):
    _, frames = happened(name)
    with record_of(bytes_of(name), tmp_path) as record:
        read = list(record.strings(check=True))
    assert record.complete
    assert [frame.number for frame, _ in read] == list(range(len(frames)))
    for (frame, string), (done, after) in zip(read, frames, strict=True):
        assert string == after
        assert frame.digest == done.digest
        assert list(single(frame.events)) == list(single(done.events))
        assert frame.seconds == pytest.approx(0.01 * frame.number)


def test_large_populations_are_packed_quickly(tmp_path, monkeypatch):
    monkeypatch.setattr(record_writer, "LARGE", 80 * 4 * 8)
    _, frames = happened("flock")
    with record_of(bytes_of("flock", 20), tmp_path) as record:
        assert {place.packing for place in record._chunks.places} == {"lz4"}
        assert [string for _, string in record.strings(check=True)] == [w for _, w in frames]


@pytest.mark.parametrize("name", NAMES)
def test_the_description_survives_a_round_trip(name, tmp_path):
    file, _ = happened(name)
    with record_of(bytes_of(name), tmp_path) as record:
        described = record.description
    assert encode_header(described) == encode_header(description(file))
    world = described.world
    assert world.scene == file.world.scene
    assert (world.seed, world.dt, world.until) == (file.world.seed, file.world.dt, file.world.until)
    assert (world.order, world.policy) == (file.world.order, file.world.policy)
    assert described.file == file.path.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("flush_every", [1, 8, 1000])
def test_any_string_can_be_had(name, flush_every, tmp_path):
    strings = strings_of(name)
    with record_of(bytes_of(name, flush_every), tmp_path) as record:
        for number in [*range(len(strings) - 1, -1, -3), 0]:
            assert record.string(number) == strings[number]
        with pytest.raises(RecordError, match="is not in the record"):
            record.string(len(strings))


def test_seeking_does_not_begin_at_the_beginning(tmp_path, monkeypatch):
    strings = strings_of("meadow")
    with record_of(bytes_of("meadow", 1), tmp_path) as record:
        read, unpacked = [], chunks._unpacked
        monkeypatch.setattr(
            chunks, "_unpacked", lambda file, place: read.append(1) or unpacked(file, place)
        )
        assert record.string(len(strings) - 1) == strings[-1]
        assert len(read) < len(strings) / 2


def test_frames_that_were_left_out_leave_all_others_right(tmp_path):
    file, frames = happened("meadow")
    kept = [pair for pair in frames if pair[0].frame % 5 not in (1, 2)]
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    for done, string in kept:
        writer.frame(done, string, 0.0, {})
    writer.finish()
    with record_of(stream.getvalue(), tmp_path) as record:
        read = [(frame.number, string) for frame, string in record.strings(check=True)]
        assert read == [(done.frame, string) for done, string in kept]
        assert record.string(6) == frames[5][1]
        with pytest.raises(RecordError, match="frame 7 is not in the record"):
            record.string(7)


def test_a_wrong_digest_is_found(tmp_path, monkeypatch):
    file, frames = happened("meadow")
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    for done, string in frames[:2]:
        writer.frame(done, string, 0.0, {})
    wrong = lambda number, events, edit, _: encode_frame(number, events, edit, bytes(16))  # noqa: E731
    monkeypatch.setattr("minerva_bus.log.record_writer.encode_frame", wrong)
    writer.frame(*frames[2], 0.0, {})
    writer.finish()
    with record_of(stream.getvalue(), tmp_path) as record:
        assert len(list(record.strings())) == 3
        with pytest.raises(RecordError, match="the digest of the string after frame 2 is"):
            list(record.strings(check=True))


def test_the_log_survives_a_round_trip(tmp_path):
    with record_of(bytes_of("meadow"), tmp_path) as record:
        lines = list(record.log())
    assert [line.text for line in lines[:2]] == ["begins 0", "begins 1"]
    assert lines[1].member == "steps"
    assert lines[1].time == pytest.approx(0.04)


@pytest.mark.parametrize("name", NAMES)
def test_others_can_show_it(name):
    channels = others(bytes_of(name))
    for topic, messages in channels.items():
        for schema, _, shown in messages if not topic.startswith("minerva/") else ():
            assert schema.name.startswith("foxglove.")
            fits(shown, json.loads(schema.data))
    times = [message.log_time for _, message, _ in channels[c.FRAME]]
    dt = happened(name)[0].world.dt
    assert times == [round((n + 1) * dt * 1e9) for n in range(len(times))]
    assert channels[c.FRAME][3][1].publish_time == 1_700_000_000 * 10**9 + 30_000_000
