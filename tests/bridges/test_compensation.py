"""Motion compensation of scans by a rotating lidar on a moving robot."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeping import drive, place_at, spread, swept, without_path

from minerva_agents.robot.mapping import MapChoice, draw_map
from minerva_agents.robot.time_offset import OffsetEstimator
from minerva_agents.robot.trajectories import ScanMotion, located_scans
from minerva_bus.log.recordings import Compensator, Recorded, path_of
from minerva_bus.semantics.poses import Pose
from minerva_bus.wire.field_codecs import plain_reading, read_reading
from minerva_bus.world.readings import Odometry, Scan, hits
from minerva_services.bridges.ros2.mobile_base import scanned_from

FORWARD, TURNING, BOTH = (1.0, 0.0), (0.0, 90.0), (0.5, -60.0)


def scans_of(recorded, **options):
    counted = []
    ready = Compensator(uncorrected=lambda: counted.append(1), **options).all(recorded)
    return [message.reading for message in ready if isinstance(message.reading, Scan)], len(counted)


def spreads(scans, place):
    """Largest error of a scan in cm, before and after compensation."""
    both = [
        [spread(scan, place(scan.time), *hits(seen)) for seen in (without_path(scan), scan)]
        for scan in scans
    ]
    return np.max(both, axis=0).tolist()


@pytest.mark.parametrize("motion", [FORWARD, TURNING, BOTH], ids=["forward", "turning", "both"])
@pytest.mark.parametrize("step", [1.0, -1.0], ids=["counter-clockwise", "clockwise"])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.2, -0.1, 90.0)])
def test_walls_are_sharp(motion, step, mount):
    place = partial(place_at, speed=motion[0], turn=motion[1])
    scans, uncorrected = scans_of(drive(place, step=step, mount=mount))
    before, after = spreads(scans, place)
    assert (before > 5.0, after < 0.2, uncorrected) == (True, True, 0)


def test_beams_in_the_reverse_order_of_time():
    place = partial(place_at, speed=0.5, turn=90.0)
    scan = swept(1.0, 360, 1.0, -0.2 / 360, place)
    wheels = [place(time) for time in (0.6, 0.8, 1.0, 1.2)]
    scan = replace(scan, path=path_of(scan, [0.6, 0.8, 1.0, 1.2], wheels))
    before, after = spreads([scan], place)
    assert (before > 5.0, after < 0.5) == (True, True)


def test_a_sweep_over_many_readings_of_odometry_follows_each_of_them():
    """A slow lidar on a robot that turns first to one side and then to the other."""

    def place(time):
        return Pose(0.0, 0.0, 90.0 * (time if time < 1.0 else 2.0 - time))

    scan = swept(0.5, 360, 1.0, 1.0 / 360, place)
    wheels = [Recorded(t, "odometry", _odometry(place(t), t)) for t in np.arange(0.0, 2.0, 0.1)]
    at = [wheel for wheel in wheels if wheel.stamp < 1.6]
    (corrected,), _ = scans_of([*at, Recorded(1.6, "scan", scan), *wheels[len(at) :]])
    before, after = spreads([corrected], place)
    assert (before > 20.0, after < 0.2) == (True, True)


def _odometry(at, time):
    return Odometry("r1", at.x, at.y, at.angle, 0.0, 0.0, time)


def test_a_scan_waits_for_the_odometry_of_its_last_beams():
    place = partial(place_at, speed=0.0, turn=90.0)
    scan = Recorded(1.01, "scan", swept(1.0, 360, 1.0, 0.2 / 360, place))
    wheels = [Recorded(t, "odometry", _odometry(place(t), t)) for t in (0.9, 1.0, 1.1, 1.2, 1.3)]
    compensator = Compensator()
    ready = [message for each in (*wheels[:2], scan) for message in compensator.add(each)]
    assert ready == wheels[:2]
    assert compensator.add(wheels[2]) == []
    passed = compensator.add(wheels[3])
    assert [message.topic for message in passed] == ["scan", "odometry", "odometry"]
    assert spreads([passed[0].reading], place)[1] < 0.2


@pytest.mark.parametrize(
    "times",
    [(), (0.9,), (0.1, 0.3), (0.9, 2.5), (3.0, 3.1)],
    ids=["none", "one", "long ago", "far between", "later"],
)
def test_without_odometry_of_its_time_a_scan_is_counted_and_passed_on(times):
    place = partial(place_at, speed=0.0, turn=90.0)
    scan = Recorded(1.2, "scan", swept(1.0, 360, 1.0, 0.2 / 360, place))
    wheels = [Recorded(t, "odometry", _odometry(place(t), t)) for t in times]
    scans, uncorrected = scans_of(sorted([scan, *wheels], key=lambda message: message.stamp))
    assert (len(scans), scans[0].path, uncorrected) == (1, (), 1)


def test_odometry_that_jumps_moves_no_wall():
    place = partial(place_at, speed=0.0, turn=0.0)
    scan = Recorded(1.2, "scan", swept(1.0, 360, 1.0, 0.2 / 360, place))
    wheels = [Recorded(t, "odometry", _odometry(place(t), t)) for t in (0.9, 1.0, 1.05)]
    wheels += [Recorded(t, "odometry", _odometry(Pose(90.0, 0.0, 0.0), t)) for t in (1.1, 1.3)]
    (scan,), uncorrected = scans_of(sorted([scan, *wheels], key=lambda message: message.stamp))
    assert (scan.path, uncorrected) == ((), 1)


def test_scans_with_simultaneous_beams_stay_unchanged():
    scan = Scan("r1", np.ones(9, np.float32), 0.0, 1.0, 8.0, 1.0)
    recorded = Recorded(1.0, "scan", scan)
    assert Compensator().add(recorded) == [recorded]


def test_the_time_offset_of_a_lidar_that_stamps_its_last_beam():
    place = partial(place_at, speed=0.0, turn=90.0)
    late = [
        replace(message, reading=replace(message.reading, time=message.reading.time + 0.2))
        if message.topic == "scan"
        else message
        for message in drive(place)
    ]
    right, wrong = scans_of(late, offset=-0.2)[0], scans_of(late)[0]
    assert spreads(right, place)[1] < 0.2
    assert all(scan.path for scan in wrong)
    assert [scan.time for scan in right] == pytest.approx([scan.time - 0.2 for scan in wrong])


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-1.5, 1.5), st.floats(-180, 180), st.sampled_from([1.0, -1.0]), st.floats(0.05, 0.3)
)
def test_corrected_hits_lie_on_the_walls(speed, turn, step, seconds):
    place = partial(place_at, speed=speed, turn=turn, start=(0.0, 0.0, 20.0), begin=0.5)
    times = np.arange(0.0, 1.5, 0.02).tolist()
    scan = swept(0.5, 90, 4.0 * step, seconds / 90, place)
    scan = replace(scan, path=path_of(scan, times, [place(time) for time in times]))
    assert spread(scan, place(0.5), *hits(scan)) < 0.5


# --- consumers of compensated scans ---------------------------------------------------------------


def test_a_sweep_travels():
    place = partial(place_at, speed=0.5, turn=90.0)
    (scan, *_), _ = scans_of(drive(place, beams=36, step=10.0))
    plain = plain_reading(scan)
    assert (plain[0], len(scan.path) > 2) == ("sweep", True)
    again = read_reading(plain)
    assert isinstance(again, Scan)
    assert (again.beam_time, again.path) == (scan.beam_time, scan.path)
    assert plain_reading(again) == plain


def test_a_scan_of_an_older_record_has_no_beam_times():
    plain = plain_reading(Scan("r1", np.ones(2, np.float32), 0.0, 1.0, 8.0, 1.0))
    assert (plain[0], len(plain)) == ("scan", 8)
    scan = read_reading(plain)
    assert isinstance(scan, Scan)
    assert (scan.beam_time, scan.path) == (0.0, ())


def test_a_scan_from_another_pose_keeps_its_walls():
    """`ros2_robot` transforms a scan if the robot's pose differs from its pose in the string."""
    place, shift = partial(place_at, speed=0.5, turn=90.0), Pose(0.3, -0.2, 25.0)
    (scan, *_), _ = scans_of(drive(place, mount=(0.2, 0.1, 30.0)))
    other = scanned_from(shift, scan, "r1")
    for number in (0, 100, 359):
        ends = [_end(reading, number) for reading in (scan, other)]
        assert shift.compose(Pose(*ends[0])).x == pytest.approx(Pose(*ends[1]).x, abs=2e-3)
        assert shift.compose(Pose(*ends[0])).y == pytest.approx(Pose(*ends[1]).y, abs=2e-3)


