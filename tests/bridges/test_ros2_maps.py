"""Maps of a ROS 2 robot as events of a world."""

from typing import Annotated

import numpy as np
import pytest

pytest.importorskip("rosbags")

from minerva_agents.robot.vocabulary import eLaser
from minerva_bus import Cells, Degrees, EventType, Metres, Vocabulary, WorldInfo
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Unit
from minerva_services.bridges.ros2 import Ros2
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros2.qos import LASTING
from minerva_services.bridges.ros2.view import occupancy
from minerva_services.bridges.ros_messages import GarbageError
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.ros_messages.readings import grid_of
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_rig import network

eMap = EventType("eMap", cells=Cells, cell=Metres, x=Metres, y=Metres, angle=Degrees)
INFO = WorldInfo("w", Vocabulary.of(eMap), 0, 0.1)
TOLD = [-1, 0, 100, 24, 25, 65]


def grid(data=TOLD, width=3, height=2, cell=0.05, turned=0.0):
    make = messages()
    about = make.make(
        "nav_msgs/msg/MapMetaData", map_load_time=make.time(0), resolution=cell,
        width=width, height=height, origin=make.pose(-1.0, 2.0, turned),
    )  # fmt: skip
    return make.make(
        types.GRID, header=make.header("map", 0), info=about, data=np.array(data, np.int8)
    )


def test_a_map_that_was_lost_on_its_way_is_repeated():
    lost = {"flows": ["ingress"], "messages": ["put"], "key_exprs": ["*/map/**"], "size_limit": 300}
    with network([lost]) as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint), "slam")
        slam = session.publisher("map", types.GRID, LASTING)
        with RunningBridge(Ros2(endpoint, map="map"), INFO) as running:
            running.wait_for(lambda: running.state == "open", "it is open")
            # A small map, which passes, and then one of 400 bytes, which is lost.
            slam.put(grid())
            running.wait_for(lambda: running.emitted, "the first map")
            slam.put(grid([0] * 400, 20, 20))
            running.wait_for(lambda: len(running.emitted) > 1, "the second map")
        session.close()
    assert running.emitted[1].cells.shape == (20, 20)


def test_a_late_subscriber_receives_the_map():
    with network() as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint), "slam")
        slam = session.publisher("map", types.GRID, LASTING)
        slam.put(grid(turned=90.0))
        bridge = Ros2(endpoint, map="map", robot="r7")
        assert bridge.generates() == ("eMap",)
        bridge.joined(INFO)
        with RunningBridge(bridge) as running:
            running.wait_for(lambda: running.emitted, "the map")
            event = running.emitted[0]
        session.close()
    assert event.receivers == ("r7",)
    assert event.cells.tolist() == [[0, 1], [1, 0], [9, 9]]
    assert (event.cell, event.x, event.y) == (0.05, -1.0, 2.0)
    assert event.angle == pytest.approx(90.0)


def test_a_map_survives_a_round_trip():
    cells = np.array([[0, 1, 9], [1, 9, 0]], np.int16)
    message = grid(occupancy(cells), width=2, height=3)
    assert np.array_equal(grid_of(message).cells, cells)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"width": 4}, "an OccupancyGrid of 6 cells for 4 × 2"),
        ({"data": [], "width": 0}, "of 0 cells for 0 × 2"),
        ({"cell": 0.0}, "whose cells are 0.0 m wide"),
        ({"turned": float("nan")}, "pose not finite"),
    ],
)
def test_invalid_maps(options, why):
    with pytest.raises(GarbageError, match=why):
        grid_of(grid(**options))


@pytest.mark.parametrize(
    ("declared", "why"),
    [
        (eLaser, "has no event type eMap"),
        (EventType("eMap", cell=Annotated[float, Unit("cm")]), "cell as real cm, but cell is real m"),
    ],
)  # fmt: skip
def test_a_world_without_such_an_event_is_reported(declared, why):
    with pytest.raises(MisuseError, match=why):
        Ros2("tcp/h:1", map="map").joined(WorldInfo("w", Vocabulary.of(declared), 0, 0.1))


