"""Topics over a real Zenoh router: scans, garbage counts, lost and restored connections."""

import threading

import numpy as np
import pytest

pytest.importorskip("rosbags")

from minerva_agents.robot.vocabulary import PGoal, PGrid, PMarker, PPath, TPlace
from minerva_agents.robot.world import vocabulary
from minerva_bus import WorldInfo
from minerva_bus.world.services import View
from minerva_services.bridges.ros2 import Ros2, Ros2View
from minerva_services.bridges.ros2.layout import Attachment, Ros2Network, gid_of
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros2.qos import LASTING
from minerva_services.bridges.ros2.sensors import _Listening
from minerva_services.bridges.ros2.view import occupancy
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from tests.bridges.ros2_rig import free_endpoint, network, router, scan, transforms
from tests.patience import patience
from tests.runtime.running import eventually

LAYOUTS = ("rmw_zenoh", "dds")
INFO = WorldInfo("w", vocabulary, 0, 0.1)


class Heard:
    """Runs a bridge in a thread and collects its readings."""

    def __init__(self, bridge):
        self.bridge = bridge
        self.readings = []
        self.stop = threading.Event()
        self.thread = threading.Thread(target=bridge.run, args=(self, self.stop), daemon=True)

    def __call__(self, event):
        raise AssertionError(event)

    def publish(self, topic, reading):
        self.readings.append((topic, reading))

    def __enter__(self):
        self.bridge.joined(INFO)
        self.thread.start()
        return self

    def __exit__(self, *exc):
        self.stop.set()
        self.thread.join(patience(10))
        assert not self.thread.is_alive()

    def until(self, put, topic):
        """Call `put` until a reading of the topic arrives, and return that reading."""

        def found():
            put()
            return next((reading for name, reading in self.readings if name == topic), None)

        return eventually(found, f"a reading on {topic}; {self.bridge.report()}")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_scan_has_its_mount(layout):
    with network() as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint, layout), "robot")
        lasting = session.publisher("/tf_static", types.TRANSFORMS, LASTING)
        lasting.put(transforms(90.0))
        laser = session.publisher("scan", types.LASER_SCAN)
        with Heard(Ros2(endpoint, layout=layout)) as heard:
            reading = heard.until(lambda: laser.put(scan()), "scan")
        session.close()
    assert (reading.mount_x, reading.mount_angle) == (pytest.approx(-0.04), pytest.approx(90.0))
    assert reading.ranges.tolist() == pytest.approx([0.5, 1.0, 12.0, 0.0, 0.0, 12.0])
    assert (reading.first, reading.step) == pytest.approx((-28.6479, 11.4592), abs=1e-3)
    assert (reading.robot, reading.time, reading.range_max) == ("r1", 1.5, 12.0)


def test_garbage_and_what_has_no_place_are_counted():
    with network() as (endpoint, hub):
        session = Ros2Session(Ros2Network(endpoint), "robot")
        laser = session.publisher("scan", types.LASER_SCAN)
        key = Ros2Network(endpoint).key_of("scan", types.LASER_SCAN, "RIHS01_0")
        with Heard(Ros2(endpoint)) as heard:

            def counted():
                hub.put(key, b"\x00\x01\x00\x00garbage")
                laser.put(scan("nowhere"))
                report = heard.bridge.report()
                return report.get("garbage", 0) > 2 and report.get("without a transform", 0) > 2

            eventually(counted, "both are counted")
            assert not heard.readings
        session.close()


def test_a_network_that_appears_late_or_returns(capsys):
    endpoint = free_endpoint()
    with Heard(Ros2(endpoint, mount="0, 0, 0")) as heard:
        eventually(lambda: "no ROS 2 network" in capsys.readouterr().out, "it says so")
        for _ in range(2):
            heard.readings.clear()
            hub, _ = router(endpoint)
            session = Ros2Session(Ros2Network(endpoint), "robot")
            laser = session.publisher("scan", types.LASER_SCAN)
            heard.until(lambda pub=laser: pub.put(scan()), "scan")
            session.close()
            hub.close()
            eventually(lambda: "open" not in heard.bridge.report()["source"], "it is lost")
        said = capsys.readouterr().out
    assert said.count("is back") == 2
    assert said.count("is lost") == 2


def test_more_than_can_wait_is_dropped_and_counted():
    bridge = Ros2("tcp/127.0.0.1:1")
    source = _Listening(None, bridge)
    hear = source.receiver(types.LASER_SCAN)
    for number in range(150):
        hear(bytes([number]))
    assert bridge.report()["dropped here"] == 50
    assert [data[0] for _, data in source.taken(0.0)] == list(range(50, 150))
    assert source.taken(0.0) == []


