"""CARMEN logs: the readings of their lines, skipped lines, and a real log."""

import gzip
import math
import re
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded import INTEL, Passed, flaser, needs_intel, odom, raw_laser, robot_laser, write

from minerva_bus.errors import MisuseError
from minerva_bus.log.recordings import RecordingError
from minerva_bus.wire.field_codecs import plain_reading, read_reading
from minerva_bus.world.readings import Odometry, Scan
from minerva_services.sensors.carmen import Carmen, CarmenLog
from minerva_services.sensors.carmen.log import (
    LineError,
    LogTopics,
    OtherMessage,
    angles_of,
    read_line,
)
from minerva_services.sensors.playback import MountOverride


def readings(path, **options):
    passed = Passed()
    log = CarmenLog(path, passed, **options)
    said = list(log.readings())
    log.close()
    return said, passed


def log_of(tmp_path, *lines, **options):
    return readings(write(tmp_path / "some.log", *lines), **options)


def only(said, topic):
    (reading,) = [message.reading for message in said if message.topic == topic]
    return reading


@pytest.mark.parametrize(
    ("beams", "first", "last", "step"),
    [
        (180, -90.0, 89.0, 1.0),
        (181, -90.0, 90.0, 1.0),
        (360, -90.0, 89.5, 0.5),
        (361, -90.0, 90.0, 0.5),
        (720, -90.0, 89.75, 0.25),
        (721, -90.0, 90.0, 0.25),
    ],
)
def test_beam_directions_of_a_faulty_laser(beams, first, last, step):
    assert angles_of(beams) == (first, step)
    assert first + (beams - 1) * step == pytest.approx(last)


def test_a_front_laser_is_a_scan_and_before_it_the_corrected_pose(tmp_path):
    line = flaser([1.5, 81.91, 2.5], (1.0, 2.0, math.pi / 2), 7.25)
    (pose, scan), passed = log_of(tmp_path, line)
    assert (pose.topic, scan.topic, passed) == ("pose", "scan", [])
    assert pose.reading == Odometry("r1", 1.0, 2.0, 90.0, 0.0, 0.0, 7.25)
    assert scan.reading.ranges.tolist() == [1.5, np.float32(81.91), 2.5]
    assert (scan.reading.first, scan.reading.step, scan.reading.range_max) == (-90.0, 90.0, 80.0)
    assert scan.reading.ranges.dtype == np.float32
    assert pose.stamp == scan.stamp == scan.reading.time == 7.25


def test_a_parameter_gives_the_offset_of_the_laser(tmp_path):
    lines = ["PARAM robot_frontlaser_offset 0.5 host 0", flaser([1.0], (1.0, 2.0, math.pi / 2))]
    said, _ = log_of(tmp_path, *lines)
    scan, pose = only(said, "scan"), only(said, "pose")
    assert (scan.mount_x, scan.mount_y, scan.mount_angle) == (0.5, 0.0, 0.0)
    assert (pose.x, pose.y, pose.angle) == pytest.approx((1.0, 1.5, 90.0))


def test_a_mount_that_is_given_overrides_it(tmp_path):
    lines = ["PARAM robot_frontlaser_offset 0.5 host 0", flaser([1.0], (1.0, 2.0, 0.0))]
    said, _ = log_of(tmp_path, *lines, mounting=MountOverride(0.0, 0.25, 180.0))
    scan, pose = only(said, "scan"), only(said, "pose")
    assert (scan.mount_x, scan.mount_y, scan.mount_angle) == (0.0, 0.25, 180.0)
    assert (pose.x, pose.y, pose.angle) == pytest.approx((1.0, 2.25, -180.0))


def test_a_robot_laser_message_describes_itself(tmp_path):
    line = robot_laser([1.0, 25.0, 3.0], (1.0, 2.2, math.pi), (1.0, 2.0, math.pi / 2), most=20.0)
    said, passed = log_of(tmp_path, line)
    scan, pose = only(said, "scan"), only(said, "pose")
    assert (scan.first, scan.step, scan.range_max) == pytest.approx((-45.0, 45.0, 20.0))
    assert (scan.mount_x, scan.mount_y, scan.mount_angle) == pytest.approx((0.2, 0.0, 90.0))
    assert (pose.x, pose.y, pose.angle) == pytest.approx((1.0, 2.0, 90.0))
    assert passed == []


def test_a_raw_laser_does_not_know_where_it_is(tmp_path):
    (scan,), _ = log_of(tmp_path, raw_laser([1.0, 2.0, 3.0], 4.0))
    assert (scan.topic, scan.stamp) == ("scan", 4.0)
    assert (scan.reading.first, scan.reading.step) == pytest.approx((-90.0, 90.0))


