"""Recordings whose clocks step back: nothing is lost, misplaced or left out silently."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded import Passed, flaser, messages, odom, raw_laser, write, write_bag
from sweeping import drive, place_at, spread

from minerva_agents.robot.map_recording import map_recording
from minerva_agents.robot.mapping import Drift, MapChoice, TrajectoryPoint, draw_map
from minerva_agents.robot.trajectories import Posed, ScanMotion, located_scans, posed_scans
from minerva_bus.log.recordings import STEP_SECONDS, Compensator, Recorded, RecordingClock
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Odometry, Scan, hits
from minerva_services.bridges.ros2 import Ros2
from minerva_services.bridges.rosbag import open_bag
from minerva_services.sensors.carmen import CarmenLog
from minerva_services.sensors.clocks import SHARED_TOPIC, ClockWatch

BACK = [0.3, 2.0, 100.0, 1e6]


def seconds_at(*times):
    clock = RecordingClock()
    return [clock.advance(time) for time in times], clock.seconds, clock.steps


@pytest.mark.parametrize(
    ("times", "passed", "seconds", "steps"),
    [
        ((10.0, 11.0, 13.0), [0.0, 1.0, 2.0], 3.0, 0),
        ((10.0, 12.0, 5.0, 6.0), [0.0, 2.0, 0.0, 1.0], 3.0, 1),
        ((10.0, 12.0, 11.5, 12.5), [0.0, 2.0, 0.0, 0.5], 2.5, 0),
        ((10.0, 12.0, 0.0, 12.5), [0.0, 2.0, 0.0, 0.5], 2.5, 1),
        ((float("nan"), 10.0, float("-inf"), 11.0), [0.0, 0.0, 0.0, 1.0], 1.0, 0),
    ],
    ids=["steady", "step", "late", "damaged", "not finite"],
)
def test_the_time_of_a_recording(times, passed, seconds, steps):
    assert seconds_at(*times) == (passed, seconds, steps)


@given(st.lists(st.floats(-1e9, 1e9) | st.just(float("nan")), max_size=30))
def test_it_never_goes_back(times):
    clock, seconds = RecordingClock(), [0.0]
    for time in times:
        assert clock.advance(time) >= 0
        seconds.append(clock.seconds)
    assert all(after >= before - 1e-5 for before, after in pairwise(seconds))


def test_default_windows_filter_nothing(tmp_path):
    times = [1000.0 + number - 500.0 * (number >= 3) for number in range(6)]
    lines = [flaser([1.0], (x, 0.0, 0.0), time=time) for x, time in enumerate(times)]
    path, passed = write(tmp_path / "a.log", *lines), Passed()
    made = draw_map(lambda: CarmenLog(path, passed), MapChoice(), lambda part: None)
    assert made.way[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    step = "steps back by 499.0 s (2.0 s after the beginning)"
    assert f"{path}: the clock of scan {step}" in passed.of("clock steps back")


def test_a_window_is_in_seconds_of_the_recording(tmp_path):
    times = [1000.0, 1001.0, 1002.0, 400.0, 401.0, 402.0]
    lines = [flaser([1.0], (x, 0.0, 0.0), time=time) for x, time in enumerate(times)]
    path = write(tmp_path / "a.log", *lines)
    choice = MapChoice(begin=1.0, end=3.0)
    made = draw_map(lambda: CarmenLog(path, Passed()), choice, lambda part: None)
    assert made.way[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize("back", BACK)
def test_a_bag_is_placed_by_its_own_odometry(tmp_path, capsys, back):
    pytest.importorskip("rosbags")
    types, store = messages()
    said = []
    for number in range(60):
        recorded = 2e6 + 0.1 * number
        stamp = recorded - back * (number >= 20)
        x = 0.005 * number
        said += [(recorded, "/odom", types.odometry(x, 0.0, 0.0, time=stamp))]
        said += [(recorded + 0.01, "/scan", types.scan([2.0 - x] * 3, time=stamp + 0.01))]
    path = write_bag(tmp_path / "a.mcap", store, said)
    map_recording(path, tmp_path / "map.pgm", 0.05, 0.0, 0.0, None)
    lines = capsys.readouterr().err
    assert "from 60 scans" in lines
    assert "skipped" not in lines
    assert ("the clock of odometry (odom) steps back by" in lines) == (back > STEP_SECONDS)


def wheels(seconds, back=0.0):
    reading = Odometry("r1", seconds, 0.0, 0.0, 0.0, 0.0, seconds - back)
    return Recorded(seconds, "odometry", reading)


def scanned(seconds, back=0.0, latency=0.0):
    """A scan whose range is its true place."""
    scan = Scan("r1", np.array([seconds], np.float32), 0.0, 1.0, 99.0, seconds - back)
    return Recorded(seconds + latency, "scan", scan)


@pytest.mark.parametrize("back", BACK)
@pytest.mark.parametrize("latency", [0.0, 0.07, 0.15])
def test_each_scan_is_placed_in_its_own_segment(back, latency):
    said = [wheels(t, back * (t >= 2.0)) for t in np.arange(0.0, 4.0, 0.05)]
    said += [scanned(t, back * (t >= 2.0), latency) for t in np.arange(0.12, 3.9, 0.1)]
    posed = list(posed_scans(sorted(said, key=lambda recorded: recorded.stamp)))
    wrong = [
        scan.scan.time
        for scan in posed
        if not isinstance(scan, Posed) or abs(scan.x - scan.scan.ranges[0]) > 0.06
    ]
    assert wrong == []


def test_a_late_scan_is_between_the_odometry_of_its_time():
    said = [wheels(t) for t in (1.0, 1.2, 1.4)] + [scanned(1.1), wheels(1.6)]
    (scan,) = posed_scans(said)
    assert isinstance(scan, Posed)
    assert scan.x == pytest.approx(1.1)


def test_of_odometry_with_one_time_the_latest_counts():
    corrected = replace(wheels(1.0), reading=replace(wheels(1.0).reading, x=7.0))
    for after in ([], [wheels(2.0)]):
        (scan,) = posed_scans([wheels(0.5), wheels(1.0), corrected, scanned(1.0), *after])
        assert scan.x == 7.0


@pytest.mark.parametrize("ahead", [2.0, 100.0])
def test_a_scan_before_a_gap_has_the_odometry_before_it(ahead):
    said = [wheels(1.0), wheels(1.1), scanned(1.11), wheels(1.1 + ahead), scanned(1.2 + ahead)]
    posed = list(posed_scans(said))
    places = [scan.x if isinstance(scan, Posed) else None for scan in posed]
    assert places == [1.1, 1.1 + ahead]


def test_one_scan_from_the_future_does_not_hold_up_the_others():
    said = [wheels(1.0), scanned(1.1, back=-100.0), scanned(1.2), wheels(1.3), scanned(1.4)]
    posed = list(posed_scans([*said, wheels(1.5)]))
    places = [scan.x if isinstance(scan, Posed) else None for scan in posed]
    assert places == [None, pytest.approx(1.2), pytest.approx(1.4)]


def stepped(recorded, at, back):
    """A recording whose sensors' clock is set back."""
    return [
        replace(item, reading=replace(item.reading, time=item.reading.time - back))
        if item.reading.time >= at
        else item
        for item in recorded
    ]


