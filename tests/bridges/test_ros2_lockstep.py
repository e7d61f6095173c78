"""A ROS 2 robot in lockstep with the world makes the same decisions as the simulated one."""

import json
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from minerva_agents.robot.vocabulary import eCamera
from minerva_bus import Frame, Tick, Vocabulary, WorldInfo
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import agents
from minerva_bus.launch.installed import find_world
from minerva_bus.log.record import Record
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Sighting, Sightings
from minerva_services.bridges.ros2.driver import MotorLimits
from minerva_services.bridges.ros2.mobile_base import NANOSECONDS, is_rounding, phases
from minerva_services.physics.body import DriveCommand
from minerva_services.sensors.camera import Camera
from tests.bridges.ros2_rig import RosRobot, free_endpoint, hall, house
from tests.runtime.running import here

EXACT = ("--clock", "--laser-yaw", "0", "--acceleration", "inf", "--turn-acceleration", "inf")
DEVICE = """[process.physics]
service = "ros2_robot"
router = "{endpoint}"
decide = "eDecide"
clock = "clock"
speed = 1.0
turn = 180.0
near = 0.001
aligned = 0.1

"""
LIMITS = MotorLimits(1.0, 180.0, 1.0, 360.0)


def with_ros(endpoint):
    """The text of the robot's world with its physics and decisions replaced by a ROS 2 device."""
    decide = '[process.gDecide]\nservice = "each"\nevent = "eDecide"\n'
    text = find_world("robot").read_text()
    assert decide in text
    text = text.replace(decide, "")
    begin, end = text.index("[process.physics]"), text.index("[process.gLaser]")
    return text[:begin] + DEVICE.format(endpoint=endpoint) + text[end:]


def decisions(path):
    """Actions, plans and estimated poses of the robot by frame."""
    keys = ("action", "row", "column", "angle", "plan_rows", "plan_columns", "objective")
    made = []
    with Record(path) as record:
        for _, scene in record.strings():
            state = next(agent for agent in agents(scene) if agent.id == "r1").state
            made.append({key: str(state[key]) for key in keys})
    return made


def run(folder, world, plan, objective):
    """Summary and decisions of a run."""
    path = folder / f"{Path(world).stem}.mcap"
    words = ["--map", plan, "--objective", objective, "--in-process", "--record", path]
    done = here(folder, "run", world, *words, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), decisions(path)


@pytest.mark.parametrize(("build", "objective"), [(hall, "door"), (house, "desk")])
def test_it_decides_as_the_simulated_robot_frame_by_frame(tmp_path, build, objective):
    plan, endpoint = build(tmp_path), free_endpoint()
    simulated, wanted = run(tmp_path, "robot", plan, objective)
    world = tmp_path / "ros.toml"
    world.write_text(with_ros(endpoint))
    with RosRobot(plan, endpoint, *EXACT):
        ros, made = run(tmp_path, world, plan, objective)
    for number, (message, other) in enumerate(zip(made, wanted, strict=False)):
        assert message == other, f"frame {number}"
    assert len(made) == len(wanted) > 20
    assert ros["digest"] == simulated["digest"]


@pytest.mark.parametrize(
    ("command", "lasts"),
    [((0.0, 0.0), 0.1), ((0.0, 0.08), 0.1), ((9.0, 0.02), 0.1), ((90.0, 0.1), 0.6)],
)
def test_a_command_in_phases_is_whole_and_as_fast_as_allowed(command, lasts):
    turned = driven = seconds = 0.0
    for velocity, nanoseconds in phases(DriveCommand(*command), 0.1, LIMITS):
        turned += velocity.turn * nanoseconds / NANOSECONDS
        driven += velocity.speed * nanoseconds / NANOSECONDS
        seconds += nanoseconds / NANOSECONDS
        assert abs(velocity.turn) <= LIMITS.turn
        assert abs(velocity.speed) <= LIMITS.speed
    assert (turned, driven) == pytest.approx(command, abs=1e-12)
    assert seconds == pytest.approx(lasts, abs=1e-8)


@pytest.mark.parametrize(
    ("resolution", "position"), [(0.0, (1.23456, -9.87654)), (0.1, (1.2, -9.9))]
)
def test_a_camera_has_the_configured_resolution(resolution, position):
    camera = Camera(resolution=resolution)
    camera.joined(WorldInfo("w", Vocabulary.of(eCamera), 0, 0.1))
    seen = Sightings("r1", (Sighting("door", 1.23456, -9.87654),), 0.0)
    (event,) = camera.generate(Tick(Frame(0), "camera", readings=(seen,)))
    assert (event.dist, event.angle) == pytest.approx(position, abs=1e-12)


@pytest.mark.parametrize("resolution", [-1.0, float("inf"), float("nan")])
def test_a_wrong_resolution(resolution):
    with pytest.raises(MisuseError, match=r"resolution is .*; expected a number from 0"):
        Camera(resolution=resolution)


def test_a_micrometre_is_rounding():
    assert is_rounding(Pose(5e-7, 5e-7, 5e-7))
    assert not is_rounding(Pose(2e-6, 0.0, 0.0))
    assert not is_rounding(Pose(0.0, 0.0, 2e-6))
