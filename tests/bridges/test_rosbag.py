"""ROS 1 and ROS 2 bags: the readings of their messages, and skipped messages."""

import io
import math
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
from recorded import DEMO, Passed, messages, needs_demo, write_bag

from minerva_bus.errors import MisuseError
from minerva_bus.log.recordings import RecordingError
from minerva_bus.wire.field_codecs import plain_reading, read_reading
from minerva_bus.world.readings import Battery, Image, Odometry, Position
from minerva_services.bridges.rosbag import Bag, Rosbag
from minerva_services.sensors.playback import MountOverride

KINDS = pytest.mark.parametrize("suffix", ["bag", "db3", "mcap"])


def readings(path, **options):
    passed = Passed()
    bag = Bag(path, passed, **options)
    try:
        return list(bag.readings()), passed
    finally:
        bag.close()


def bag_of(tmp_path, make, suffix="mcap", broken=(), **options):
    """The readings of a bag whose (seconds, topic, message) `make` builds from ROS types."""
    types, store = messages(suffix == "bag")
    path = write_bag(tmp_path / f"some.{suffix}", store, make(types), broken)
    return readings(path, **options)


def one(tmp_path, make, **options):
    """The reading of a bag with a single message."""
    (said,), _ = bag_of(tmp_path, lambda ros: [(1.0, "/it", make(ros))], **options)
    return said.reading


@KINDS
def test_scans_and_odometry_of_all_kinds_of_bags(tmp_path, suffix):
    def make(ros):
        yield 5.0, "/odom", ros.odometry(1.0, 2.0, math.pi / 2, 0.5, math.pi, time=4.5)
        yield 5.5, "/scan", ros.scan([1.0, 2.0, 9.0], time=5.25)

    (odometry, scan), passed = bag_of(tmp_path, make, suffix)
    assert (odometry.stamp, odometry.topic) == (5.0, "odometry")
    assert plain_reading(odometry.reading) == pytest.approx(
        plain_reading(Odometry("r1", 1.0, 2.0, 90.0, 0.5, 180.0, 4.5))
    )
    assert (scan.stamp, scan.topic, scan.reading.time) == (5.5, "scan", 5.25)
    assert scan.reading.ranges.tolist() == [1.0, 2.0, 9.0]
    assert (scan.reading.first, scan.reading.step) == pytest.approx(
        (math.degrees(-0.5), math.degrees(0.5))
    )
    assert scan.reading.range_max == 8.0
    assert passed == []


@KINDS
def test_position_of_the_laser(tmp_path, suffix):
    def make(ros):
        frames = [
            ("base_footprint", "base_link", 9.0, 9.0, 9.0, 0.0),
            ("base_link", "mast", 1.0, 0.0, math.pi / 2, 0.0),
            ("mast", "laser", 0.5, 0.25, 0.0, 0.0),
        ]
        yield 1.0, "/scan", ros.scan([1.0], frame="laser")
        yield 2.0, "/tf_static", ros.transforms(*frames)

    (scan,), _ = bag_of(tmp_path, make, suffix)
    mount = scan.reading.mount_x, scan.reading.mount_y, scan.reading.mount_angle
    assert mount == pytest.approx((0.75, 0.5, 90.0))
    (path,) = tmp_path.glob(f"**/*.{suffix}")
    (scan,), _ = readings(path, mounting=MountOverride(mount_x=0.0))
    assert (scan.reading.mount_x, scan.reading.mount_y) == pytest.approx((0.0, 0.5))


