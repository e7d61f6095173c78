"""Sensors of a world in space on a network of ROS 2: messages byte by byte, and their topics."""

import math
import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rapier3d", reason="needs the extra space")
pytest.importorskip("rosbags", reason="needs the extra ros")

from minerva_bodies import Ball, Box, Camera, Imu, Joint, Lidar, Matter, Rigid, euler
from minerva_bodies.cameras import Cameras
from minerva_bodies.errors import BodiesError
from minerva_bodies.robots import Rovers
from minerva_bodies.ros2 import JOINT_STATE, SpaceNode, joint_states, pictured, sensed, transforms
from minerva_bodies.sensors import SENSORS, Sensor
from minerva_bodies.service import RigidBodies
from minerva_bus import Default, EventType, Primitive, Scene, Tick, Transformation, View, Vocabulary
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.world.context import Frame
from minerva_bus.world.readings import Image, Scan
from minerva_bus.world.services import WorldInfo
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros_messages.messages import TRANSFORMS, messages
from tests.bridges.ros2_rig import network
from tests.patience import eventually

GOLDEN = tomllib.loads(Path(__file__).with_name("ros2_space.toml").read_text(encoding="utf-8"))
NOW = 1_500_000_000
ROUND = Sensor("lidar", "r-1", "PRound", Rigid(), (2, 1, 0.0, 0.0, 8.0, 0.0))
INERTIAL = Sensor("imu", "r-1", "PImu", Rigid(), ())
FORCES = {"ax": 1.0, "ay": 2.0, "az": 9.81, "wx": 0.1, "wy": 0.2, "wz": 0.3}
ECHOES = {"ranges": (1.0, 8.0), "intensities": np.array([1.0, 0.0])}
DEPTHS = Image("r-1", struct.pack("<2f", 1.5, math.inf), "32FC1", 2, 1, 1.5)
HINGES = ["arm/PHinge", "arm/PSlide"], ["revolute", "prismatic"]

PBall = Primitive("PBall", Ball(0.1, matter=Matter()))
PBlock = Primitive("PBlock", Box(0.1, 0.1, 0.1, matter=Matter(fixed=True)))
PRound = Primitive("PRound", Lidar(1, 4, reach=8))
PImu = Primitive("PImu", Imu())
PEye = Primitive("PEye", Camera(8, 6, depth=True))
PHinge = Primitive("PHinge", Joint("revolute", "base", "tip"), base=str, tip=str)
TAt = Transformation("TAt", euler("x", "y", "z"), **dict.fromkeys("xyz", Default(float, 0.0)))
eBodies = EventType("eBodies", visual=True)
eLidar, eImu = EventType("eLidar", ranges=tuple[float, ...]), EventType("eImu", az=float)
WORDS = Vocabulary.of(PBall, PBlock, PRound, PImu, PEye, PHinge, TAt, eBodies, eLidar, eImu)
INFO = WorldInfo("yard", WORDS, 7, 0.5)


@pytest.mark.parametrize(
    "made",
    [
        ("/tf", TRANSFORMS, transforms([("world", "r_1", Rigid(1, 2, 3, 0, 0, 0, 1))], NOW)),
        joint_states(*HINGES, np.array([[90.0, 0.0], [0.5, -0.25]]), NOW),
        sensed(INERTIAL, FORCES, NOW),
        sensed(ROUND, ECHOES, NOW),
        *pictured(DEPTHS, "PEye", 500.0),
    ],
    ids=lambda made: made[0],
)
def test_messages_have_the_bytes_of_another_encoder(made):
    _, kind, message = made
    same = np.frombuffer(messages().encode(kind, message), np.uint8)
    golden = np.frombuffer(bytes.fromhex(GOLDEN[kind]), np.uint8)
    assert same.tolist() == golden.tolist()


