"""Laser beams: from the displayed place of a robot to the points that they hit."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from window_world import discs

from minerva_agents import robot
from minerva_agents.robot.maps import load_map
from minerva_bus.api.running import run_file
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.semantics.poses import Pose
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.world.readings import Scan, Sightings
from minerva_services.geometry.picture import Picture
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


def test_beams_stay_where_they_were_measured():
    scans, here, there = ScanBuffer(), *(Picture((discs((x, 0.0)),)) for x in (0.0, 3.0))

    def ends(picture, frame):
        return [beams.ends[0, 0] for beams in scans.beams(picture, frame)]

    for frame in (1, 2, 3):
        scans.add(scan(ranges=(frame,)), frame)
    scans.add(Sightings("b1", (), 0.2), 2)
    scans.add(scan("nobody"), 2)
    assert ends(here, 0) == []  # all scans are newer
    assert ends(here, 2) == [2.0]
    assert ends(there, 3) == [6.0]
    assert ends(here, 4) == [6.0]  # the last picture, which no scan follows
    scans.add(scan(), 7)
    assert ends(here, 8) == []  # no picture of frame 7 says where its robot was
    scans.add(scan(ranges=(5.0,), time=1.7e9), -1)  # free-running, by its own clock
    assert ends(there, 9) == ends(here, 10) == [8.0]


def test_beams_of_a_run_end_at_walls(tmp_path, monkeypatch):
    pytest.importorskip("pygame", reason="pip install 'minerva-bus[sprites]'")
    from minerva_services.views.sprites.painter import SpritePainter

    sights = []
    monkeypatch.setattr(SpritePainter, "draw", lambda _, sight: sights.append(sight))
    monkeypatch.setattr(SpritePainter, "pixels", lambda _: np.zeros((9, 9, 3), np.uint8))
    views = (f"sprites:path={tmp_path}/w.png,every=1",)
    run_file(read_world_file(find_world("robot"), Overrides(frames=30, rate=0.0, views=views)), 0.0)
    floor = load_map(Path(robot.__file__).parent / "plan" / "office.yaml")
    assert len(sights) == 31
    for sight in sights[2:]:  # The laser begins in frame 2.
        (beams,) = sight.beams
        cells = [floor.cell_at(x, y) for x, y in beams.ends[beams.hits].tolist()]
        assert max(floor.room[cell] for cell in cells) <= 1, sight.subtitle