@pytest.mark.parametrize("namespace", ["", "/bot1"])
def test_transforms_of_joints_place_a_laser_when_they_move_it(tmp_path, namespace):
    def make(ros):
        yield 0.0, f"{namespace}/scan", ros.scan([1.0], frame="laser")
        yield 0.1, f"{namespace}/tf_static", ros.transforms(("mast", "laser", 0.0, 0.0, 0.0, 0.0))
        yield 0.0, f"{namespace}/more/tf", ros.odometry(0.0, 0.0, 0.0)
        yield 0.1, "/bot2/tf", ros.transforms(("mast", "laser", 9.0, 0.0, 0.0, 0.0))
        for seconds, yaw in ((1.0, 0.25), (6.0, 0.5)):
            turned = ros.transforms(
                ("odom", "chassis", 5.0 * seconds, 0.0, 1.0, 0.0),
                ("chassis", "mast", 0.5, 0.0, math.pi * yaw, 0.0),
            )
            yield seconds, f"{namespace}/tf", turned
            yield seconds + 0.1, f"{namespace}/scan", ros.scan([1.0], frame="laser")

    said, passed = bag_of(tmp_path, make)
    scans = [each.reading for each in said if each.topic == "scan"]
    mounts = [(scan.mount_x, scan.mount_angle) for scan in scans]
    assert len(said) == len(scans) + 1  # odometry, on a topic named like one of transforms
    assert mounts == [(0.5, 45.0), (0.5, 45.0), (0.5, 90.0)]
    assert passed == []


def test_a_laser_that_hangs_upside_down_turns_the_other_way(tmp_path):
    def make(ros):
        yield 0.0, "/tf_static", ros.transforms(("base_link", "laser", 0, 0, 0, math.pi))
        yield 1.0, "/scan", ros.scan([1.0, 2.0], frame="/laser", angle_min=0.25)

    (scan,), _ = bag_of(tmp_path, make)
    assert scan.reading.first == pytest.approx(math.degrees(-0.25))
    assert scan.reading.step == pytest.approx(math.degrees(-0.5))


def test_frames_in_a_circle_do_not_hang(tmp_path):
    def make(ros):
        yield 0.0, "/tf_static", ros.transforms(("a", "b", 1, 0, 0, 0), ("b", "a", 1, 0, 0, 0))
        yield 1.0, "/scan", ros.scan([1.0], frame="a")

    assert len(bag_of(tmp_path, make)[0]) == 1


def test_ranges_below_the_minimum_are_no_hits(tmp_path):
    scan = one(tmp_path, lambda ros: ros.scan([0.05, 0.1, math.inf, math.nan, 7.0]))
    assert scan.ranges[[0, 1, 4]].tolist() == [0.0, np.float32(0.1), 7.0]
    assert scan.ranges[[2, 3]].tolist() == [scan.range_max, 0.0]


def test_a_range_without_limit_can_travel(tmp_path):
    scan = one(tmp_path, lambda ros: ros.scan([1.0], range_max=math.inf))
    assert read_reading(plain_reading(scan)).range_max == scan.range_max < math.inf


def turned(ros, **parts):
    """Odometry whose quaternion has these parts."""
    message = ros.odometry(1.0, 2.0, 0.0)
    for name, value in parts.items():
        setattr(message.pose.pose.orientation, name, value)
    return message


@pytest.mark.parametrize("length", [0.5, 2.0, 1e-3, 1e30])
@pytest.mark.parametrize("heading", [0.0, 30.0, 90.0, -170.0])
def test_quaternions_are_scaled_to_length_1(tmp_path, length, heading):
    half = math.radians(heading / 2)
    z, w = length * math.sin(half), length * math.cos(half)
    assert one(tmp_path, lambda ros: turned(ros, z=z, w=w)).angle == pytest.approx(heading)


def test_mounts_with_quaternions_of_another_length(tmp_path):
    def make(ros):
        placed = ros.transforms(("base_link", "laser", 0.2, 0.1, math.pi / 2, 0.0))
        for name in "xyzw":
            rotation = placed.transforms[0].transform.rotation
            setattr(rotation, name, 3.0 * getattr(rotation, name))
        yield 0.0, "/tf_static", placed
        yield 1.0, "/scan", ros.scan([1.0])

    scan = bag_of(tmp_path, make)[0][0].reading
    assert (scan.mount_x, scan.mount_y, scan.mount_angle) == (0.2, 0.1, 90.0)