def test_wheel_odometry(tmp_path):
    (said,), _ = log_of(tmp_path, odom(1.0, 2.0, math.pi / 2, 0.5, math.pi, time=3.0))
    assert said.topic == "odometry"
    assert said.reading == Odometry("r1", 1.0, 2.0, 90.0, 0.5, 180.0, 3.0)


def test_a_laser_line_states_the_odometry_of_a_log_without_other_odometry(tmp_path):
    """A corrected log keeps it as its second pose; equal poses are both corrected, or both not."""
    corrected = [flaser([1.0], (x, 0.0, 0.0), x, (x + 0.5, 2.0, 0.0)) for x in (1.0, 2.0)]
    said, _ = log_of(tmp_path, flaser([1.0], (9.0, 0.0, 0.0)), *corrected)
    wheels = [message.reading for message in said if message.topic == "odometry"]
    assert wheels == [Odometry("r1", x + 0.5, 2.0, 0.0, 0.0, 0.0, x) for x in (1.0, 2.0)]
    poses = [message.reading.x for message in said if message.topic == "pose"]
    assert poses == [9.0, 1.0, 2.0]
    said, _ = log_of(tmp_path, odom(time=1.0), *corrected)
    assert [message.reading.x for message in said if message.topic == "odometry"] == [0.0]


def test_a_range_that_is_no_number_is_no_hit(tmp_path):
    said, passed = log_of(tmp_path, "FLASER 3 1.5 nan inf 0 0 0 0 0 0 1 h 1")
    (scan,) = [message.reading for message in said if isinstance(message.reading, Scan)]
    assert scan.ranges.tolist() == [1.5, 0.0, math.inf]
    assert read_reading(plain_reading(scan)).ranges.tolist() == scan.ranges.tolist()
    assert not passed


def test_a_correction_among_the_odometry_is_counted_and_passed_over(tmp_path):
    said, passed = log_of(tmp_path, odom(time=5.0), odom(7.0, 7.0, time=0), odom(time=4.0))
    assert [message.stamp for message in said] == [5.0, 4.0]
    assert len(passed.of("lines without a time")) == 1
    assert "line 2" in passed[0][1]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("FLASER", "line ends after 1 words"),
        ("FLASER 180 1.0 2.0", "line ends after 4 words"),
        ("FLASER many", "not a number of beams"),
        ("FLASER -1", "not a number of beams"),
        ("FLASER 99999999 1", "not a number of beams"),
        ("FLASER 0 0 0 0 0 0 0 1 h 1", "no beams"),
        (
            robot_laser([1.0, 2.0], (0, 0, 0), (0, 0, 0), step=0.0),
            "the resolution is 0, with 2 beams",
        ),
        ("FLASER 1 x 0 0 0 0 0 0 1 h 1", "invalid range"),
        ("FLASER 3 1 2 0 0 0 0 0 0 1 h 1", "3 beams announced, 2 found"),
        ("FLASER 1 1 2 3 0 0 0 0 0 0 1 h 1", "1 beams announced, 3 found"),
        ("FLASER 1 1,5 0 0 0 0 0 0 1 h 1", "invalid range: .*'1,5'; write decimals with a point"),
        ("ODOM 0 0,5 0 0 0 0 1 h 1", "'0,5' is not a number; write decimals with a point"),
        (raw_laser([1.5, 2.5]).replace(" 2 1.5", " 1 1.5"), "1 beams announced, which no number"),
        (robot_laser([1.5], (0, 0, 0), (0, 0, 0)) + " 7", "15 words follow them; expected 14"),
        ("FLASER 1 1.0 nan 0 0 0 0 0 1 h 1", "not finite"),
        ("ODOM 0 0 zero 0 0 0 1 h 1", "'zero' is not a number"),
        ("ODOM 0 0 0 0 0 0 1 h", "line ends"),
        ("\x00\x7f\x01 1 2", "not a CARMEN message"),
    ],
)
def test_garbage_is_skipped_and_its_first_line_reported(tmp_path, line, why):
    said, passed = log_of(tmp_path, "# a log", odom(), line, odom(), line)
    assert len(said) == 2
    (first, _) = passed.of("lines passed over")
    assert "some.log: line 3 skipped" in first
    assert re.search(why, first)


@given(
    st.text(max_size=60)
    | st.lists(st.sampled_from(["FLASER", "ODOM", "1", "2", "x", "nan", "0"])).map(" ".join)
)
def test_no_line_breaks_the_reader(line):
    try:
        read_line(line)
    except (LineError, OtherMessage) as error:
        assert str(error)


@pytest.mark.parametrize("line", ["", "# FLASER 1", "NEFF 15", "SYNC x", "PARAM a 1 h 0"])
def test_other_lines_are_no_garbage(tmp_path, line):
    said, passed = log_of(tmp_path, line, odom())
    assert len(said) == 1
    assert [what for what, _ in passed] == ["other messages"] * (line[:1] in ("N", "S"))


