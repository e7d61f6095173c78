"""Several robots in one building."""

import pytest
from floor_plans import FloorPlan
from floor_simulator import Floor

from minerva_agents.robot.options import RobotOptions


@pytest.mark.parametrize("seed", range(12))
def test_no_robot_starts_in_a_wall(seed, tmp_path):
    chosen = RobotOptions(map=str(FloorPlan(seed).save(tmp_path)), robots=4)
    floor = Floor(chosen.floor)
    assert len(chosen.starts) == 4
    assert all(floor.gap(x, y) >= chosen.radius for x, y, _ in chosen.starts)