def test_a_transform_that_is_no_rotation_is_reported_with_its_place(tmp_path):
    def make(ros):
        placed = ros.transforms(
            ("base_link", "laser", 0.2, 0.1, 0.0, 0.0), ("base_link", "other", 0.3, 0.0, 0.0, 0.0)
        )
        placed.transforms[0].transform.rotation.w = 0.0
        yield 0.0, "/tf_static", placed
        yield 1.0, "/scan", ros.scan([1.0], frame="other")

    said, passed = bag_of(tmp_path, make)
    assert said[0].reading.mount_x == 0.3
    (line,) = passed.of("messages passed over")
    assert "/tf_static skipped: laser: the quaternion (0, 0, 0, 0) is not a rotation" in line


PIXELS = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)


@pytest.mark.parametrize(
    ("encoding", "made", "data", "name"),
    [
        ("rgb8", PIXELS, PIXELS, "rgb8"),
        ("bgr8", PIXELS, PIXELS[..., ::-1], "rgb8"),
        ("mono8", PIXELS[..., :1], PIXELS[..., :1], "mono8"),
        ("bgra8", np.dstack([PIXELS, PIXELS[..., 0]]), PIXELS[..., ::-1], "rgb8"),
    ],
)
@pytest.mark.parametrize("step", [None, 16])
def test_images_of_pixels(tmp_path, encoding, made, data, name, step):
    image = one(tmp_path, lambda ros: ros.image(made, encoding, step, time=3.0))
    assert image == Image("r1", data.tobytes(), name, 3, 2, 3.0)
    assert read_reading(plain_reading(image)) == image


@pytest.mark.parametrize("kind", ["jpeg", "png"])
def test_images_as_files(tmp_path, kind):
    pillow = pytest.importorskip("PIL.Image")
    file = io.BytesIO()
    pillow.fromarray(PIXELS).save(file, kind)
    image = one(tmp_path, lambda ros: ros.compressed(file.getvalue(), f"bgr8; {kind} compressed"))
    assert image == Image("r1", file.getvalue(), kind, 3, 2, 1.0)


@pytest.mark.parametrize(
    ("percentage", "voltage", "charge", "volts"),
    [(0.75, 12.5, 0.75, 12.5), (40.0, 11.0, 0.4, 11.0), (0.5, math.nan, 0.5, 0.0)],
)
def test_batteries(tmp_path, percentage, voltage, charge, volts):
    battery = one(tmp_path, lambda ros: ros.battery(percentage, voltage, time=2.0))
    assert battery == Battery("r1", pytest.approx(charge), volts, 2.0)


def test_places_on_the_earth(tmp_path):
    place = one(tmp_path, lambda ros: ros.fix(52.5, 13.25, math.nan, time=2.0))
    assert place == Position("r1", 52.5, 13.25, None, 2.0, 2.0)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda ros: ros.battery(math.nan), "percentage not finite"),
        (lambda ros: ros.fix(1.0, 2.0, 3.0, status=-1), "no fix"),
        (lambda ros: ros.odometry(math.nan, 0.0, 0.0), "pose not finite"),
        (lambda ros: ros.scan([1.0], angle_increment=math.nan), "angles not finite"),
        (lambda ros: ros.scan([1.0], range_max=math.nan), "range_max is not a number"),
        (lambda ros: ros.scan([1.0], range_max=0.0), "range_max is 0; expected metres above 0"),
        (lambda ros: ros.scan([1.0], range_min=9.0), "range_max is 8; expected"),
        (lambda ros: ros.scan([1.0], range_min=math.nan), "range_min is not a number"),
        (lambda ros: ros.scan([]), "no beams"),
        (lambda ros: ros.scan([1.0, 2.0], angle_increment=0.0), "angle_increment is 0, with 2"),
        (
            lambda ros: turned(ros, z=0.0, w=0.0),
            "quaternion (0, 0, 0, 0) is not a rotation (0.000 s after",
        ),
        (lambda ros: turned(ros, z=math.nan), "pose not finite"),
        (lambda ros: turned(ros, z=math.inf), "pose not finite"),
        (lambda ros: ros.battery(-1.0), "percentage is -1"),
        (lambda ros: ros.fix(91.0, 2.0, 3.0), "latitude 91 and longitude 2 are no place"),
        (lambda ros: ros.fix(1.0, -181.0, 3.0), "are no place"),
        (lambda ros: ros.image(PIXELS, "yuv422"), "'yuv422' is not one of"),
        (lambda ros: ros.image(PIXELS[..., :2], "rgb8"), "are not an image"),
        (lambda ros: ros.compressed(b"no picture"), "not a JPEG or PNG"),
    ],
)
def test_an_invalid_reading_is_skipped_and_reported(tmp_path, make, why):
    types, store = messages()
    path = write_bag(tmp_path / "odd.mcap", store, [(1.0, "/it", make(types))])
    passed = Passed()
    bag = Bag(path, passed)
    with pytest.raises(RecordingError, match="no playable message on /it; a message of /it sk"):
        list(bag.readings())
    bag.close()
    (line,) = passed.of("messages passed over")
    assert "a message of /it skipped" in line
    assert why in line


