"""The robot finds markers by laser and camera, frame by frame, without bus or physics.

Seeds and floors are fixed, so every run is identical. Each kind of floor and start has its shortest
run here, and its longer runs on demand.
"""

from pathlib import Path

import numpy as np
import pytest
from floor_simulator import Simulator

from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import RobotOptions, scene
from minerva_bus import Scene
from minerva_bus.grammar.scene import agents

ROS_MAPS = Path(__file__).parents[3] / "shared" / "data" / "ros_maps"
RADIUS = 0.18


def slow(*values):
    """A case that runs on demand."""
    return pytest.param(*values, marks=pytest.mark.slow)


def simulator(options, objective="", seed=0, start=(0.0, 0.0, 0.0)):
    """A single robot, displaced from its start by the given rows, columns and degrees."""
    options = {"parcels": "", **options}
    chosen = RobotOptions.read(options)
    string = moved(scene(options), *start)
    return Simulator(chosen.floor, chosen.places, string, objective or chosen.goal, seed=seed)


def moved(string, down, across, turn):
    (node,) = agents(string)
    robot = ARobot.thaw(node)
    robot.row += down
    robot.column += across
    robot.angle += turn
    return Scene(string.nodes[:-1]) + robot.string


def test_astar_finds_the_kitchen():
    run = simulator({}).go(600)
    assert run.reached
    assert run.frames < 500
    assert run.metres < 35
    assert run.least_gap > RADIUS


@pytest.mark.parametrize(("down", "across", "turn"), [slow(-0.3, 0.2, 3.0), (0.1, -0.3, -2.0)])
def test_from_a_slightly_different_start_it_is_found_too(down, across, turn):
    """A few centimetres may change the order of the rooms, and so the length of the search."""
    run = simulator({}, start=(down, across, turn)).go(1200)
    assert run.reached
    assert run.metres < 80
    assert run.least_gap > RADIUS


@pytest.mark.parametrize("objective", ["office", "store", "meeting"])
def test_astar_finds_other_rooms(objective):
    run = simulator({}, objective).go(600)
    assert run.reached
    assert run.least_gap > RADIUS


@pytest.mark.parametrize(
    ("name", "objective", "frames"),
    [
        ("turtlebot3/map.yaml", "A", 400),
        slow("turtlebot3/map.yaml", "C", 400),
        slow("depot.yaml", "D", 800),
        ("depot.yaml", "F", 800),
    ],
)
def test_astar_finds_its_way_on_maps_of_real_floors(name, objective, frames):
    if not (ROS_MAPS / name).is_file():
        pytest.skip("the ROS maps are not here")
    run = simulator({"map": str(ROS_MAPS / name)}, objective).go(frames)
    assert run.reached
    assert run.least_gap > RADIUS


@pytest.mark.parametrize("start", [slow("1.5, 1.5, 0"), slow("10, 1.5, 90"), "1.5, 10.5, 180"])
def test_astar_crosses_a_hall_that_is_wider_than_its_laser_reaches(start, tmp_path):
    """Most beams have no hit; they still show which ground before them is free."""
    picture = np.zeros((420, 420), np.uint8)
    picture[10:-10, 10:-10] = 254
    (tmp_path / "hall.pgm").write_bytes(b"P5 420 420 255\n" + picture.tobytes())
    options = {"map": str(tmp_path / "hall.pgm"), "start": start, "markers": {"A": [15.5, 10.5]}}
    run = simulator(options).go(900)
    assert run.reached
    assert run.metres < 45
    assert run.least_gap > RADIUS


def test_random_finds_a_marker_in_the_next_room():
    run = simulator({"planner": "random"}, "office", seed=3).go(1000)
    assert run.reached
    assert run.least_gap > RADIUS


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", range(3))
def test_random_finds_the_kitchen_given_time(seed):
    run = simulator({"planner": "random"}, seed=seed).go(20_000)
    assert run.reached
    assert run.least_gap > RADIUS


@pytest.mark.parametrize("planner", ["astar", "random"])
def test_the_same_run_is_repeatable(planner):
    first, other = (simulator({"planner": planner}, seed=3) for _ in range(2))
    first.go(60)
    other.go(60)
    assert first.scene == other.scene
    assert first.run.poses == other.run.poses


def test_any_frame_is_a_place_to_go_on_from():
    """The string contains the robot's entire memory and may be converted to text and back."""
    from minerva_agents.robot.world import vocabulary

    first, other = simulator({}), simulator({})
    first.go(80)
    for _ in range(8):
        other.go(other.run.frames + 10)
        other.scene = vocabulary.read(str(other.scene))
    assert first.scene == other.scene


def test_the_believed_pose_is_the_true_one():
    run = simulator({})
    run.go(100)
    (node,) = run.scene.nodes[-1:]
    state = node.state
    believed = state["row"], state["column"], state["angle"]
    assert believed == (run.pose.row, run.pose.column, run.pose.angle)