@pytest.mark.parametrize("back", BACK)
def test_scans_on_both_sides_of_a_step_are_corrected_for_motion(back):
    # Each scan arrives with its first beam, so it waits for odometry when the clock is set back.
    recorded = [
        replace(item, stamp=item.reading.time)
        for item in drive(partial(place_at, speed=0.3, turn=60.0))
    ]
    recorded = stepped(sorted(recorded, key=lambda item: item.stamp), 1.0, back)
    uncorrected = []
    ready = list(Compensator(uncorrected=lambda: uncorrected.append(1)).all(recorded))
    assert [item.stamp for item in ready] == [item.stamp for item in recorded]
    assert uncorrected == []


def test_matched_scans_on_both_sides_of_a_step_are_corrected_for_motion():
    place = partial(place_at, speed=0.3, turn=15.0)
    recorded = stepped(drive(place, odometry=False), 1.0, 2.0)
    scans = partial(located_scans, recorded, matched=True, cell=0.05, farthest=0.0)
    again = list(scans(motion=ScanMotion.of(scans())))
    times = [item.scan.time + 2.0 * (number >= 5) for number, item in enumerate(again)]
    errors = [
        spread(item.scan, place(time), *hits(item.scan))
        for item, time in zip(again, times, strict=True)
    ]
    assert max(errors) < 1.0


def test_two_sensors_of_one_topic_are_told_apart(tmp_path, capsys):
    pytest.importorskip("rosbags")
    types, store = messages()
    frames = ["front", "back", "front", "back", "front"]
    times = [100.0, 10.0, 101.0, 11.0, 50.0]  # the clock of the front is set back at last
    scans = [
        (2e6 + number, "/scan", types.scan([1.0, 1.0], time, frame))
        for number, (time, frame) in enumerate(zip(times, frames, strict=True))
    ]
    path, passed = write_bag(tmp_path / "two.mcap", store, scans), Passed()
    list(open_bag(path, passed).readings())
    shared = "scan has readings of front, back; give each sensor its own topic"
    assert passed.of("sensors on one topic") == [f"{path}: {shared} (1.0 s after the beginning)"]
    step = "the clock of scan (front) steps back by 51.0 s"
    assert passed.of("clock steps back") == [f"{path}: {step} (4.0 s after the beginning)"]
    bridge, kind = Ros2("tcp/h:1", mount="0, 0, 0"), "sensor_msgs/msg/LaserScan"
    for _, _, message in scans:
        bridge.reading(kind, bytes(store.serialize_cdr(message, kind)))
    lines = capsys.readouterr().out.splitlines()
    assert [shared in lines[0], step in lines[1], len(lines)] == [True, True, 2]


def test_the_sensors_that_are_remembered_are_bounded():
    watch = ClockWatch()
    found = [what for n in range(1000) for what, _ in watch.problems("scan", 1.0, f"f{n}")]
    assert set(found) == {SHARED_TOPIC}
    assert len(watch._latest["scan"]) <= 100


def test_errors_over_time_continue_after_a_step():
    here = Pose(0.0, 0.0, 0.0)
    points = [TrajectoryPoint(time, here, here, here) for time in (5.0, 7.0, 1.0, 2.0)]
    assert Drift.of(points).seconds.tolist() == [0.0, 2.0, 2.0, 3.0]


def test_scans_without_a_pose_are_counted_with_their_reason(tmp_path, capsys):
    lines = [raw_laser([1.0, 1.0, 1.0], time=1.0), odom(time=90.0), raw_laser([1.0] * 3, time=90.0)]
    map_recording(write(tmp_path / "a.log", *lines), tmp_path / "a.pgm", 0.05, 0.0, 0.0, None)
    assert "1 scans skipped: no odometry within 1 s" in capsys.readouterr().err