def mcap_of(path, *said, others=()):
    """An MCAP of (seconds, topic, schema name, message), and of other types by their schemas."""
    from mcap.writer import CompressionType, Writer

    _, store = messages()
    channels = {}
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="test")
        for seconds, topic, name, message in said:
            kind, stamp = message.__msgtype__, round(seconds * 1e9)
            if topic not in channels:
                definition = store.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(name, "ros2msg", definition)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], stamp, data, stamp)
        for name, text in others:
            schema = writer.register_schema(name, "ros2msg", text.encode())
            writer.add_message(writer.register_channel(f"/{name}", "cdr", schema), 1, b"", 1)
        writer.finish()
    return path


@pytest.mark.parametrize("topics", [{}, {"/front": "scan"}])
def test_schemas_may_omit_msg(tmp_path, topics):
    types, _ = messages()
    placed = types.transforms(("base_link", "laser", 0.2, 0.1, 0.0, 0.0))
    path = mcap_of(
        tmp_path / "short.mcap",
        (0.0, "/tf_static", "tf2_msgs/TFMessage", placed),
        (1.0, "/front", "sensor_msgs/LaserScan", types.scan([1.0, 2.0])),
        (2.0, "/odom", "nav_msgs/msg/Odometry", types.odometry(1.0, 2.0, 0.0)),
    )
    said, passed = readings(path, topics=topics)
    assert [item.topic for item in said] == ["scan", "odometry"][: 1 if topics else 2]
    assert (said[0].reading.mount_x, said[0].reading.mount_y) == (0.2, 0.1)
    assert passed == []


def test_definitions_of_services_and_actions_do_not_matter(tmp_path):
    """A bag with the events of services has them; rosbags does not parse two messages in one."""
    scan = messages()[0].scan([1.0, 2.0])
    path = mcap_of(
        tmp_path / "events.mcap",
        (1.0, "/front", "sensor_msgs/msg/LaserScan", scan),
        others=[
            ("std_srvs/srv/SetBool_Event", "bool data\n---\nbool success\n"),
            ("test_msgs/action/Go_FeedbackMessage", "int8 a\n---\nint8 b\n---\nint8 c\n"),
        ],
    )
    said, _ = readings(path)
    assert [item.topic for item in said] == ["scan"]


@KINDS
def test_a_damaged_message_is_passed_over(tmp_path, suffix):
    def make(ros):
        return [(float(i), "/scan", ros.scan([1.0, 2.0], time=float(i))) for i in range(1, 4)]

    said, passed = bag_of(tmp_path, make, suffix, broken={1})
    assert [scan.stamp for scan in said] == [1.0, 3.0]
    assert len(passed.of("messages not readable")) == 1


def two_lasers(ros):
    yield 1.0, "/rear", ros.scan([2.0], time=1.0)
    yield 1.0, "/front", ros.scan([1.0], time=1.0)


def test_of_two_lasers_the_first_by_name_is_played_and_the_other_reported(tmp_path):
    said, passed = bag_of(tmp_path, two_lasers)
    assert [(x.topic, x.reading.ranges.tolist()) for x in said] == [("scan", [1.0])]
    assert "/rear skipped" in passed.of("topics passed over")[0]


