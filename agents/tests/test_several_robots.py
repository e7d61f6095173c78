"""Several robots look for one marker: all arrive, and none collides or gives up."""

import numpy as np
import pytest
from floor_plans import FloorPlan, save_map
from floor_simulator import Floor

from minerva_agents.robot.world import RobotOptions
from minerva_bus import World, run


def search(path, robots):
    world = World.load("robot", map=str(path), robots=robots, objective="bed", parcels="")
    return run(world, until="eReached", frames=3000)


def check(result):
    assert result.reached
    assert "eUnreachable" not in result.events
    assert result.figures["collisions"] == 0


@pytest.mark.parametrize("seed", range(12))
def test_no_robot_starts_in_a_wall(seed, tmp_path):
    chosen = RobotOptions(map=str(FloorPlan(seed).save(tmp_path)), robots=4)
    floor = Floor(chosen.floor)
    assert len(chosen.starts) == 4
    assert all(floor.gap(x, y) >= chosen.radius for x, y, _ in chosen.starts)


def test_a_robot_in_front_of_a_marker_does_not_hide_it(tmp_path):
    """The door and the corner of the marker are on one diagonal, and the first robot, too."""
    walls = np.zeros((160, 120), np.bool_)
    walls[:4] = walls[-4:] = walls[:, :4] = walls[:, -4:] = True
    walls[80:83, :18] = walls[80:83, 38:] = True
    check(search(save_map(tmp_path, walls, [7.2, 5.2]), 2))


@pytest.mark.parametrize(("seed", "robots"), [(2, 3), (8, 2)])
def test_all_robots_arrive(seed, robots, tmp_path):
    check(search(FloorPlan(seed).save(tmp_path), robots))


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("robots", [2, 3])
@pytest.mark.parametrize("seed", range(24))
def test_all_robots_arrive_on_each_plan(seed, robots, tmp_path):
    check(search(FloorPlan(seed).save(tmp_path), robots))