def test_a_stack_receives_what_a_world_in_space_measures():
    pytest.importorskip("moderngl", reason="needs the extra opengl")
    heard, hinge = {}, TAt(0.0, 0.0, -0.5)(PHinge("a", "b"))
    parts = {
        "a": TAt(0.0, 0.0, 1.0)(PBall() + TAt(0.0, 0.0, 0.2)(PRound() + PImu() + PEye()) + hinge),
        "b": TAt(0.0, 0.0, 0.5)(PBall()),
    }
    slots = [AgentNode("APart", name, (), (), Scene(())) for name in parts]
    scene = Scene((*TAt(2.0, 0.0, 1.2)(PBlock()).pieces, *slots))
    topics = {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/tf": TRANSFORMS,
        "/tf_static": TRANSFORMS,
        "/joint_states": JOINT_STATE,
        "/a/PRound": "sensor_msgs/msg/PointCloud2",
        "/a/PImu": "sensor_msgs/msg/Imu",
        "/a/PEye/color/image_raw": "sensor_msgs/msg/Image",
        "/a/PEye/depth/camera_info": "sensor_msgs/msg/CameraInfo",
    }

    def receive(topic, data):
        heard.setdefault(topic, []).append(messages().decode(topics[topic], data))

    with network() as (endpoint, _):
        stack = Ros2Session(Ros2Network(endpoint), "stack")
        for topic, kind in topics.items():
            stack.subscribe(topic, kind, lambda data, topic=topic: receive(topic, data))
        ros2 = {"router": endpoint}
        space = RigidBodies(gravity=0.0, pose="", lidar="eLidar", imu="eImu", ros2=ros2)
        eyes = Cameras(ros2=ros2)
        for service in (space, eyes):
            service.joined(INFO)
            eventually(lambda service=service: service.report()["ros2"] == "open", "a link")
        number = 0

        def all_heard():
            nonlocal number
            number += 1
            tick = Tick(Frame(number, 0.5, 7), "bodies")
            for service in (space, eyes):
                service.show(View(number - 1, "eBodies", scene, parts))
                list(service.generate(tick))
            return heard.keys() == topics.keys()

        eventually(all_heard, "all topics")
        for each in (space, eyes, stack):
            each.close()
    cloud = heard["/a/PRound"][-1]
    ahead = np.frombuffer(bytes(cloud.data), "<f4").reshape(4, 4)[0]
    assert ahead.tolist() == pytest.approx([1.9, 0.0, 0.0, 1.0], abs=0.01)
    fixed = {
        placed.child_frame_id: (placed.header.frame_id, placed.transform.translation.z)
        for message in heard["/tf_static"]
        for placed in message.transforms
    }
    assert fixed.keys() == {"a/PRound", "a/PImu", "a/PEye_optical"}
    assert set(fixed.values()) == {("a", 0.2)}
    assert {placed.child_frame_id for placed in heard["/tf"][-1].transforms} == {"a", "b"}
    assert heard["/joint_states"][-1].name == ["a/PHinge"]
    assert heard["/a/PEye/depth/camera_info"][-1].k[0] == pytest.approx(4 / math.tan(math.pi / 6))


def test_positions_on_the_earth_are_fixes():
    assert SENSORS.keys() == {"lidar", "imu", "distance", "gps"}, "each has a message in ros2.py"
    about = {"latitude": 50.1, "longitude": 14.4, "altitude": 200.0, "accuracy": 2.0}
    topic, kind, fix = sensed(Sensor("gps", "r-1", "PGps", Rigid(), ()), about, NOW)
    assert (topic, kind) == ("/r_1/PGps", "sensor_msgs/msg/NavSatFix")
    assert (fix.header.frame_id, fix.latitude, fix.position_covariance[0]) == (
        "r_1/PGps",
        50.1,
        4.0,
    )


def test_the_scans_of_vehicles_are_where_their_lasers_are():
    node, sent = SpaceNode("rovers", {"router": "tcp/h:1"}), []
    node.send = sent.extend
    scan = Scan("r-1", np.array([1.0, 8.0], np.float32), -45.0, 90.0, 8.0, 1.5)
    node.publish_scans([scan], 0.25)
    ((topic, kind, message),) = sent
    assert (topic, kind, message.header.frame_id) == (
        "/r_1/scan",
        "sensor_msgs/msg/LaserScan",
        "r_1/scan",
    )
    assert message.ranges.tolist() == [1.0, math.inf]
    assert node.fixed == {"r_1/scan": ("r_1", Rigid(z=0.25))}


@pytest.mark.parametrize(
    ("ros2", "text"),
    [({"domain": 3}, "ros2 lacks router"), ({"router": "tcp/h:1", "dmain": 3}, "has no 'dmain'")],
)
def test_wrong_options_are_errors_that_name_the_service(ros2, text):
    for make in (RigidBodies, Cameras, Rovers):
        with pytest.raises(BodiesError, match=text):
            make(ros2=ros2)