def test_a_gzipped_log_that_breaks_off_is_played_as_far_as_it_goes(tmp_path):
    whole = gzip.compress("\n".join(odom(x=i * 1.37) for i in range(5000)).encode())
    path = tmp_path / "cut.log.gz"
    path.write_bytes(whole[: len(whole) // 2])
    said, passed = readings(path)
    assert 0 < len(said) < 5000
    assert "breaks off after line" in passed.of("broken off")[0]


@pytest.mark.parametrize(
    "content", [b"", b"no log at all\n", bytes(range(256)) * 40, b"\x1f\x8b\x08"]
)
def test_a_file_without_readings_is_one_message(tmp_path, content):
    path = tmp_path / "other.log"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"other\.log: "):
        readings(path)


def test_an_error_says_why_the_first_line_was_skipped(tmp_path):
    with pytest.raises(RecordingError, match="such as FLASER; line 1 skipped: 'x' is not a number"):
        log_of(tmp_path, "ODOM x 0 0 0 0 0 1 h 1", "FLASER 0 0 0 0 0 0 0 1 h 1")


def test_topics_and_the_robot_are_up_to_the_world(tmp_path):
    lines = [flaser([1.0]), odom()]
    said, _ = log_of(tmp_path, *lines, topics=LogTopics("front", "", "there"), robot="r7")
    assert [message.topic for message in said] == ["there", "front"]
    assert {message.reading.robot for message in said} == {"r7"}
    service = Carmen(str(tmp_path / "some.log"), scan="front", odometry="")
    assert service.publishes == ("front", "pose")
    assert Carmen.publishes == ()


def test_a_wrong_range(tmp_path):
    write(tmp_path / "some.log", odom())
    with pytest.raises(MisuseError, match="range_max is -1"):
        Carmen(str(tmp_path / "some.log"), range_max=-1.0)


def test_each_round_is_independent(tmp_path):
    """A parameter that appears late in a log has no effect on the start of the next round."""
    log = CarmenLog(
        write(tmp_path / "a.log", flaser([1.0]), "PARAM robot_frontlaser_offset 0.5 h 0"), Passed()
    )
    first, again = (only(log.readings(), "scan") for _ in range(2))
    assert first.mount_x == again.mount_x == 0.0


def by_hand():
    """Scans and odometry of the Intel log, parsed independently of the bridge."""
    scans, wheels = [], []
    with gzip.open(INTEL, "rt") as file:
        for line in file:
            kind, *rest = line.split(" ")
            if kind == "FLASER":
                beams, pose = rest[1:181], rest[181:184]
                scans.append(([float(x) for x in beams], [float(x) for x in pose], float(rest[-1])))
            elif kind == "ODOM" and float(rest[-1]):
                wheels.append([float(rest[i]) for i in (0, 1, 2, 8)])
    return scans, wheels


@pytest.fixture(scope="module")
def intel():
    return *readings(INTEL), *by_hand()


@needs_intel
def test_the_intel_log_is_read_as_it_is_written(intel):
    said, passed, scans, wheels = intel
    assert Counter(message.topic for message in said) == {
        "scan": 910,
        "pose": 910,
        "odometry": 13700,
    }
    # 69 lines of odometry have damaged times, such as 1.08e-42.
    assert Counter(what for what, _ in passed) == {
        "lines without a time": 841,
        "clock steps back": 69,
        "other messages": 910,
    }
    assert len(scans) == 910
    assert len(wheels) == 13700
    read = [message.reading for message in said if isinstance(message.reading, Scan)]
    for scan, (ranges, _, time) in zip(read, scans, strict=True):
        assert np.array_equal(scan.ranges, np.array(ranges, np.float32))
        assert (scan.first, scan.step, scan.time) == (-90.0, 1.0, time)
    poses = [message.reading for message in said if message.topic == "pose"]
    corrected = [(pose.x, pose.y, math.radians(pose.angle)) for pose in poses]
    assert np.allclose(corrected, [pose for _, pose, _ in scans])
    moved = [message.reading for message in said if message.topic == "odometry"]
    assert np.allclose([(o.x, o.y, math.radians(o.angle), o.time) for o in moved], wheels)


@needs_intel
def test_a_beam_without_hit_is_no_event(intel):
    said, _, scans, _ = intel
    read = [message.reading for message in said if message.topic == "scan"]
    hit = sum(np.count_nonzero((scan.ranges > 0) & (scan.ranges < scan.range_max)) for scan in read)
    assert hit == sum(0 < dist < 80 for ranges, _, _ in scans for dist in ranges)


@needs_intel
def test_every_reading_can_travel(intel):
    for message in intel[0][::97]:
        plain = plain_reading(message.reading)
        assert plain_reading(read_reading(plain)) == plain
