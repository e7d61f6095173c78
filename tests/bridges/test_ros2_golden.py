"""The bridge against what the sources of each distribution put on a network, byte by byte.

The files in ros2_golden name the sources with their lines. Their gids come from the hash of
rmw_zenoh_cpp, their hashes of types from the generator of ROS 2, and their messages from the encoder of
mcap-ros2-support with the definitions of the distribution.
"""

import tomllib
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

pytest.importorskip("rosbags")

import zenoh

from minerva_services.bridges.ros2 import Ros2Navigation
from minerva_services.bridges.ros2.graph import NO_HASH, RosGraph, announced
from minerva_services.bridges.ros2.layout import Attachment, Ros2Network, gid_of
from minerva_services.bridges.ros2.navigation import NavigationGoal, navigation_messages
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros2.qos import DEFAULT, HEARING, LASTING
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from tests.bridges.ros2_rig import network
from tests.patience import eventually

GOLDEN = {
    path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
    for path in sorted((Path(__file__).parent / "ros2_golden").glob("*.toml"))
}
NODES = [name for name in GOLDEN if name != "dds"]
of_each = pytest.mark.parametrize("name", GOLDEN)
of_nodes = pytest.mark.parametrize("name", NODES)


def test_each_distribution_has_its_vectors():
    assert list(GOLDEN) == ["dds", "humble", "jazzy", "kilted", "lyrical", "rolling"]


@of_each
def test_keys(name):
    for case in GOLDEN[name]["keys"]:
        ours = Ros2Network(
            "tcp/h:1", GOLDEN[name]["layout"], case["domain"], namespace=case["namespace"]
        )
        topic, message, key = case["topic"], case["message"], case["key"]
        assert ours.key_of(topic, message, key.rpartition("/")[2]) == key
        assert zenoh.KeyExpr(ours.pattern(topic, message)).includes(zenoh.KeyExpr(key))
        # A client of a service takes the hash from the token of its server.
        if name != "dds" and "/msg/" in message:
            assert key.endswith(NO_HASH if name == "humble" else messages().hash(message))


@of_each
def test_tokens_of_robots_are_understood(name):
    for case in GOLDEN[name]["tokens"]:
        about = announced(case["token"])
        if case["kind"] == "SC":  # Only servers of services are of interest.
            assert about is None
            continue
        read = (
            about.kind,
            about.layout,
            about.topic,
            about.message,
            about.qos.lasting,
            bool(about.backends),
        )
        assert read == (
            case["kind"], GOLDEN[name]["layout"], case.get("topic", ""), case.get("message", ""),
            case.get("lasting", False), case.get("buffered", False),
        )  # fmt: skip
        assert about.node == (case["node"] and f"{case['namespace']}/{case['node']}")


@of_nodes
def test_our_tokens_and_gids_are_those_of_nodes(name):
    for case in GOLDEN[name]["tokens"]:
        token, node = case["token"], case["node"]
        assert gid_of(token).hex() == case["gid"]
        if case.get("of_robot"):  # another quality of service than ours
            continue
        ours, session = Ros2Network("tcp/h:1", namespace=case["namespace"]), token.split("/")[2]
        if case["kind"] == "NN":
            made = ours.node_token(session, node)
        else:
            usual = HEARING if case["kind"] == "MS" else DEFAULT
            qos = LASTING if case["lasting"] else usual
            made = ours.topic_token(
                session, node, case["entity"], case["kind"], case["topic"], case["message"],
                token.split("/")[11], qos, buffered=case["buffered"],
            )  # fmt: skip
        assert made == token


@of_nodes
def test_subscriptions_tell_the_hash_that_they_expect(name):
    graph = RosGraph()
    for case in GOLDEN[name]["tokens"]:
        graph.update(case["token"], is_there=True)
    expected = NO_HASH if name == "humble" else messages().hash(types.LASER_SCAN)
    assert graph.hashes("/scan", types.LASER_SCAN) == {expected}


@of_nodes
def test_attachments(name):
    case = GOLDEN[name]["attachment"]
    about = Attachment(case["sequence"], case["nanoseconds"], bytes.fromhex(case["gid"]))
    assert about.packed().hex() == case["bytes"]
    assert Attachment.unpacked(bytes.fromhex(case["bytes"])) == about