def _end(scan, number):
    dist, angle = hits(scan)
    turn = np.radians(angle[number])
    return float(dist[number] * np.cos(turn)), float(dist[number] * np.sin(turn)), 0.0


class Tape:
    """A recording in memory."""

    part = 0.5

    def __init__(self, recorded):
        self.recorded = recorded

    def readings(self):
        return iter(self.recorded)

    def close(self):
        pass


def wall_cells(recorded, **choice):
    made = draw_map(lambda: Tape(recorded), MapChoice(**choice), lambda part: None)
    return int((made.grid > 1).sum()), made.uncorrected


@pytest.mark.parametrize("poses", ["odometry", "matched"])
def test_a_map_has_thin_walls(poses):
    place = partial(place_at, speed=0.0, turn=90.0)
    recorded = drive(place, seconds=4.0)
    at_once = [
        replace(message, reading=replace(message.reading, beam_time=0.0))
        if message.topic == "scan"
        else message
        for message in recorded
    ]
    # The walls must not lie on borders between cells: those are marked on both sides.
    sharp, uncorrected = wall_cells(recorded, poses=poses, cell=0.07)
    smeared, _ = wall_cells(at_once, poses=poses, cell=0.07)
    assert (sharp < 0.75 * smeared, uncorrected) == (True, 0)


