"""What is on a robot's network, and how it differs from what a service expects."""

import json
import math
import socket
import threading

import pytest

pytest.importorskip("rosbags")

from minerva_bus import check
from minerva_bus.errors import MinervaError
from minerva_services.bridges.ros2 import Ros2, Ros2Robot, Ros2View
from minerva_services.bridges.ros2.examination import examine
from minerva_services.bridges.ros2.graph import RosGraph
from minerva_services.bridges.ros2.uses import mismatches
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_peers import DEFAULT_QOS, LASTING_QOS, LyricalPublisher, Node, dds
from tests.bridges.ros2_rig import network, scan, transforms
from tests.patience import eventually

ROUTER = "tcp/h:7447"
TF = ("MP", "/tf_static", types.TRANSFORMS, LASTING_QOS)
SCAN = ("MP", "/scan", types.LASER_SCAN)
ODOM = ("MP", "/odom", types.ODOMETRY)


def rmw(kind, topic, message, qos=DEFAULT_QOS, domain=0, node="robot"):
    about = f"{topic.replace('/', '%')}/{dds(message)}/RIHS01_0/{qos}"
    return f"@ros2_lv/{domain}/abc/0/1/{kind}/%/%/{node}/{about}"


def bridged(kind, topic, message, qos=":1:0:1,10"):
    """[zenoh-plugin-ros2dds, liveliness_mgt.rs 26-57, 203-246]"""
    escaped = [part.replace("/", "§") for part in (topic.strip("/"), message)]
    return f"@/abc/@ros2_lv/{kind}/{'/'.join(escaped)}/{qos}"


def problems(service, *tokens):
    graph = RosGraph()
    for token in tokens:
        graph.update(token, is_there=True)
    return dict(mismatches(graph, service.network, service.uses))


def test_a_robot_that_has_everything():
    robot = Ros2(ROUTER, battery="")
    assert problems(robot, *(rmw(*end) for end in (TF, SCAN, ODOM))) == {}
    dds_robot = Ros2(ROUTER, layout="dds", namespace="bot1", battery="", odometry="")
    tf = bridged("MP", "/bot1/tf_static", types.TRANSFORMS, ":1:1:1,10")
    assert problems(dds_robot, tf, bridged("MP", "/bot1/scan", types.LASER_SCAN)) == {}


