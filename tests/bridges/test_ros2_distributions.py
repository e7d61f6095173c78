"""Bridges with nodes of each distribution of ROS 2, as they behave on the network."""

import numpy as np
import pytest

pytest.importorskip("rosbags")

from minerva_services.bridges.ros2 import Ros2
from minerva_services.bridges.ros2 import messages as types
from minerva_services.bridges.ros2.messages import messages
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_peers import LyricalPublisher, Node
from tests.bridges.ros2_rig import network
from tests.patience import eventually


def image(shade):
    header, data = messages().header("camera", 1_500_000_000), np.full(6, shade, np.uint8)
    return messages().make(
        types.IMAGE,
        header=header, height=1, width=2, encoding="rgb8", is_bigendian=0, step=6, data=data,
    )  # fmt: skip


def has_come(running, put):
    """Publish until a reading arrives, and return the first."""
    eventually(lambda: put() or running.published, f"a reading; {running.bridge.report()}")
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
