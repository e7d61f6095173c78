"""Bridges with nodes of each distribution of ROS 2, as they behave on the network."""

import numpy as np
import pytest

pytest.importorskip("rosbags")

from minerva_services.bridges.ros2 import Ros2
from minerva_services.bridges.ros2 import messages as types
from minerva_services.bridges.ros2.messages import messages
from minerva_services.bridges.ros2.network import Ros2Network, Ros2Session
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_peers import LASTING_QOS, DdsBridge, LyricalPublisher, Node
from tests.bridges.ros2_rig import free_endpoint, network, scan, transforms
from tests.patience import eventually


def image(shade):
    header, data = messages().header("camera", 1_500_000_000), np.full(6, shade, np.uint8)
    return messages().make(
        types.IMAGE,
        header=header, height=1, width=2, encoding="rgb8", is_bigendian=0, step=6, data=data,
    )  # fmt: skip


def has_come(running, put):
    """Publish until a reading arrives, and return the first."""
    eventually(lambda: put() or running.published, "a reading")
    return running.published[0][1]


@pytest.mark.parametrize("lyrical", [False, True], ids=["until Kilted", "from Lyrical on"])
def test_images_of_all_distributions_arrive(lyrical):
    with network() as (endpoint, _), Node(endpoint) as robot:
        if lyrical:
            put = LyricalPublisher(robot, "/camera", types.IMAGE).put
        else:
            put = robot.publisher("/camera", types.IMAGE)
        with RunningBridge(Ros2(endpoint, image="camera")) as running:
            reading = has_come(running, lambda: put(image(7)))
    assert (reading.width, reading.height, reading.data) == (2, 1, bytes([7] * 6))


# --- a robot behind a zenoh-bridge-ros2dds ---


@pytest.mark.parametrize("topic", ["scan", "/scan"])
def test_the_namespace_of_a_dds_bridge_is_that_of_all_topics(topic):
    endpoint = free_endpoint()
    with DdsBridge(endpoint, "/bot1") as robot:
        robot.publisher("/tf_static", types.TRANSFORMS, lasting=True)(transforms(90.0))
        put = robot.publisher("/scan", types.LASER_SCAN)
        with RunningBridge(Ros2(endpoint, layout="dds", namespace="bot1", scan=topic)) as running:
            reading = has_come(running, lambda: put(scan()))
    assert reading.mount_angle == pytest.approx(90.0)


def test_transforms_may_be_in_the_namespace_of_a_robot():
    with network() as (endpoint, _), Node(endpoint, namespace="/bot1") as robot:
        put = robot.publisher("scan", types.LASER_SCAN)
        tf = robot.publisher("tf_static", types.TRANSFORMS, LASTING_QOS)
        with RunningBridge(Ros2(endpoint, namespace="bot1", tf="tf")) as running:
            reading = has_come(running, lambda: tf(transforms(90.0)) or put(scan()))
    assert reading.mount_angle == pytest.approx(90.0)


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_the_link_to_a_bridge_is_up_until_it_has_gone(mode):
    endpoint = free_endpoint()
    with DdsBridge(endpoint, mode=mode):
        session = Ros2Session(Ros2Network(endpoint, "dds"), "sensors")
        assert session.connected
    eventually(lambda: not session.connected, "it is lost")
    session.close()


def test_nodes_of_two_robots_in_a_domain_differ():
    with network() as (endpoint, hub):
        sessions = [Ros2Session(Ros2Network(endpoint), "motors") for _ in range(2)]

        def names():
            tokens = hub.liveliness().get("@ros2_lv/0/*/0/0/NN/**")
            return {str(token.ok.key_expr).rpartition("/")[2] for token in tokens}

        eventually(lambda: names() == {session.node for session in sessions}, "two names")
        assert len(names()) == 2
        for session in sessions:
            session.close()
