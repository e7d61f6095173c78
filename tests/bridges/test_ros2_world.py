"""The robot's world with a ROS 2 robot instead of physics: it drives, stops and resumes."""

import math
import os
import shutil
import signal
from pathlib import Path

import pytest

pytest.importorskip("rosbags")

from tests.bridges.ros2_rig import ROBOT, RosRobot, free_endpoint, hall
from tests.runtime.running import World, eventually

FILE = ROBOT.with_name("ros_world.toml")
DOOR = (3.2, 1.5)


def world(folder, endpoint, *words):
    path = folder / f"ros-{os.getpid()}-{folder.name[-20:]}.toml"
    shutil.copy(FILE, path)
    options = ["--map", folder / "hall.yaml", "--objective", "door", "--router", endpoint]
    return World(path, *options, *words)


def stands(robot):
    """Whether the robot has not moved in the last 0.5 s."""
    places = robot.lines[-6:]
    return len(places) == 6 and len(set(places)) == 1


def has_left(robot, start, far):
    return math.dist(robot.place[:2], start[:2]) > far


@pytest.fixture
def floor(tmp_path):
    return hall(tmp_path, markers={"door": list(DOOR)})


def test_it_finds_its_objective_after_all_that_goes_wrong(tmp_path, floor):
    endpoint = free_endpoint()
    with (
        RosRobot(floor, endpoint) as robot,
        world(tmp_path, endpoint, "--speed", "0.25", "--json") as run,
    ):
        eventually(lambda: has_left(robot, (1.0, 1.5), 0.2), "it drives")
        pids = run.runs("robot", "gLaser")
        os.kill(pids["robot"], signal.SIGKILL)
        # Until then it may drive by its last command.
        run.says("robot", "connected", times=2)
        before = robot.place
        eventually(lambda: has_left(robot, before, 0.2), "it drives again")
        robot.process.send_signal(signal.SIGSTOP)
        run.says("no /odom")
        robot.process.send_signal(signal.SIGCONT)
        run.says("has returned")
        summary = run.summary()
        assert math.dist(robot.place[:2], DOOR) < 0.6
    assert summary["frames"] > 20
    assert str(summary).count("collisions") == 1


def test_it_stops_when_the_world_pauses_and_when_it_dies(tmp_path, floor):
    endpoint = free_endpoint()
    with RosRobot(floor, endpoint) as robot, world(tmp_path, endpoint, "--speed", "0.15") as run:
        eventually(lambda: has_left(robot, (1.0, 1.5), 0.1), "it drives")
        with run.client() as asked:
            asked.operator.pause()
            eventually(lambda: stands(robot), "it stops")
            before = robot.place
            asked.operator.resume()
            eventually(lambda: has_left(robot, before, 0.1), "it goes on")
        run.runs("robot")
        run.kill()
        run.gone()
        eventually(lambda: stands(robot), "it stops")
        assert not has_left(robot, before, 1.0)


def test_a_wall_that_the_robot_alone_knows_is_a_collision(tmp_path, floor):
    """The laser is above a low bar that blocks the body."""
    low = Path(tmp_path / "low")
    low.mkdir()
    hall(low, width=2.4, markers={"door": list(DOOR)})
    endpoint = free_endpoint()
    with (
        RosRobot(low / "hall.yaml", endpoint, "--range", "0.15") as robot,
        world(tmp_path, endpoint, "--speed", "0.3", "--set", "robot.patience=0.5") as run,
    ):
        run.runs("robot")

        def collided():
            figures = run.members().get("robot", {}).get("figures", {})
            return figures.get("collisions", 0) > 0

        eventually(collided, f"it collides, at {robot.place}")