def test_topics_that_are_not_read_are_counted(tmp_path):
    types, _ = messages()
    path = mcap_of(
        tmp_path / "more.mcap",
        (1.0, "/front", "sensor_msgs/LaserScan", types.scan([1.0, 2.0])),
        (1.0, "/poses", "tf2_msgs/TFMessage", types.transforms(("a", "b", 0.0, 0.0, 0.0, 0.0))),
    )
    said, passed = readings(path)
    assert [item.topic for item in said] == ["scan"]
    assert "/poses skipped" in passed.of("topics of other types")[0]


def test_topics_by_their_names(tmp_path):
    said, passed = bag_of(tmp_path, two_lasers, topics={"/rear": "back", "/front": "scan"})
    assert [(x.topic, x.reading.ranges.tolist()) for x in said] == [
        ("back", [2.0]),
        ("scan", [1.0]),
    ]
    assert passed == []


@pytest.mark.parametrize(
    ("topics", "why"),
    [({"/scan": "scan"}, "no topic /scan; available: /front, /rear, /tf_static"),
     ({"/tf_static": "scan"}, "tf2_msgs/msg/TFMessage; expected one of sensor_msgs")],
)  # fmt: skip
def test_wrong_topics(tmp_path, topics, why):
    def make(ros):
        return [*two_lasers(ros), (0.0, "/tf_static", ros.transforms())]

    with pytest.raises(RecordingError, match=why):
        bag_of(tmp_path, make, topics=topics)


def test_a_bag_without_sensors_lists_its_topics(tmp_path):
    with pytest.raises(RecordingError, match=r"nothing to play.*available: /tf \(tf2_msgs"):
        bag_of(tmp_path, lambda ros: [(1.0, "/tf", ros.transforms())])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.bag", b"#ROSBAG V1.2\n" + bytes(100)),
        ("a.bag", b"\xff\xfe" * 100),
        ("a.db3", b"no database"),
        ("a.mcap", b""),
        ("a.txt", b"x"),
    ],
)
def test_a_missing_bag(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=rf"{name}: not a readable bag: \S") as caught:
        readings(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda data: data[:8], "it ends too early, .*; repair it with: mcap recover odd.mcap"),
        (lambda data: data[:-8], "it ends too early, .*; repair it with: mcap recover odd.mcap"),
        (lambda data: b"x" + data, "it is a file of another kind"),
        (lambda data: b"", "it is empty"),
        (lambda data: data.replace(b"ros2", b"ros1"), "MCAP of another profile; expected ros2"),
        (lambda data: data.replace(b"ros2msg", b"ros9msg"), "schemas are in 'ros9msg'; expected"),
    ],
)
def test_the_readers_messages_are_translated_with_the_tool_that_repairs(tmp_path, change, why):
    types, _ = messages()
    path = mcap_of(
        tmp_path / "odd.mcap", (1.0, "/it", "sensor_msgs/msg/LaserScan", types.scan([1]))
    )
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(RecordingError, match=f"odd.mcap: not a readable bag: .*{why}"):
        readings(path)


def test_an_error_says_why_the_first_data_were_skipped(tmp_path):
    types, _ = messages()
    scans = [types.scan([1.0] * 50, time=float(i)) for i in range(9)]
    said = [(float(i), "/scan", "sensor_msgs/msg/LaserScan", scan) for i, scan in enumerate(scans)]
    path = mcap_of(tmp_path / "odd.mcap", *said)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x40
    path.write_bytes(data)
    reason = "breaks off: it is damaged: Chunk checksum mismatch; repair it with: mcap recover"
    with pytest.raises(RecordingError, match=f"no playable message on /scan; {reason}"):
        readings(path)