CASES = {
    "another name": ({}, [rmw("MP", "/front/scan", types.LASER_SCAN)], "scan", 'set scan = "/front/scan"'),
    "a namespace": ({}, [rmw("MP", "/bot1/scan", types.LASER_SCAN), rmw("MP", "/bot1/odom", types.ODOMETRY)], "scan", 'set namespace = "/bot1"'),
    "another type": ({}, [rmw("MP", "/scan", types.IMAGE)], "scan", f"/scan is of {types.IMAGE}, not of"),
    "images of another type": (
        {"image": "cam"}, [rmw("MP", "/cam", types.COMPRESSED), rmw("MP", "/depth", types.IMAGE)], "image",
        f'/cam is of {types.COMPRESSED}, not of {types.IMAGE}; set compressed = "cam" instead of image',
    ),
    "nothing of this type": ({}, [rmw(*ODOM)], "scan", 'start its node, or set scan = ""'),
    "another domain": ({}, [rmw(*SCAN, domain=7)], "domain", "set domain = 7"),
    "a bridge for dds": ({}, [bridged(*SCAN)], "layout", 'set layout = "dds"'),
    "no bridge": ({"layout": "dds"}, [rmw(*SCAN)], "layout", 'set layout = "rmw_zenoh"'),
    "only nodes of ours": ({}, [rmw(*SCAN, node="minerva_view_1")], "router", "start its nodes with RMW_"),
    "nobody": ({"layout": "dds"}, [], "router", "start a zenoh-bridge-ros2dds"),
    "no transforms": ({}, [rmw(*SCAN)], "tf", 'set mount = "x, y, degrees"'),
    "transforms elsewhere": (
        {"namespace": "bot1"}, [rmw("MP", "/bot1/tf_static", types.TRANSFORMS)], "tf", 'set tf = "/bot1/tf"',
    ),
    "a map of later": ({"map": "map"}, [rmw("MP", "/map", types.GRID)], "map", "make its publisher transient_local"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("options", "tokens", "option", "remedy"), CASES.values(), ids=CASES.keys()
)
def test_what_differs_has_a_remedy(options, tokens, option, remedy):
    assert remedy in problems(Ros2(ROUTER, **options), *tokens)[option]


def test_velocities_of_the_other_kind():
    stamped = problems(Ros2Robot(ROUTER), rmw("MS", "/cmd_vel", types.TWIST_STAMPED))
    assert "set stamped = true" in stamped["cmd_vel"]
    plain = problems(Ros2Robot(ROUTER, stamped=True), rmw("MS", "/cmd_vel", types.TWIST))
    assert "set stamped = false" in plain["cmd_vel"]


def test_nodes_that_share_a_topic_are_named():
    robot = Ros2Robot(ROUTER, mount="0, 0, 0", odometry="", detections="")
    base = rmw("MS", "/cmd_vel", types.TWIST)
    lasers = [rmw(*SCAN, node=name) for name in ("front", "rear")]
    graph = RosGraph()
    for token in (base, *lasers, rmw("MP", "/cmd_vel", types.TWIST_STAMPED, node="teleop")):
        graph.update(token, is_there=True)
    # Also while their messages arrive.
    for heard in ((), [types.LASER_SCAN, types.TWIST]):
        shared = dict(mismatches(graph, robot.network, robot.uses, heard))
        assert shared["scan"].startswith("/scan is published by /front, /rear; give each a topic")
        assert shared["cmd_vel"].startswith("/cmd_vel is also published by /teleop, and the robot")
    assert problems(robot, base, lasers[0]) == {}


def test_a_view_needs_nobody_but_the_right_layout_and_types():
    assert problems(Ros2View(ROUTER)) == {}
    assert problems(Ros2View(ROUTER), rmw("MS", "/map", types.GRID)) == {}
    assert "domain" in problems(Ros2View(ROUTER), rmw("MS", "/map", types.GRID, domain=3))
    assert "goal" in problems(Ros2View(ROUTER), rmw("MP", "/goal_pose", types.PATH))


def world_of(folder, options):
    """A world file whose process `eye` is a bridge with these options."""
    path = folder / "w.toml"
    path.write_text(
        '[world]\nscene = "minerva_agents.robot.world:scene"\n'
        'vocabulary = "minerva_agents.robot.world:vocabulary"\n'
        f'[process.eye]\nservice = "ros2"\n{options}'
    )
    return path


UNFIT = {
    "a domain of dds": ({"layout": "dds", "domain": 7}, "domain = 7 has no effect"),
    "a namespace twice": (
        {"namespace": "bot1", "scan": "bot1/scan"}, '/bot1/bot1/scan has the namespace twice; set scan = "scan"',
    ),
    "a topic of two types": (
        {"odometry": "scan"}, f"/scan is of {types.LASER_SCAN} for scan, not of {types.ODOMETRY}; set odometry",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("options", "problem"), UNFIT.values(), ids=UNFIT.keys())
def test_check_warns_of_what_fits_no_robot(options, problem, tmp_path):
    written = "".join(f"{name} = {json.dumps(value)}\n" for name, value in options.items())
    world = world_of(tmp_path, f'router = "{ROUTER}"\n{written}')
    (warning,) = [line for line in check(world).warnings if "[process.eye]" in line]
    assert problem in warning
    # In a log, and in the examination of a network, it is the first line.
    service = Ros2(ROUTER, **options)
    (_, first), *_ = mismatches([], service.network, service.uses)
    assert first in warning


@pytest.mark.parametrize("token", ["", "@ros2_lv/0", "@/abc/@ros2_lv", "@ros2_lv/x/a/0/0/NN/%/%/n"])
def test_unknown_tokens_are_left_out(token):
    graph = RosGraph()
    graph.update(token, is_there=True)
    assert not list(graph)


def test_a_bridge_says_what_differs(capsys):
    with network() as (endpoint, _), Node(endpoint) as robot:
        robot.publisher("/front/scan", types.LASER_SCAN)
        said = []
        with RunningBridge(Ros2(endpoint, mount="0, 0, 0", odometry="", battery="")):
            eventually(
                lambda: said.append(capsys.readouterr().out) or "set scan = " in "".join(said),
                "it says so",
            )
    assert f"{endpoint}: nobody publishes /scan of {types.LASER_SCAN}" in "".join(said)


def test_a_bridge_says_that_a_topic_has_another_type_than_before(capsys):
    said = []
    with (
        network() as (endpoint, _),
        RunningBridge(Ros2(endpoint, mount="0, 0, 0", odometry="", battery="")) as running,
    ):
        with Node(endpoint) as robot:
            put = robot.publisher("/scan", types.LASER_SCAN)
            eventually(lambda: put(scan()) or running.published, "a scan")
        with Node(endpoint) as robot:
            robot.publisher("/scan", types.POINTS)
            eventually(
                lambda: said.append(capsys.readouterr().out) or "not of" in "".join(said),
                "it says so",
            )
    assert f"/scan is of {types.POINTS}, not of {types.LASER_SCAN}" in "".join(said)


def test_a_network_is_listed_with_its_distributions():
    with (
        network() as (endpoint, hub),
        Node(endpoint, "old", humble=True) as old,
        Node(endpoint, "new", namespace="/bot1") as new,
    ):
        old.publisher("/scan", types.LASER_SCAN)
        LyricalPublisher(new, "camera", types.IMAGE)
        eventually(lambda: len(list(hub.liveliness().get("@ros2_lv/**"))) == 4, "all tokens")
        found = {what: note for what, good, note in examine(endpoint) if good}
    assert found == {
        "layout rmw_zenoh, domain 0": "Humble and Lyrical or later",
        "nodes": "/bot1/new, /old",
        "/bot1/camera": f"{types.IMAGE}, published by /bot1/new",
        "/scan": f"{types.LASER_SCAN}, published by /old",
    }


@pytest.mark.parametrize(
    ("topic", "notes"),
    [
        ("/scan", {
            "/scan": f"{types.LASER_SCAN}, published by /front, /rear", "range_max": "12",
            "ranges": "[1, 2, nan, 3 ... (5 in all)]",
            "header": "stamp (sec 1, nanosec 500000000), frame_id 'laser'",
        }),
        ("/tf_static", {"rate": "one message"}),
        ("/scam", {"/scam": "nobody publishes it; did you mean '/scan'?"}),
        ("/odom", {"rate": "no message in 0.2 s; does its node send?"}),
        ("/own", {"/own": "the type my_msgs/msg/Own is not known here, so it cannot be read"}),
    ],
)  # fmt: skip
def test_a_topic_is_shown_with_its_rate_and_its_last_message(topic, notes, monkeypatch):
    monkeypatch.setattr("minerva_services.bridges.ros2.examination._LISTEN_SECONDS", 0.2)
    over = threading.Event()
    with (
        network() as (endpoint, hub),
        Node(endpoint, "front") as node,
        Node(endpoint, "rear") as other,
    ):
        put = node.publisher("/scan", types.LASER_SCAN)
        other.publisher("/scan", types.LASER_SCAN)
        other.publisher("/odom", types.ODOMETRY)
        node.publisher("/tf_static", types.TRANSFORMS, LASTING_QOS)(transforms(0.0))
        own = hub.liveliness().declare_token(rmw("MP", "/own", "my_msgs/msg/Own"))
        eventually(lambda: len(list(hub.liveliness().get("@ros2_lv/**"))) == 7, "all tokens")
        sends = threading.Thread(
            daemon=True,
            target=lambda: [
                put(scan(ranges=[1, 2, math.nan, 3, 4]))
                for _ in iter(lambda: over.wait(0.01), True)
            ],
        )
        sends.start()
        listed = list(examine(f"{endpoint}{topic}"))
        over.set()
        sends.join()
        own.undeclare()
    shown = {what: note for what, _, note in listed}
    assert shown.items() >= notes.items()
    assert all(good for _, good, _ in listed) == (topic in ("/scan", "/tf_static"))
    if topic == "/scan":
        assert shown["rate"].endswith(" Hz")
        assert float(shown["age"].split()[0]) > 1e9


def test_the_services_of_a_world_are_compared_with_their_networks(tmp_path):
    with network() as (endpoint, hub), Node(endpoint) as robot:
        robot.publisher("/front/scan", types.LASER_SCAN)
        eventually(lambda: len(list(hub.liveliness().get("@ros2_lv/**"))) == 2, "its tokens")
        options = 'mount = "0, 0, 0"\nodometry = ""\nbattery = ""\n'
        world = world_of(tmp_path, f'router = "{endpoint}"\n{options}')
        assert [(what, good) for what, good, _ in examine(str(world))] == [("eye: scan", False)]
        world.write_text(world.read_text() + 'scan = "front/scan"\n')
        ((_, good, note),) = examine(str(world))
    assert good
    assert note.endswith("Jazzy or later")


def test_sources_that_cannot_be_examined():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        for address, why in (
            ("127.0.0.1:1", "nothing listens at port 1 of 127.0.0.1; start"),
            (f"127.0.0.1:{port}", "what listens there is no Zenoh router; check"),
            ("no..host:1", "there is no host no..host; check"),
            ("127.0.0.1", "has no port; expected HOST:7447"),
        ):
            ((_, good, note),) = examine(f"tcp/{address}")
            assert not good
            assert f"no ROS 2 network answers at tcp/{address}: " in note
            assert why in note
    for source, why in (
        ("nowhere", "there is no world"),
        ("192.168.1.20:7447", "is not an endpoint; expected tcp/HOST:7447"),
        ("tcp://192.168.1.20:7447", "is not an endpoint; expected tcp/HOST:7447"),
    ):
        with pytest.raises(MinervaError, match=why):
            list(examine(source))


def test_the_world_file_of_the_folder_counts_before_an_installed_world(tmp_path, monkeypatch):
    world_of(tmp_path, 'router = "tcp/127.0.0.1:1"\n').rename(tmp_path / "robot.toml")
    monkeypatch.chdir(tmp_path)
    assert {what.partition(":")[0] for what, _, _ in examine("robot")} == {"eye"}