def test_large_images_displace_nothing_else_and_need_bounded_memory():
    bridge = Ros2("tcp/127.0.0.1:1")
    source, image = _Listening(None, bridge), bytes(10 << 20)
    see, hear = source.receiver(types.IMAGE), source.receiver(types.LASER_SCAN)
    for number in range(30):
        hear(bytes([number]))
        see(image)
    waiting = source.taken(0.0)
    assert [data[0] for message, data in waiting if message == types.LASER_SCAN] == list(range(30))
    images = [message for message, _ in waiting if message == types.IMAGE]
    assert len(images) == 6
    assert waiting[-1][0] == types.IMAGE
    assert bridge.report()["dropped here"] == 24


# --- RViz ---


class Orders:
    def __init__(self):
        self.given = []

    def order(self, event):
        self.given.append(event)


def picture():
    cells = np.array([[0, 1, 2], [10, 16, 9]], np.int16)
    places = TPlace(1.0, 1.0)(PMarker("door")) + TPlace(4.0, 1.0)(PMarker("lab"))
    known = PGrid(cells, 0.5, -1.0, 2.0) + PPath((0.0, 1.0), (0.0, 2.0))
    return places + known + TPlace(4.0, 1.0)(PGoal())


def test_a_grid_as_ros_has_it():
    cells = np.array([[0, 1, 2], [10, 16, 9]], np.int16)
    assert occupancy(cells).tolist() == [-1, 0, 0, 0, 100, 100]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_rviz_sees_the_map_and_orders_by_goals(layout, capsys):
    orders = Orders()
    with network() as (endpoint, _):
        view = Ros2View(endpoint, layout=layout)
        view.joined(WorldInfo("w", vocabulary, 0, 0.1, orders))
        eventually(lambda: view.report()["source"] == "open", "it is open")
        eventually(lambda: view._publishers, "it publishes")
        view.show(View(0, "ePicture", picture()))
        rviz = Ros2Session(Ros2Network(endpoint, layout), "rviz")
        grids, ways = [], []
        rviz.subscribe("map", types.GRID, grids.append, LASTING)
        rviz.subscribe("plan", types.PATH, ways.append)
        eventually(lambda: grids, "the map comes to one who is late")
        eventually(lambda: view.show(View(1, "ePicture", picture())) or ways, "the plan comes")
        clicked = rviz.publisher("goal_pose", types.POSE_STAMPED)

        def click(x, y, frame="map"):
            header, pose = messages().header(frame, 0), messages().pose(x, y)
            clicked.put(messages().make(types.POSE_STAMPED, header=header, pose=pose))

        eventually(lambda: click(3.6, 1.2) or orders.given, "a goal is an order")
        assert {order.marker for order in orders.given} == {"lab"}
        said: list[str] = []

        def refused():
            click(30.0, 1.0)
            said.append(capsys.readouterr().out)
            return "no marker within 2 m" in "".join(said)

        eventually(refused, "it says why not")
        rviz.close()
        view.close()
    grid = messages().decode(types.GRID, grids[-1])
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (2, 3, 0.5)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-1.0, 2.0)
    assert grid.data.tolist() == [-1, 0, 0, 0, 100, 100]
    way = messages().decode(types.PATH, ways[-1])
    assert [(stamped.pose.position.x, stamped.pose.position.y) for stamped in way.poses] == [
        (0, 0),
        (1, 2),
    ]


def test_a_cmd_vel_is_stamped_with_its_gid_and_number():
    with network() as (endpoint, hub):
        session = Ros2Session(Ros2Network(endpoint), "motors")
        heard = []
        subscriber = hub.declare_subscriber("0/cmd_vel/**", heard.append)
        motors = session.publisher("cmd_vel", types.TWIST)
        eventually(lambda: motors.put(messages().twist(0.5, 90.0)) or len(heard) > 2, "they come")
        tokens = [
            str(reply.ok.key_expr)
            for reply in hub.liveliness().get("@ros2_lv/**", timeout=patience(5))
        ]
        subscriber.undeclare()
        session.close()
    attachments = [Attachment.unpacked(sample.attachment.to_bytes()) for sample in heard]
    assert [attachment.sequence - attachments[0].sequence for attachment in attachments] == list(
        range(len(attachments))
    )
    assert len({attachment.gid for attachment in attachments}) == 1
    about = f"/MP/%/%/{session.node}/%cmd_vel/geometry_msgs::msg::dds_::Twist_/"
    (token,) = (token for token in tokens if about in token)
    assert attachments[0].gid == gid_of(token)
    twist = messages().decode(types.TWIST, heard[0].payload.to_bytes())
    assert (twist.linear.x, twist.angular.z) == (0.5, pytest.approx(np.pi / 2))
