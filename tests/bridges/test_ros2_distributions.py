"""Bridges with nodes of each distribution of ROS 2, as they behave on the network."""

import threading

import numpy as np
import pytest
from zenoh import ZBytes

pytest.importorskip("rosbags")

from minerva_services.bridges.ros2 import Ros2
from minerva_services.bridges.ros2.graph import RosGraph
from minerva_services.bridges.ros2.layout import Attachment, Ros2Network
from minerva_services.bridges.ros2.network import Gaps, Ros2Session
from minerva_services.bridges.ros2.qos import DEFAULT, LASTING
from minerva_services.bridges.ros_messages import GarbageError
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_peers import (
    LASTING_QOS,
    NO_HASH,
    DdsBridge,
    LazyPublisher,
    LyricalPublisher,
    Node,
)
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


def test_a_camera_that_waits_for_subscriptions_counts_the_bridge():
    with network() as (endpoint, _), Node(endpoint) as robot:
        camera = LazyPublisher(robot, "/camera", types.IMAGE)
        with RunningBridge(Ros2(endpoint, image="camera")) as running:
            has_come(running, lambda: camera.put(image(7)))


# --- velocities and maps reach subscriptions with and without hashes of types ---


def test_velocities_reach_robots_that_appear_later():
    with network() as (endpoint, hub):
        session = Ros2Session(Ros2Network(endpoint), "motors")
        motors = session.publisher("cmd_vel", types.TWIST)
        heard, any_hash = [], []
        with Node(endpoint, "old", humble=True) as old, Node(endpoint, "new") as new:
            old.subscribe("/cmd_vel", types.TWIST, lambda twist: heard.append(("old", twist)))
            eventually(lambda: drive(motors, 0.1) or heard, "Humble alone is driven")
            new.subscribe("/cmd_vel", types.TWIST, lambda twist: heard.append(("new", twist)))
            eventually(lambda: drive(motors, 0.2) or named(heard, "new"), "both are driven")
            eventually(lambda: drive(motors, 0.2) or len(named(heard, "old")) > 2, "as before")
        # Without a robot of Humble, nothing is published twice to those who take any hash.
        eventually(lambda: not session.graph.hashes("/cmd_vel", types.TWIST), "both have gone")
        wild = hub.declare_subscriber("0/cmd_vel/**", any_hash.append)
        eventually(lambda: drive(motors, 0.3) or any_hash, "it arrives")
        wild.undeclare()
        session.close()
    assert all(NO_HASH not in str(sample.key_expr) for sample in any_hash)


def test_a_robot_that_restarts_is_driven_again():
    with network() as (endpoint, _), RunningBridge(Ros2(endpoint, mount="0, 0, 0")) as running:
        session, driven = Ros2Session(Ros2Network(endpoint), "motors"), []
        motors = session.publisher("cmd_vel", types.TWIST)
        for humble in (False, True, False):
            driven.clear()
            running.published.clear()
            with Node(endpoint, humble=humble) as robot:
                put = robot.publisher("/scan", types.LASER_SCAN)
                robot.subscribe("/cmd_vel", types.TWIST, driven.append)
                has_come(running, lambda put=put: put(scan()))
                eventually(lambda: drive(motors, 0.1) or driven, "it is driven")
        session.close()


def test_the_clock_of_a_robot_may_jump():
    with network() as (endpoint, _), Node(endpoint) as robot:
        put = robot.publisher("/scan", types.LASER_SCAN)
        with RunningBridge(Ros2(endpoint, mount="0, 0, 0", odometry="")) as running:
            for second in (100, 5000, 50, 51):
                message = scan()
                message.header.stamp.sec = second

                def arrived(message=message, second=second):
                    put(message)
                    return running.published and running.published[-1][1].time >= second

                eventually(arrived, f"the scan of {second} s")
                running.published.clear()
            assert running.counted("clock steps back") == 1


def test_messages_lost_on_the_way_are_counted_by_publisher(capsys):
    with network() as (endpoint, hub):
        key = Ros2Network(endpoint).key_of("scan", types.LASER_SCAN, "RIHS01_0")
        data = messages().encode(types.LASER_SCAN, scan())

        def put(number, gid):
            hub.put(key, data, attachment=Attachment(number, 0, gid * 16).packed())

        with RunningBridge(Ros2(endpoint, mount="0, 0, 0", odometry="")) as running:
            has_come(running, lambda: put(7, b"a"))
            for number, gid in ((8, b"a"), (3, b"b"), (11, b"a"), (4, b"b"), (10, b"a"), (6, b"b")):
                put(number, gid)
            running.wait_for(lambda: running.counted("lost on the way") == 3, "three are counted")
    assert capsys.readouterr().out.count("messages of scan are lost on the way") == 1


