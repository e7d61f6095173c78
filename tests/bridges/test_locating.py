"""`minerva map --poses`: the estimated poses of a robot without an external position."""

import math
from pathlib import Path

import numpy as np
import pytest
from recorded import INTEL, Passed, flaser, needs_intel, odom, write

from minerva_agents.robot.map_recording import map_recording
from minerva_agents.robot.mapping import MapChoice, draw_map, errors_of
from minerva_agents.robot.pose import moved
from minerva_agents.robot.trajectories import Posed, located_scans, posed_scans
from minerva_bus.errors import MisuseError
from minerva_bus.semantics.poses import Pose
from minerva_services.sensors.carmen import CarmenLog, open_log


def located(path, matched=False):
    readings = open_log(path, Passed()).readings()
    return list(located_scans(readings, cell=0.05, farthest=0.0, matched=matched))


def box(x, y, theta, beams=180):
    """Ranges of a 180-degree laser scan in a room of 6 m x 4 m."""
    made = []
    for beam in range(beams):
        heading = theta + math.radians(beam - 90.0) + 1e-9
        ends = [(3.0 if math.cos(heading) > 0 else -3.0, x, math.cos(heading))]
        ends += [(2.0 if math.sin(heading) > 0 else -2.0, y, math.sin(heading))]
        made.append(round(min((end - at) / part for end, at, part in ends), 3))
    return made


def drive(path, slip=0.0, corrected=False):
    """A log of ten steps of 0.2 m and 5 degrees; wheels add `slip` degrees to each step."""
    lines, true, wheels = [], Pose(0.0, 0.0, 0.0), Pose(0.0, 0.0, 0.0)
    for time in range(1, 11):
        at = true.x, true.y, math.radians(true.angle)
        lines.append(odom(wheels.x, wheels.y, math.radians(wheels.angle), time=time))
        lines.append(flaser(box(*at), at, time=time))
        if corrected:
            lines.append(odom(*at, time=0))
            wheels = true
        step = Pose(0.2, 0.0, 5.0)
        true = moved(true, Pose(0.0, 0.0, 0.0), step)
        wheels = moved(wheels, Pose(0.0, 0.0, 0.0), Pose(0.2, 0.0, 5.0 + slip))
    return write(path, *lines)


def off(fix):
    return math.dist((fix.taken.x, fix.taken.y), (fix.published.x, fix.published.y))


def test_a_step_from_elsewhere():
    step = moved(Pose(1.0, 1.0, 90.0), Pose(5.0, 5.0, 0.0), Pose(7.0, 6.0, 30.0))
    assert (step.x, step.y, step.angle) == pytest.approx((0.0, 3.0, 120.0))


def published_angle(located):
    assert located.published is not None
    return located.published.angle


def chained_angle(located):
    assert located.chained is not None
    return located.chained.angle


def test_good_wheels_are_right(tmp_path):
    assert max(off(fix) for fix in located(drive(tmp_path / "a.log"))) < 1e-6


@pytest.mark.parametrize("corrected", [False, True])
def test_wheels_drift_whether_or_not_the_log_was_corrected(tmp_path, corrected):
    """The bridge undoes corrections in the log, so both logs have the same wheel odometry."""
    fixes = located(drive(tmp_path / "a.log", slip=3.0, corrected=corrected))
    turned = chained_angle(fixes[-1]) - published_angle(fixes[-1])
    assert turned == pytest.approx(9 * 3.0)
    assert 0.2 < off(fixes[-1]) < 0.6


def test_matching_puts_it_right(tmp_path):
    fixes = located(drive(tmp_path / "a.log", slip=1.5), matched=True)
    assert max(off(fix) for fix in fixes) < 0.08
    taken = fixes[-1].taken
    assert taken is not None
    assert abs(taken.angle - published_angle(fixes[-1])) < 4.0
    assert chained_angle(fixes[-1]) - published_angle(fixes[-1]) == pytest.approx(9 * 1.5)


def test_without_odometry_it_uses_its_scans(tmp_path):
    lines = [line for line in drive(tmp_path / "a.log").read_text().splitlines() if "F" in line]
    fixes = located(write(tmp_path / "b.log", *lines), matched=True)
    assert all(fix.chained is None for fix in fixes)
    assert max(off(fix) for fix in fixes) < 0.25


def test_a_reading_of_the_same_time_is_where_the_scan_was(tmp_path):
    lines = [odom(1.0, time=5.0), flaser([1.0], time=5.0), odom(9.0, time=4.0), odom(9.0, time=6.0)]
    readings = CarmenLog(write(tmp_path / "a.log", *lines), Passed()).readings()
    scans = posed_scans(readings, odometry=True)
    assert [scan.x for scan in scans if isinstance(scan, Posed)] == [1.0]


def test_errors_as_they_are_and_laid_over_one_another():
    way = [Pose(x, 0.0, 0.0) for x in (0.0, 1.0, 2.0)]
    turned = [Pose(0.0, x, 90.0) for x in (0.0, 1.0, 2.0)]
    errors = errors_of(turned, way)
    assert errors.metres == pytest.approx([0.0, math.sqrt(2), 2 * math.sqrt(2)])
    assert errors.degrees == pytest.approx([90.0] * 3)
    assert errors.aligned == pytest.approx([0.0] * 3, abs=1e-9)


def test_the_command_reports_the_deviation(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    path = drive(tmp_path / "a.log", slip=3.0)
    map_recording(path, tmp_path / "a.pgm", 0.05, 0.0, 0.0, None, "matched")
    said = capsys.readouterr().err
    assert "matched, relative to the published poses: mean 0.0" in said
    assert "odometry alone: mean 0." in said
    assert (tmp_path / "a-errors.png").stat().st_size > 10_000


def test_unknown_poses_are_refused():
    with pytest.raises(MisuseError, match="no poses 'macthed'; did you mean 'matched'"):
        MapChoice(poses="macthed")


@needs_intel
def test_in_a_real_building_it_stays_where_it_is():
    """The first minutes, in which the robot turns on the spot and then drives off."""
    choice = MapChoice(cell=0.05, end=180.0, poses="matched")
    drift = draw_map(lambda: open_log(Path(INTEL), Passed()), choice, lambda part: None).drift
    assert drift is not None
    assert drift.chained is not None
    assert len(drift.seconds) > 40
    assert drift.chained.metres.max() > 3.0
    assert drift.taken.metres.mean() < 1.0
    assert np.mean(drift.taken.aligned) < 0.3
