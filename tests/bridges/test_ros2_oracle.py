"""Messages to and from zenoh-ros2-sdk, an independent implementation.

It runs in a separate process with its own home directory, because it changes the git configuration.
"""

import json
import os
import select
import subprocess
import sys

import pytest

pytest.importorskip(
    "zenoh_ros2_sdk", reason="zenoh-ros2-sdk, or git, is not here", exc_type=ImportError
)
pytest.importorskip("rosbags")

from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros2.qos import DEFAULT
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from tests.bridges.ros2_rig import network
from tests.patience import patience
from tests.runtime.running import eventually

TWIST = """
import json, sys, time
from zenoh_ros2_sdk import {what}

text = "geometry_msgs/Vector3 linear\\ngeometry_msgs/Vector3 angular"
vector = "float64 x\\nfloat64 y\\nfloat64 z"
definition = text + "\\n" + "=" * 80 + "\\nMSG: geometry_msgs/Vector3\\n" + vector
port = int(sys.argv[1])
options = dict(
    topic="/cmd_vel", msg_type="geometry_msgs/msg/Twist", msg_definition=definition,
    router_port=port, domain_id=0, type_hash={hash!r},
)
"""
HEARS = """
def heard(twist):
    print(json.dumps([twist.linear.x, twist.angular.z]), flush=True)
subscriber = ROS2Subscriber(callback=heard, **options)
time.sleep(60)
"""
SAYS = """
publisher = ROS2Publisher(**options)
Vector3 = publisher.session_mgr.store.types["geometry_msgs/msg/Vector3"]
while True:
    publisher.publish(linear=Vector3(x=0.25, y=0.0, z=0.0), angular=Vector3(x=0.0, y=0.0, z=-0.5))
    time.sleep(0.05)
"""


@pytest.fixture
def oracle(tmp_path):
    """A function that starts a script with the SDK and returns its process."""
    started = []

    def run(script, endpoint):
        home = {**os.environ, "HOME": str(tmp_path), "ZENOH_CONFIG_OVERRIDE": 'mode="client"'}
        words = [sys.executable, "-c", script, endpoint.rpartition(":")[2]]
        started.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=home))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def script(what, body):
    return TWIST.format(what=what, hash=messages().hash(types.TWIST)) + body


def test_the_judge_receives_our_velocities(oracle):
    with network() as (endpoint, hub):
        judge = oracle(script("ROS2Subscriber", HEARS), endpoint)
        session = Ros2Session(Ros2Network(endpoint), "motors")
        motors = session.publisher("cmd_vel", types.TWIST)

        def there():
            tokens = hub.liveliness().get("@ros2_lv/0/*/*/*/MS/**", timeout=patience(5))
            return [token for token in tokens if "cmd_vel" in str(token.ok.key_expr)]

        eventually(there, "the judge has subscribed")

        def heard():  # A token may exist before its subscription: publish until it is received.
            motors.put(messages().twist(0.5, 90.0))
            return select.select([judge.stdout], [], [], 0.2)[0]

        eventually(heard, "the judge hears it")
        assert json.loads(judge.stdout.readline()) == [0.5, pytest.approx(1.5707963)]
        session.close()


def test_we_receive_the_judges_velocities(oracle):
    with network() as (endpoint, _):
        oracle(script("ROS2Publisher", SAYS), endpoint)
        session = Ros2Session(Ros2Network(endpoint), "robot")
        heard = []
        session.subscribe("cmd_vel", types.TWIST, heard.append)
        eventually(lambda: heard, "a velocity comes")
        session.close()
    twist = messages().decode(types.TWIST, heard[0])
    assert (twist.linear.x, twist.angular.z) == (0.25, -0.5)


def test_the_judge_makes_the_same_keys_tokens_and_hashes(oracle):
    body = """
from zenoh_ros2_sdk.utils import get_type_hash
from zenoh_ros2_sdk.keyexpr import topic_keyexpr, endpoint_liveliness_keyexpr
from zenoh_ros2_sdk.entity import NodeEntity, EndpointEntity, EntityKind
from zenoh_ros2_sdk.qos import QosProfile
made = get_type_hash("geometry_msgs/msg/Vector3", msg_definition=vector, dependencies={})
name = "geometry_msgs::msg::dds_::Vector3_"
node = NodeEntity(5, "abc", 0, "motors")
end = EndpointEntity(
    node, 3, EntityKind.PUBLISHER, "/a/b", name, made, QosProfile().encode()
)
print(json.dumps([made, topic_keyexpr(5, "/a/b", name, made), endpoint_liveliness_keyexpr(end)]))
"""
    judge = oracle(script("ROS2Publisher", body), "tcp/127.0.0.1:1")
    made, key, token = json.loads(judge.stdout.readline())
    vector, ours = "geometry_msgs/msg/Vector3", Ros2Network("tcp/h:1", domain=5)
    assert messages().hash(vector) == made
    assert ours.key_of("a/b", vector, made) == key
    # The root namespace is "/", which rmw_zenoh encodes as %.
    produced = ours.topic_token("abc", "motors", 3, "MP", "a/b", vector, made, DEFAULT)
    assert produced == token