OTHER = "@ros2_lv/0/{}/0/1/MS/%/%/viewer/%camera/sensor_msgs::msg::dds_::Image_/RIHS01_0/::,:,:,:,,"


@pytest.mark.parametrize(
    ("others", "numbers", "missing", "left"),
    [
        ([], (1, 2, 5), 2, 1),
        (["/backends:cpu:"], (1, 2, 5), 2, 1),
        (["/backends:cpu:;gpu:a", "/backends:cpu:"], (1, 3, 5, 11), 2, 0),
        (["/backends:gpu:a", "/backends:gpu:a"], (1, 4, 7, 13), 1, 0),
        (["/backends:gpu:a", ""], (1, 2, 5), 2, 1),
    ],
    ids=["alone", "same memory", "other memory", "two others", "an older node"],
)
def test_images_of_nodes_that_share_memory_are_missed(others, numbers, missing, left):
    """As such a publisher numbers them [lyrical rmw_publisher_data.cpp 276-513]."""
    graph = RosGraph()
    for number, backends in enumerate(others):
        graph.update(OTHER.format(number) + backends, is_there=True)
    gaps = Gaps(lambda: graph.numbers("/camera", types.IMAGE))

    def missed(numbers):
        return sum(gaps.before(ZBytes(Attachment(n, 0, bytes(16)).packed())) for n in numbers)

    assert missed(numbers) == missing
    for number, backends in enumerate(others):
        graph.update(OTHER.format(number) + backends, is_there=False)
    # The first number after the last one may have been for a subscription that has gone.
    assert missed([numbers[-1] + 2, numbers[-1] + 3]) == left


def test_images_wait_in_the_network_and_not_in_a_queue_of_256_messages():
    """A handler with such a queue has a thread of Python, which is a gigabyte of images."""
    with network() as (endpoint, _), Node(endpoint) as robot:
        session, threads = Ros2Session(Ros2Network(endpoint), "camera"), {}
        for topic, message in (("camera", types.IMAGE), ("scan", types.LASER_SCAN)):

            def receive(_, topic=topic):
                threads[topic] = threading.current_thread()

            session.subscribe(topic, message, receive)
        camera = robot.publisher("/camera", types.IMAGE)
        laser = robot.publisher("/scan", types.LASER_SCAN)
        eventually(lambda: camera(image(1)) or laser(scan()) or len(threads) == 2, "both")
        session.close()
    of_zenoh = {topic: isinstance(each, threading._DummyThread) for topic, each in threads.items()}
    assert of_zenoh == {"camera": True, "scan": False}


def drive(motors, speed):
    motors.put(messages().twist(speed, 0.0))


def named(heard, name):
    return [twist for node, twist in heard if node == name]


@pytest.mark.parametrize("humble", [False, True], ids=["with hashes", "Humble"])
def test_a_last_map_reaches_subscriptions_of_later(humble):
    with network() as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint), "view")
        publisher, heard = session.publisher("map", types.PATH, LASTING), []
        header = messages().header("map", 0)
        publisher.put(messages().make(types.PATH, header=header, poses=[]))
        with Node(endpoint, humble=humble) as rviz:
            rviz.subscribe("/map", types.PATH, heard.append, LASTING_QOS)
            eventually(lambda: heard, "the map")
        session.close()


def test_a_publisher_whose_session_is_closed_loses_its_messages():
    with network() as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint), "view")
        publishers = [session.publisher("map", types.TWIST, qos) for qos in (LASTING, DEFAULT)]
        session.close()
        for publisher in publishers:
            drive(publisher, 0.1)


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


# --- types ---

USED = [each for each in vars(types).values() if isinstance(each, str) and "_msgs/msg/" in each]


def store_of(name):
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores[f"ROS2_{name}"])


@pytest.mark.parametrize("name", ["HUMBLE", "JAZZY", "KILTED", "LYRICAL"])
def test_types_are_the_same_in_all_distributions_but_for_one(name):
    store, ours = store_of(name), messages().store
    known = [message for message in USED if message != types.DETECTIONS]
    changed = {each for each in known if store.hash_rihs01(each) != ours.hash_rihs01(each)}
    assert len(known) > 12
    assert changed == ({types.RANGE} if name == "HUMBLE" else set())


def test_a_range_of_humble_has_no_variance():
    old, make = store_of("HUMBLE"), messages()
    stamp = old.types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = old.types["std_msgs/msg/Header"](stamp=stamp, frame_id="sonar")
    message = old.types[types.RANGE](
        header=header, radiation_type=0, field_of_view=0.3, min_range=0.1, max_range=4.0, range=1.5
    )
    data = bytes(old.serialize_cdr(message, types.RANGE))
    assert make.decode(types.RANGE, data).range == 1.5
    with pytest.raises(GarbageError, match="13 bytes are not a"):
        make.decode(types.RANGE, data[:13])
