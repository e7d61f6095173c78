"""Sensor topics in a record: readings are lossless and do not delay frames."""

import io
import threading
from itertools import islice
from typing import Any, cast

import numpy as np
import pytest

from minerva_bus.errors import MinervaError
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.messages import Readings
from minerva_bus.launch.run_outputs import recording
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.log import channels as c
from minerva_bus.log import recorder as queues
from minerva_bus.log.entries import Dropped, decode_sensed, encode_readings
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.log.recorder import Recorder
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.wire.codec import encode
from minerva_bus.wire.field_codecs import plain_reading
from minerva_bus.world.readings import (
    Battery,
    Image,
    Mount,
    Odometry,
    Position,
    Scan,
    Sighting,
    Sightings,
)
from tests.log.recorded_runs import description, happened, record_of
from tests.runtime.running import ALL_KINDS, here, minerva, summary, write_world

mcap = pytest.importorskip("mcap")

RANGES = np.array([1.5, np.inf, 0.1, 0.0, -1.0], np.float32)
ALL = {
    "foxglove.LaserScan": Scan("r1", RANGES, -30.0, 15.0, 8.0, 0.25, 0.1, 0.0, 90.0),
    "foxglove.CompressedImage": Image("r1", b"\xff\xd8jpeg", "jpeg", 4, 3, 0.5, Mount(0.2)),
    "foxglove.RawImage": Image("r1", bytes(range(18)), "rgb8", 3, 2, 0.5),
    "foxglove.RawImage ": Image("r1", bytes(24), "32FC1", 3, 2, 0.5),
    "foxglove.PoseInFrame": Odometry("r1", 1.0, 2.0, 90.0, 0.5, 10.0, 0.75),
    "foxglove.LocationFix": Position("r1", 50.0, 14.5, 200.0, 3.0, 1.0),
    "foxglove.LocationFix ": Position("r1", 50.0, 14.5, None, None, 1.0),
    "": Battery("r1", 0.5, 12.0, 2.0),
    "none": Sightings("r1", (Sighting("kitchen", 3.0, -5.0),), 2.5),
}
LOCKSTEP = ALL_KINDS.split("[process.noise]")[0]


def same(first, other):
    """Whether readings are identical bit by bit."""
    plain = [
        (readings.topic, readings.member, readings.frame, readings.readings)
        for readings in (first, other)
    ]
    return plain[0][:3] == plain[1][:3] and [*map(plain_reading, plain[0][3])] == [
        *map(plain_reading, plain[1][3])
    ]


def heard(record) -> list[Any]:
    return [readings for _, readings in record.sensed()]


@pytest.mark.parametrize("schema", ALL)
def test_a_reading_is_kept_as_it_is(schema):
    readings = Readings("physics", "topic", 7, (ALL[schema],))
    assert same(decode_sensed(encode_readings(readings)), readings)


@pytest.mark.parametrize("data", [b"\x90", b"\xc1", b"\x92\xa7dropped\xa1x", b"\x91\xa5topic"])
def test_an_invalid_message_of_a_topic_is_rejected(data):
    with pytest.raises(MinervaError):
        decode_sensed(data)


def test_a_robots_scans_are_in_its_record(tmp_path):
    path = tmp_path / "run.mcap"
    done = here(tmp_path, "run", "robot", "--in-process", "--frames", 12, "--until", "",
                "--record", path, "--record-topics", "scan", "--json")  # fmt: skip
    assert done.returncode == 0, done.stderr
    with Record(path) as record:
        recorded = heard(record)
        assert {(readings.topic, readings.member) for readings in recorded} == {("scan", "physics")}
        frames = [readings.frame for readings in recorded]
        assert frames == sorted(set(frames))
        assert [time for time, _ in record.sensed()] == pytest.approx([0.1 * n for n in frames])
        assert all(len(scan.ranges) > 10 for readings in recorded for scan in readings.readings)


def test_the_bus_and_one_process_give_the_same_result(tmp_path):
    path = write_world(tmp_path, LOCKSTEP, frames=25)
    words = ("--record-topics", "all", "--json")
    summary(here(tmp_path, "run", path, "--in-process", "--record", "alone.mcap", *words))
    summary(minerva(tmp_path, "run", path, "--record", "bus.mcap", *words))
    with Record(tmp_path / "alone.mcap") as alone, Record(tmp_path / "bus.mcap") as bus:
        key = lambda readings: (readings.frame, readings.topic)  # noqa: E731
        first, other = sorted(heard(alone), key=key), sorted(heard(bus), key=key)
    assert len(first) == len(other) >= 25
    assert all(map(same, first, other))
    text = here(tmp_path, "info", "bus.mcap").stdout
    assert f"topics      sight {len(other)}\n" in text
    assert here(tmp_path, "diff", "alone.mcap", "bus.mcap").returncode == 0


def settings(folder, world, **given):
    path = write_world(folder, frames=3)
    path.write_text(path.read_text().replace("seed = 7", f"seed = 7\n{world}"))
    return read_world_file(path, Overrides(**given)).record


@pytest.mark.parametrize(
    ("world", "given", "topics"),
    [
        ('record = {file = "a.mcap", topics = true}', {}, ("*",)),
        ('record = {file = "a.mcap", topics = ["scan", "image"]}', {}, ("scan", "image")),
        ('record = {file = "a.mcap", topics = false}', {}, ()),
        ('record = {file = "a.mcap"}', {"record_topics": "all"}, ("*",)),
        ('record = "a.mcap"', {"record_topics": "scan, image"}, ("scan", "image")),
    ],
)
def test_the_recorded_topics_are_listed(tmp_path, world, given, topics):
    chosen = settings(tmp_path, world, **given)
    assert (chosen.path, chosen.topics) == ("a.mcap", topics)