@pytest.mark.parametrize(
    ("schema", "why"),
    [
        (lambda text: text.split("=" * 80)[0], "its schema does not define 'std_msgs/msg/Header'"),
        (lambda text: "", "message size mismatch"),
        (lambda text: None, "available: /it .a type without a schema"),
    ],
    ids=["part", "empty", "none"],
)
def test_a_missing_schema_is_named(tmp_path, schema, why):
    from mcap.writer import Writer

    types, store = messages()
    kind, path = "sensor_msgs/msg/LaserScan", tmp_path / "odd.mcap"
    text = schema(store.generate_msgdef(kind, ros_version=2)[0])
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="test")
        number = 0 if text is None else writer.register_schema(kind, "ros2msg", text.encode())
        channel = writer.register_channel("/it", "cdr", number)
        writer.add_message(channel, 1, bytes(store.serialize_cdr(types.scan([1.0]), kind)), 1)
        writer.finish()
    with pytest.raises(RecordingError, match=rf"odd\.mcap: .*{why}"):
        readings(path)


@needs_demo
def test_a_bag_that_breaks_off_has_no_index(tmp_path):
    (tmp_path / "cut.bag").write_bytes(DEMO.read_bytes()[:100_000])
    with pytest.raises(RecordingError, match=r"cut\.bag: .*rebuild the index"):
        readings(tmp_path / "cut.bag")


def test_a_folder_is_a_bag_of_ros_2_too(tmp_path):
    types, store = messages()
    path = write_bag(tmp_path / "some.mcap", store, [(1.0, "/scan", types.scan([1.0]))])
    assert len(readings(path.parent)[0]) == 1


def test_a_bag_is_read_again_and_knows_how_far_it_is(tmp_path):
    types, store = messages()
    said = [(float(i), "/scan", types.scan([1.0])) for i in range(5)]
    bag = Bag(write_bag(tmp_path / "some.mcap", store, said), Passed())
    parts = [bag.part for _ in bag.readings()]
    assert parts == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    assert len(list(bag.readings())) == 5
    bag.close()


def test_missing_libraries_name_the_extra(tmp_path, monkeypatch):
    types, store = messages()
    path = write_bag(tmp_path / "some.mcap", store, [(1.0, "/it", types.compressed(b"x"))])
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(RecordingError, match=r"Pillow; .*pip install 'minerva-bus\[ros\]'"):
        readings(path)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(RecordingError, match=r"rosbags; .*pip install 'minerva-bus\[ros\]'"):
        readings(path)


def test_topics_that_a_service_publishes(tmp_path):
    path = str(tmp_path)
    every = ("battery", "image", "odometry", "position", "range", "scan", "sightings")
    assert Rosbag(path).publishes == every
    assert Rosbag(path, topics={"/a": "front", "/b": "front"}).publishes == ("front",)


@pytest.mark.parametrize("topics", [{"/a": 1}, ["/a"], {"/a": ""}, "/a"])
def test_topics_that_are_none(tmp_path, topics):
    with pytest.raises(MisuseError, match=r"topics is .*; expected for example"):
        Rosbag(str(tmp_path), topics=topics)


@needs_demo
def test_a_real_bag_lists_its_contents():
    from rosbags.highlevel import AnyReader

    said, passed = readings(DEMO)
    assert passed == []
    with AnyReader([Path(DEMO)]) as reader:
        decoded = [
            (stamp, reader.deserialize(data, connection.msgtype))
            for connection, stamp, data in reader.messages()
        ]
    assert len(said) == len(decoded) == 360
    for read, (stamp, message) in zip(said, decoded, strict=True):
        scan, meant = read.reading, message.ranges >= message.range_min
        assert np.array_equal(scan.ranges[meant], message.ranges[meant])
        assert not scan.ranges[~meant].any()
        assert scan.first == -119.53125  # the laser has 340 steps of 360/1024 degrees
        assert np.float32(math.radians(scan.first)) == np.float32(message.angle_min)
        assert scan.step == 0.3515625
        assert scan.range_max == message.range_max
        assert read.stamp == pytest.approx(stamp / 1e9, abs=1e-6)
        assert (scan.mount_x, scan.mount_y, scan.mount_angle) == (0.0, 0.0, 0.0)
