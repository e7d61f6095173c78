"""The simulated laser and that of the simulated ROS 2 robot agree, also along edges of cells."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

pytest.importorskip("ruamel.yaml")

from minerva_agents.robot.grid import clearance
from minerva_services.physics.arena import Arena
from minerva_services.physics.walls import wall_segments

sys.path.insert(0, str(Path(__file__).parents[2] / "worlds" / "minerva_worlds" / "ros2"))
from floor import Floor

SIDE, BEAMS, RANGE = 0.05, 90, 8.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("floors")


def floor_of(folder, walls):
    image = np.where(walls.T[::-1], 0, 254).astype(np.uint8)
    (folder / "floor.pgm").write_bytes(b"P5\n%d %d\n255\n" % walls.shape + image.tobytes())
    keys = {"image": "floor.pgm", "resolution": SIDE, "origin": [0, 0, 0], "negate": 0}
    path = folder / "floor.yaml"
    path.write_text(json.dumps({**keys, "occupied_thresh": 0.65, "free_thresh": 0.196}))
    return Floor(path)


@example(seed=1541818, part=0.0, heading=0.0, rounding=0.0)
@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1), part=st.sampled_from((0.0, 0.5)),
    heading=st.sampled_from((0.0, 45.0, 90.0, 4.0, 30.0)), rounding=st.floats(-1e-13, 1e-13),
)  # fmt: skip
def test_two_lasers_agree_at_poses_along_edges(folder, seed, part, heading, rounding):
    random = np.random.default_rng(seed)
    walls = random.random((60, 50)) < 0.02
    walls[[0, -1]] = walls[:, [0, -1]] = True
    places = np.argwhere(clearance(walls) >= 4.0)
    cell = places[random.integers(len(places))]
    x, y = (float(index + part) * SIDE for index in cell)
    arena = Arena()
    arena.add_walls(wall_segments(np.where(walls, 100, 0), SIDE), solid_behind=True)
    arena.add_body("r", x, y, heading, 0.05)
    simulated = arena.scan("r", BEAMS, -180.0, 4.0, RANGE)
    angles = math.radians(heading) + np.radians(np.arange(BEAMS) * 4.0 - 180.0) + rounding
    ranges = floor_of(folder, walls).ranges(x + rounding, y - rounding, angles, RANGE)
    # Rounding moves a beam's end by far less than a cell, and no beam passes a wall that it meets.
    assert np.minimum(ranges, RANGE) == pytest.approx(simulated, abs=1e-9)