eImu = EventType("eImu", angle=Degrees, turn=float, at=float)
eJoints = EventType("eJoints", name=tuple[str, ...], position=tuple[float, ...])
IMU = {
    "type": "sensor_msgs/msg/Imu", "event": "eImu", "rate": 0.001,
    "data": {"angle": "orientation", "turn": "angular_velocity.z", "at": "header.stamp"},
}  # fmt: skip
ePoints = EventType("ePoints", points=tuple[float, ...])
eSpeed = EventType("eSpeed", speed=float)
SPEED = {"event": "eSpeed", "data": {"speed": "linear.x"}, "qos": "transient_local"}
JOINTS = {"type": "sensor_msgs/msg/JointState", "event": "eJoints"}


def test_messages_of_any_type_are_events_at_most_at_their_rate():
    world = WorldInfo("w", Vocabulary.of(eImu, eJoints), 0, 0.1)
    turned = messages().pose(0.0, 0.0, 90.0).orientation
    header, zero = messages().header("imu", 1_500_000_000), np.zeros(9)
    imu = messages().make(
        IMU["type"], header=header, orientation=turned, orientation_covariance=zero,
        angular_velocity=messages().vector(z=0.5), angular_velocity_covariance=zero,
        linear_acceleration=messages().vector(), linear_acceleration_covariance=zero,
    )  # fmt: skip
    joints = messages().make(
        JOINTS["type"], header=header, name=["arm", "grip"], position=np.array([0.5, 0.25]),
        velocity=np.zeros(0), effort=np.zeros(0),
    )  # fmt: skip
    with network() as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint), "robot")
        senders = [session.publisher("imu", IMU["type"]), session.publisher("js", JOINTS["type"])]
        bridge = Ros2(endpoint, events={"imu": IMU, "js": JOINTS})
        assert bridge.generates() == ("eImu", "eJoints")
        with RunningBridge(bridge, world) as running:

            def both():
                for sender, message in zip(senders, (imu, joints), strict=True):
                    sender.put(message)
                return {event.type for event in running.emitted} == {"eImu", "eJoints"}

            running.wait_for(both, "events of both")
        session.close()
    (event,) = [event for event in running.emitted if event.type == "eImu"]
    assert event.values == pytest.approx((90.0, 0.5, 1.5))
    other = next(event for event in running.emitted if event.type == "eJoints")
    assert (other.values, other.receivers) == ((("arm", "grip"), (0.5, 0.25)), ("r1",))


def test_the_last_message_from_before_becomes_an_event():
    world, table = WorldInfo("w", Vocabulary.of(eSpeed), 0, 0.1), SPEED | {"type": types.TWIST}
    with network() as (endpoint, _):
        session = Ros2Session(Ros2Network(endpoint), "robot")
        session.publisher("limit", types.TWIST, LASTING).put(messages().twist(0.5, 0.0))
        with RunningBridge(Ros2(endpoint, events={"limit": table}), world) as running:
            running.wait_for(lambda: running.emitted, "the event")
        session.close()
    assert running.emitted[0].values == (0.5,)


@pytest.mark.parametrize(
    ("table", "why"),
    [
        (JOINTS | {"qos": "transient"}, "qos is 'transient'; did you mean 'transient_local'"),
        (JOINTS | {"type": "sensor_msgs/msg/JointStat"}, "did you mean 'sensor_msgs/msg/JointState'"),
        (JOINTS | {"data": {"position": "positions"}}, "it has no positions"),
        (JOINTS | {"data": {"position": "positions.0"}}, "it has no positions.0"),
        (JOINTS | {"data": {"position": "header"}}, "header: it consists of stamp, frame_id"),
        (
            JOINTS | {"data": {"position": "name"}},
            'as list of real, but name is list of text; declare position="list of text"',
        ),
        (JOINTS | {"data": {"position": "position.0"}}, "but position.0 is real; declare"),
        (JOINTS | {"type": types.POINTS, "event": "ePoints"}, 'declare points="matrix"'),
        (JOINTS | {"rate": 0}, "rate is 0"),
        ({"type": "sensor_msgs/msg/Imu"}, "event is missing"),
        ("sensor_msgs/msg/Imu", "must be a table"),
    ],
)  # fmt: skip
def test_events_that_do_not_fit_are_reported(table, why):
    with pytest.raises(MisuseError, match=why):
        Ros2("tcp/h:1", events={"js": table}).check(
            WorldInfo("w", Vocabulary.of(eJoints, ePoints), 0, 0.1)
        )
