"""Laser beams: from the displayed place of a robot to the points that they hit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from window_world import discs

from minerva_bus.semantics.picture import Picture
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Scan, Sightings
from minerva_services.views.window.composer import ScanBuffer, beams_of


def scan(robot="b1", ranges=(1.0, 2.0, 8.0), time=0.0, **more):
    return Scan(robot, np.array(ranges, np.float32), 0.0, 90.0, 8.0, time, **more)


def test_beams_end_at_their_ranges():
    beams = beams_of(scan(), Pose(1.0, 2.0, 90.0))
    assert (beams.x, beams.y) == (1.0, 2.0)
    assert beams.ends == pytest.approx(np.array([[1.0, 3.0], [-1.0, 2.0], [1.0, -6.0]]))
    assert beams.hits.tolist() == [True, True, False]


def test_a_beam_without_return_ends_at_the_range():
    beams = beams_of(scan(ranges=(np.inf, np.nan, 9.0)), Pose())
    assert beams.hits.tolist() == [False] * 3
    assert np.hypot(*beams.ends.T) == pytest.approx(np.full(3, 8.0))


@given(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(-360, 360), st.floats(-0.3, 0.3),
    st.floats(-180, 180),
)  # fmt: skip
def test_each_beam_is_as_long_as_it_was_measured(x, y, angle, mount, turned):
    taken = scan(mount_x=mount, mount_y=-mount, mount_angle=turned)
    beams = beams_of(taken, Pose(x, y, angle))
    lengths = np.hypot(beams.ends[:, 0] - beams.x, beams.ends[:, 1] - beams.y)
    assert lengths == pytest.approx(taken.ranges)
    assert np.hypot(beams.x - x, beams.y - y) == pytest.approx(np.hypot(mount, mount), abs=1e-9)


def test_the_scan_of_the_picture_is_taken():
    scans, picture = ScanBuffer(), Picture((discs((0.0, 0.0), (3.0, 0.0)),))
    for time in (0.1, 0.2, 0.3):
        scans.add(scan(ranges=(10 * time,), time=time))
    scans.add(Sightings("b1", (), 0.2))
    (beams,) = scans.beams(picture, 0.2)
    assert beams.ends[0, 0] == pytest.approx(2.0)
    (beams,) = scans.beams(picture, 9.0)
    assert beams.ends[0, 0] == pytest.approx(3.0)
    (beams,) = scans.beams(picture, 0.0)  # a sensor with another clock: its newest scan
    assert beams.ends[0, 0] == pytest.approx(3.0)
    scans.add(scan("nobody"))
    assert len(scans.beams(picture, 0.2)) == 1
    scans.add(scan("b2"))
    assert [beam.x for beam in scans.beams(picture, 0.2)] == [0.0, 3.0]