def test_without_odometry_matching_finds_the_motion_first():
    place = partial(place_at, speed=0.3, turn=15.0)
    recorded = drive(place, odometry=False)
    scans = partial(located_scans, recorded, matched=True, cell=0.05, farthest=0.0)
    located = list(scans())
    again = scans(motion=ScanMotion.of(located))
    before, after = spreads([message.scan for message in again], place)
    assert (before > 8.0, after < 1.0) == (True, True)
    assert wall_cells(recorded, poses="matched")[1] == 0


# --- the time offset is estimated ---


def sharper(place, late=0.0, **more):
    """The estimate for a recording whose scans are stamped too late."""
    estimator = OffsetEstimator()
    recorded = drive(place, **{"seconds": 8.0, "beams": 120, "step": 3.0, **more})
    for _ in estimator.watched(Compensator(late).all(recorded)):
        pass
    return estimator.sharper(0.05)


def wavering(time):
    """A robot that turns to one side and to the other."""
    return Pose(0.3 * np.sin(time), 0.2 * np.cos(time), float(40 * np.sin(1.5 * time)))


@pytest.mark.parametrize("late", [0.15, -0.3])
@pytest.mark.parametrize("step", [3.0, -3.0], ids=["counter-clockwise", "clockwise"])
def test_the_offset_with_the_sharpest_walls_is_suggested(late, step):
    found = sharper(wavering, late, step=step, mount=(0.2, -0.1, 90.0))
    assert found.offset == pytest.approx(-late, abs=0.02)
    assert found.cells < 0.9


@pytest.mark.parametrize(
    ("place", "late", "more"),
    [
        (wavering, 0.0, {}),
        (partial(place_at, speed=0.2, turn=0.0), 0.2, {}),
        (wavering, 2.0, {}),
        (wavering, 0.15, {"rate": 1.0}),
        (wavering, 0.15, {"odometry": False}),
    ],
    ids=["right", "no turn", "too far", "rare odometry", "no odometry"],
)
def test_no_offset_is_suggested_without_a_sharper_map(place, late, more):
    assert sharper(place, late, **more) is None


@pytest.mark.parametrize("poses", ["published", "matched"])
@pytest.mark.parametrize(
    ("present", "suggested"),
    [(0.25, "with --time-offset 0.00"), (0.0, None)],
    ids=["late", "right"],
)
def test_a_map_suggests_its_time_offset(poses, present, suggested):
    recorded = drive(wavering, seconds=6.0, beams=120, step=3.0)
    choice = MapChoice(poses=poses, time_offset=present)
    notes = draw_map(lambda: Tape(recorded), choice, lambda part: None).notes
    said = [note for note in notes if "walls are sharper" in note]
    assert [suggested in note for note in said] == [True] * (suggested is not None)
