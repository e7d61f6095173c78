"""What the benchmark of exploration says of a run is what the robot itself says."""

import math

import pytest

from benchmarks.exploration import SPEED, Task, _options
from benchmarks.exploring.driving import Drive, Floor, Noise
from benchmarks.exploring.floors import Named, floor_of
from minerva_agents.robot.occupancy import Marker
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import scene
from minerva_bus.grammar.scene import agents

MARKER = Marker("A", 2.0, 2.0)


@pytest.fixture
def drive(tmp_path):
    """A robot in a hall of 4 m that looks for a marker which hangs nowhere."""
    floor = floor_of("hall", 4.0, 1)
    named = Named("hall-4-1", floor, held_out=False)
    task = Task(named, (1.0, 1.0, 0.0), MARKER, math.nan, Noise(), "astar")
    (node,) = agents(scene(_options(task, tmp_path)))
    robot = ARobot.thaw(node)
    robot.speed = SPEED
    robot.seek(MARKER.name)
    return robot, Drive(Floor(floor), (), robot, Noise(), 1)


def test_a_robot_that_gives_up_has_reported_it(drive):
    robot, run = drive[0], drive[1].go(6000)
    assert (run.reached, run.reported, robot.objective) == (False, True, "")
    assert run.frames < 6000


def test_a_robot_that_searches_again_has_not_reported_yet(drive):
    robot, run = drive[0], drive[1]
    robot.searches = 1
    assert not run.go(10).reported