def test_a_session_declares_its_tokens_in_order():
    seen = []
    with network() as (endpoint, hub):
        watch = hub.liveliness().declare_subscriber("@ros2_lv/**", lambda it: seen.append(it))
        session = Ros2Session(Ros2Network(endpoint), "robot")
        session.publisher("cmd_vel", types.TWIST)
        session.subscribe("camera", types.IMAGE, print)
        eventually(lambda: len(seen) == 3, "all tokens")
        watch.undeclare()
        session.close()
    tokens = [str(sample.key_expr).split("/") for sample in seen]
    assert len({token[4] for token in tokens}) == len(tokens)
    for name in NODES:
        expected = [token.split("/") for token in GOLDEN[name]["session"]["tokens"]]
        known = {"SESSION": session._id, "NODE": session.node}
        for token, golden in zip(tokens, expected, strict=True):
            known["ENTITY"] = token[4]
            assert token == [known.get(part, part) for part in golden]


# --- actions ---


class Server:
    """A session on which an action has a server; remembers the key of each request."""

    def __init__(self, network, graph):
        self.network, self.graph, self.keys = network, graph, {}

    server = Ros2Session.server

    def call(self, service, kind, data, seconds, answer):
        about = self.server(service, kind)
        type_hash = about.type_hash if about else ""
        self.keys[service.rpartition("/")[2]] = self.network.key_of(service, kind, type_hash)

    def subscribe(self, topic, message, receive, qos):
        self.keys[topic.rpartition("/")[2]] = self.network.pattern(topic, message)


@of_each
def test_actions(name):
    cases = {case["part"]: case for case in GOLDEN[name]["actions"]}
    graph = RosGraph()
    for case in cases.values():
        if "token" in case:
            graph.update(case["token"], is_there=True)
            about = announced(case["token"])
            expected = f"/bot1/navigate_to_pose/_action/{case['part']}", case["message"]
            assert (about.topic, about.message, about.qos.lasting) == (
                *expected, case.get("lasting", False),
            )  # fmt: skip
    layout = GOLDEN[name]["layout"]
    robot = Ros2Navigation(
        "tcp/h:1", layout=layout, namespace="/bot1", domain=0 if layout == "dds" else 7
    )
    navigation_messages()
    session = Server(robot.network, graph)
    goal = NavigationGoal("r1", {"x": 1.0, "y": 2.0, "angle": 0.0})
    robot.opened(session)
    robot._begin(goal, session, 0.0)
    goal.state = "running"
    robot._watch(goal, session, 1.0)
    robot._send_cancel(session, goal, print)
    assert session.keys.keys() == cases.keys() - {"status"}
    for part, key in session.keys.items():
        assert zenoh.KeyExpr(key).includes(zenoh.KeyExpr(cases[part]["key"]))
        assert part == "feedback" or key == cases[part]["key"]


# --- messages ---


def flat(value):
    """All values of a message in the order of its fields, nested ones in place."""
    if is_dataclass(value):
        return [
            leaf
            for field in fields(value)
            if field.name[0].islower()  # neither a constant nor the name of the type
            for leaf in flat(getattr(value, field.name))
        ]
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list):
        return [leaf for item in value for leaf in flat(item)]
    return [value]


@pytest.mark.parametrize(
    ("name", "message"), [(name, message) for name in NODES for message in GOLDEN[name]["messages"]]
)
def test_messages(name, message):
    case, make = GOLDEN[name]["messages"][message], messages()
    data = bytes.fromhex(case["cdr"])
    value = make.decode(message, data)
    assert flat(value) == case["values"]
    assert make.hash(message) == case.get("hash", make.hash(message))
    changed = name == "humble" and message == types.RANGE
    assert changed or make.encode(message, value) == data


def test_all_our_messages_have_vectors():
    used = {each for each in vars(types).values() if isinstance(each, str) and "_msgs/msg/" in each}
    assert all(used <= GOLDEN[name]["messages"].keys() for name in NODES)
