"""Quality of service by topic: its words, what goes on the wire, and what a robot offers."""

import pytest

pytest.importorskip("rosbags")

from minerva_bus.errors import MisuseError
from minerva_services.bridges.ros2 import Ros2, Ros2Navigation, Ros2Robot, Ros2View, sensors
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros2.qos import HEARING, KEEP_ALL, Qos, announced_qos, asked_qos
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_peers import LASTING_QOS, SENSOR_QOS, LazyPublisher, Node
from tests.bridges.ros2_rig import network, scan, transforms
from tests.bridges.test_ros2_examination import ROUTER, SCAN, TF, bridged, problems, rmw
from tests.patience import eventually

WORDS = {
    "sensor_data": (Qos(reliable=False, depth=5), SENSOR_QOS),
    "default": (Qos(depth=10), "::,10:,:,:,,"),
    "sensor_data reliable": (Qos(depth=5), "::,5:,:,:,,"),
    "reliable transient_local 10": (Qos(lasting=True, depth=10), ":1:,10:,:,:,,"),
    "transient_local": (Qos(lasting=True), LASTING_QOS),
    "best_effort": (HEARING, "2::,10:,:,:,,"),
    "42": (Qos(reliable=False, depth=42), "2::,:,:,:,,"),
    # [jazzy liveliness_utils.cpp 193, 307-314]
    "sensor_data keep_all": (Qos(reliable=False, depth=KEEP_ALL), "2::2,:,:,:,,"),
}


@pytest.mark.parametrize("text", WORDS)
def test_words_of_ros(text):
    assert (asked_qos("qos", text, HEARING), asked_qos("qos", text, HEARING).token) == WORDS[text]


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("", "expected a profile"), ("  ", "expected"), ("best effort", "best_effort"),
        ("transientlocal", "'transient_local'"), ("reliable best_effort", "expected"),
        ("10 20", "expected"), ("keep_all 5", "expected"), ("keepall", "'keep_all'"), ("0", "expected"), ("-1", "expected"), ("1e3", "expected"),
        ("9" * 5000, "expected"), ("٣", "expected"), ("reliable sensor_data", "expected"),
        ("SENSOR_DATA", "expected"), (5, "expected"), ({"depth": 5}, "expected"),
    ],
)  # fmt: skip
def test_other_words_are_refused_with_what_is_expected(text, hint):
    with pytest.raises(MisuseError, match=hint) as raised:
        Ros2(ROUTER, qos={"scan": text})
    assert len(str(raised.value)) < 350


def test_who_keeps_all_is_shown():
    for text, layout in ((":1:2,:,:,:,,", "rmw_zenoh"), (":1:1:1,10", "dds")):
        assert str(announced_qos(text, layout)) == "transient_local keep_all"
    for text, layout in ((":1:1,5:,:,:,,", "rmw_zenoh"), (":1:1:0,10", "dds")):
        assert str(announced_qos(text, layout)) == "transient_local"


@pytest.mark.parametrize("service", [Ros2, Ros2Robot, Ros2View, Ros2Navigation])
def test_the_table_names_topics_that_are_used(service):
    for given, hint in (({"skan": "default"}, "'skan'"), ("sensor_data", "table"), ([], "table")):
        with pytest.raises(MisuseError, match=hint):
            service(ROUTER, qos=given)


@pytest.mark.parametrize("announce", [rmw, bridged])
def test_a_robot_that_offers_less_is_reported(announce):
    layout = {"layout": "rmw_zenoh" if announce is rmw else "dds", "odometry": "", "battery": ""}
    weak = SENSOR_QOS if announce is rmw else ":0:0:1,5"
    there = [announce(*SCAN, weak), announce(*TF[:3], TF[3] if announce is rmw else ":1:1:1,1")]
    assert problems(Ros2(ROUTER, **layout), *there) == {}
    assert problems(Ros2(ROUTER, qos={"scan": "sensor_data"}, **layout), *there) == {}
    reliable = problems(Ros2(ROUTER, qos={"scan": "reliable"}, **layout), *there)
    assert "published as best_effort, not reliable" in reliable["scan"]
    assert "or add best_effort to qos.scan" in reliable["scan"]
    lasting = problems(Ros2(ROUTER, qos={"scan": "transient_local"}, **layout), *there)
    assert "add volatile to qos.scan" in lasting["scan"]
    moving = [*there, announce("MP", "/tf", types.TRANSFORMS)]
    asked = problems(Ros2(ROUTER, qos={"tf": "transient_local"}, **layout), *moving)
    assert "add volatile to qos.tf" in asked["tf"]


