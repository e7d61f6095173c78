"""Bags of ROS 2 made of records, read with the readers of rosbags and with our own."""

import json

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="pip install 'minerva-bus[ros]'")
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability

from minerva_bus import MinervaError
from minerva_bus.cli.main import app
from minerva_bus.wire.field_codecs import plain_reading
from minerva_exporters import export_dataset
from minerva_exporters.sources import RecordFrames, new_folder
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.rosbag import Bag
from tests.services.rover_yard import readings


@pytest.fixture(scope="module")
def bag(recorded, tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "yard_bag"
    done = export_dataset(recorded[1], path, "rosbag")
    return path, done


@pytest.fixture(scope="module")
def by_topic(bag):
    """Times in seconds and messages, by topic."""
    made = {}
    with AnyReader([bag[0]], default_typestore=messages().store) as reader:
        begin = reader.start_time
        for connection, stamp, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            made.setdefault(connection.topic, []).append(((stamp - begin) / 1e9, message))
        durability = {
            connection.topic: connection.ext.offered_qos_profiles
            for connection in reader.connections
        }
    return made, durability


def test_the_bag_has_all_messages(bag, by_topic):
    counts = {topic: len(rows) for topic, rows in by_topic[0].items()}
    sensed = {f"/r1/{topic}": 4 for topic, _ in readings(0, 0.0)}
    assert counts == {"/tf": 6, "/tf_static": 4, "/events/eSteer": 4, **sensed}
    assert bag[1].counts == {"messages": sum(counts.values()), "topics": len(counts)}
    [lasting] = by_topic[1]["/tf_static"]
    assert lasting.durability == QosDurability.TRANSIENT_LOCAL


def test_poses_are_those_of_the_strings(recorded, by_topic):
    from minerva_bus.log.record import Record

    with Record(recorded[1]) as record:
        strings = [frame.scene for frame in RecordFrames(record)]
    for (time, message), scene, number in zip(by_topic[0]["/tf"], strings, range(6), strict=True):
        assert time == pytest.approx(0.1 * number)
        rover = next(node for node in scene if node.id == "r1")
        [first, second] = message.transforms
        assert (first.child_frame_id, second.child_frame_id) == ("r1", "r2")
        assert first.transform.translation.x == rover.state["x"]
        half = np.radians(rover.state["angle"]) / 2
        assert first.transform.rotation.z == pytest.approx(np.sin(half))


def test_scans_have_the_pose_of_their_own_frame(recorded, tmp_path):
    export_dataset(recorded[1], tmp_path / "bag", "rosbag", every=4)
    with AnyReader([tmp_path / "bag"], default_typestore=messages().store) as reader:
        poses = [
            [
                each.child_frame_id
                for each in reader.deserialize(data, connection.msgtype).transforms
            ]
            for connection, _, data in reader.messages()
            if connection.topic == "/tf"
        ]
    assert poses == [["r1", "r2"], ["r1"], ["r1"], ["r1"], ["r1", "r2"]]


def test_events_are_json(by_topic):
    time, message = by_topic[0]["/events/eSteer"][1]
    first, second = json.loads(message.data)
    assert time == pytest.approx(0.1)
    assert (first["sender"], first["receivers"], second["receivers"]) == ("", ["r1"], ["r2"])
    assert first["data"]["turn"] == 10.0


def test_our_reader_returns_the_recorded_readings(bag):
    """What can be played: equal bit by bit except for times and for fields that ROS lacks."""
    path, _ = bag
    opened = Bag(path, lambda what, line: None, topics={"/r1/photo": "photo", "/r1/image": "image",
                 "/r1/scan": "scan", "/r1/odometry": "odometry", "/r1/battery": "battery",
                 "/r1/position": "position"})  # fmt: skip
    read = {}
    for recorded in opened.readings():
        read.setdefault(recorded.topic, []).append(plain_reading(recorded.reading))
    opened.close()
    for topic, first in readings(1, 0.1):
        if topic not in ("sightings", "depth"):  # Of depths our reader makes a PNG.
            expected, got = plain_reading(first), read[topic][0]
            same = [a == pytest.approx(b) for a, b in zip(expected, got, strict=True)]
            # The time is that of the run by the clock.
            assert same.count(False) == 1, (topic, expected, got)


def test_sightings_are_detections(by_topic):
    [detection] = by_topic[0]["/r1/sightings"][0][1].detections
    [result] = detection.results
    assert result.hypothesis.class_id == "kitchen"
    at = result.pose.pose.position
    assert np.hypot(at.x, at.y) == pytest.approx(3.0)


def test_what_cannot_be_exported_is_refused_with_a_line(recorded, tmp_path, capsys):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    for into, form, records, message in (
        ("full", "rosbag", [recorded[1]], "exists already"),
        ("new", "rosbag", [recorded[1]] * 2, "export each record"),
        ("new", "rosbags", [recorded[1]], "did you mean 'rosbag'"),
        ("new.txt", "rerun", [recorded[1]], "ends in .rrd"),
    ):
        with pytest.raises(MinervaError, match=message):
            export_dataset(records, tmp_path / into, form)
    with pytest.raises(MinervaError, match="frames 0 to 4"):
        export_dataset(recorded[1], tmp_path / "new", "rosbag", begin=9)
    assert [path.name for path in tmp_path.iterdir()] == ["full"]


def test_an_error_of_writing_names_the_folder_and_leaves_none(tmp_path):
    with pytest.raises(OSError, match="No space") as caught, new_folder(tmp_path / "bag", "rosbag"):
        raise OSError(28, "No space left on device")
    assert caught.value.filename == str(tmp_path / "bag")
    assert not list(tmp_path.iterdir())


def test_the_command_prints_what_it_wrote(recorded, tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        app(["export", str(recorded[1]), "--rosbag", str(tmp_path / "b"), "--json", "--to", "2"])
    assert left.value.code == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["format"] == "rosbag"
    assert answer["topics"] == 11