def test_the_flush_interval_is_reported(tmp_path):
    own = 'record = "a.mcap"\nflush = 5\ndurable = true'
    assert (settings(tmp_path, own).flush, settings(tmp_path, own).durable) == (5.0, True)
    chosen = settings(tmp_path, own, flush=0.5, durable=False)
    assert (chosen.flush, chosen.durable) == (0.5, False)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--record-topics", "all"), "name one, --record FILE.mcap"),
        (("--record", "a.mcap", "--record-topics", "a/b"), "'a/b' cannot name a topic"),
        (("--record", "a.mcap", "--flush", "-1"), "--flush must be a number of seconds from 0"),
        (("--record", "a.mcap", "--flush", "inf"), "--flush must be a number of seconds from 0"),
    ],
)
def test_invalid_input_is_reported_in_one_line(tmp_path, words, problem):
    done = here(tmp_path, "run", write_world(tmp_path), *words)
    assert done.returncode == 2
    assert problem in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_readings_that_are_too_fast_are_dropped_and_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(queues, "MESSAGES", 3)
    path = tmp_path / "run.mcap"
    file, frames = happened("meadow")
    said = []
    recorder = Recorder(path, description(file), durable=True, say=said.append)
    for number in range(5):
        readings = Readings("m", "battery", number, (ALL[""],))
        recorder.received("battery", "m", encode(readings), 0.0)
    recorder.received("battery", "m", b"nonsense", 0.0)
    recorder.frame(*frames[0], 0.0)
    recorder.received("battery", "m", b"nonsense", 0.0)
    recorder.close()
    assert said == [f"{path}: 4 messages on topics are not in the record: they arrived faster"
                    " than they could be written"]  # fmt: skip
    with Record(path) as record:
        readings = heard(record)
        assert [message.frame for message in readings if isinstance(message, Readings)] == [0, 1, 2]
        assert sum(message.count for message in readings if isinstance(message, Dropped)) == 4
    info = here(tmp_path, "info", path).stdout
    assert "topics      battery 3 (4 messages dropped)" in info


def test_no_frame_is_skipped_under_a_flood(tmp_path, monkeypatch):
    monkeypatch.setattr(queues, "PATIENCE", 10.0)
    file, frames = happened("meadow")
    data = encode(Readings("m", "battery", 0, (ALL[""],)))
    sensed, said = RecordWriter.sensed, []

    def written(self, *what):
        recorder.received("battery", "m", data, 0.0)  # Another reading arrives meanwhile.
        sensed(self, *what)

    monkeypatch.setattr(RecordWriter, "sensed", written)
    recorder = Recorder(
        tmp_path / "run.mcap", description(file), flush_seconds=0.01, say=said.append
    )
    recorder.received("battery", "m", data, 0.0)
    for record, string in frames:
        recorder.frame(record, string, 0.0)
    recorder.close()
    assert not said
    assert recorder.frames == 60


def test_readings_are_written_while_frames_wait(tmp_path, monkeypatch):
    file, frames = happened("meadow")
    data = encode(Readings("m", "battery", 0, (ALL[""],)))
    frame, left, written = RecordWriter.frame, iter(frames), []

    def framed(self, *what):
        written.append(len(calls))
        recorder.received("battery", "m", data, 0.0)
        for record, string in islice(left, 1):
            recorder.frame(record, string, 0.0)
        frame(self, *what)

    calls = []
    monkeypatch.setattr(RecordWriter, "frame", framed)
    monkeypatch.setattr(RecordWriter, "sensed", lambda *what: calls.append(what))
    recorder = Recorder(tmp_path / "run.mcap", description(file), flush_seconds=60.0)
    recorder.frame(*next(left), 0.0)
    while len(written) < 60:
        threading.Event().wait(0.005)
    recorder.close()
    assert written == list(range(60))


def test_large_messages_are_bounded_by_their_bytes(monkeypatch):
    monkeypatch.setattr(queues, "BYTES", 100)
    waiting = queues.Backlog()
    for _ in range(3):
        waiting.put(queues.Sensed("t", "m", bytes(40), 0, 0.0))
    assert waiting.dropped == 1


def test_a_resumed_record_has_each_reading_once(tmp_path):
    path = write_world(tmp_path, LOCKSTEP, frames=20)
    words = ("--in-process", "--record-topics", "all", "--json", "--record")
    summary(here(tmp_path, "run", path, *words, "whole.mcap"))
    summary(here(tmp_path, "run", path, *words, "cut.mcap", "--frames", 9))
    resumed = ("run", "--resume", "cut.mcap", "--frames", 20)
    summary(here(tmp_path, *resumed, *words, "on.mcap"))
    with Record(tmp_path / "whole.mcap") as first, Record(tmp_path / "on.mcap") as other:
        before, after = heard(first), heard(other)
    assert len(before) == len(after)
    assert all(map(same, before, after))


def test_readings_of_a_frame_that_was_cut_off_are_left_out(tmp_path):
    file, frames = happened("meadow")
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    for number in range(3):
        writer.sensed(Readings("m", "battery", number, (ALL[""],)), number, 0.0)
        if number < 2:
            writer.frame(*frames[number], 0.0, {})
    writer.finish()
    with record_of(stream.getvalue(), tmp_path) as record:
        kept = [message for topic, message in record.messages(2) if topic == c.SENSED]
    assert [cast("Readings", decode_sensed(message.data)).frame for message in kept] == [0, 1]


def test_no_topics_no_ear(tmp_path):
    file = read_world_file(write_world(tmp_path), Overrides(record=str(tmp_path / "a.mcap")))
    record = recording(file, FrameAlgorithm(file.world), pytest.fail)
    assert record.topics == ()
    record.close()