def test_transforms_that_a_robot_repeats_need_not_last():
    there = [rmw(*SCAN), rmw("MP", "/tf_static", types.TRANSFORMS, SENSOR_QOS)]
    robot = {"odometry": "", "battery": ""}
    assert "add volatile to qos.tf_static" in problems(Ros2(ROUTER, **robot), *there)["tf"]
    asked = {"tf_static": "sensor_data"}
    assert problems(Ros2(ROUTER, qos=asked, **robot), *there) == {}
    assert Ros2Robot(ROUTER, qos=asked).uses[0].qos == Qos(reliable=False, depth=5)


def test_a_robot_that_asks_for_more_than_it_is_sent_is_reported():
    there = [
        rmw(*TF),
        rmw(*SCAN),
        rmw("MP", "/odom", types.ODOMETRY),
        rmw("MS", "/cmd_vel", types.TWIST),
    ]
    robot = Ros2Robot(ROUTER, detections="", qos={"cmd_vel": "best_effort 1"})
    assert "add reliable to qos.cmd_vel" in problems(robot, *there)["cmd_vel"]
    assert problems(Ros2Robot(ROUTER, detections=""), *there) == {}


@pytest.mark.parametrize("announce", [rmw, bridged])
def test_two_sensors_on_one_topic_are_reported(announce):
    layout = {"layout": "rmw_zenoh" if announce is rmw else "dds", "odometry": "", "battery": ""}
    tf = announce(*TF[:3], TF[3] if announce is rmw else ":1:1:1,1")
    both = [announce(*SCAN), announce(*SCAN).replace("robot", "lidar2").replace("abc", "abd")]
    said = problems(Ros2(ROUTER, **layout), tf, tf.replace("abc", "abd"), *both)
    names = "/lidar2, /robot" if announce is rmw else "abc, abd"
    assert said["scan"].startswith(f"/scan is published by {names}; give each a topic or namespace")
    assert len(said) == 1


def test_a_driver_counts_and_serves_the_subscription_of_its_quality():
    with network() as (endpoint, _), Node(endpoint) as robot:
        tf = robot.publisher("/tf_static", types.TRANSFORMS, LASTING_QOS)
        lidar = LazyPublisher(robot, "scan", types.LASER_SCAN)
        with RunningBridge(Ros2(endpoint, qos={"scan": "sensor_data"})) as running:

            def arrives():
                tf(transforms(0.0))
                lidar.put(scan())
                return running.published

            running.wait_for(arrives, "a scan")


def test_what_waits_without_a_limit_is_bounded_by_its_memory(monkeypatch):
    monkeypatch.setattr(sensors, "_MAX_BYTES", 250_000)
    for depth, kept in ((KEEP_ALL, 1000), (0, 100), (7, 7)):
        listening = sensors._Listening(None, Ros2(ROUTER))
        receive = listening.receiver("js", depth)
        for _ in range(2000):
            receive(bytes(50))
        assert len(listening.taken(0)) == kept


def test_depth_is_how_many_last_messages_a_late_subscriber_receives():
    with network() as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint), "robot")
        publisher = session.publisher("limit", types.TWIST, Qos(lasting=True, depth=3))
        for speed in (1.0, 2.0, 3.0, 4.0):
            publisher.put(messages().twist(speed, 0.0))
        heard = {2: [], 3: []}
        for depth, data in heard.items():
            session.subscribe("limit", types.TWIST, data.append, Qos(lasting=True, depth=depth))
        eventually(lambda: all(len(heard[n]) == n for n in heard), "the last messages")
        session.close()
    speeds = [[messages().decode(types.TWIST, each).linear.x for each in heard[n]] for n in heard]
    assert speeds == [[3.0, 4.0], [2.0, 3.0, 4.0]]
