"""The device without a world: motor commands, /tf, and rejected input."""

import math
import sys
import threading
import time
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("rosbags")

from minerva_agents.robot.pose import Move, action_of
from minerva_agents.robot.vocabulary import TPlace
from minerva_agents.robot.world import vocabulary
from minerva_bus import Frame, Tick, WorldInfo
from minerva_bus.errors import MisuseError
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Scan
from minerva_bus.world.services import View
from minerva_services.bridges.ros2 import Ros2Robot
from minerva_services.bridges.ros2.driver import STILL, Velocity, driven
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.ros_messages.readings import heading_of, stamp_of
from tests.bridges.ros2_rig import network
from tests.patience import eventually

PERIOD = 0.01
STAY = Move()
BEAT = 0.05
"""Seconds for which the base drives by a command: those from one command to the next.

On a loaded machine the commands come late; the base waits for them, so it drives no further.
"""


class Base:
    """A robot's base: it executes commands and publishes its pose and the obstacle 1 m ahead."""

    def __init__(self, net, stamped=False):
        self.session = Ros2Session(net, "base")
        self.pose, self.velocity, self.stamped = Pose(), STILL, stamped
        self.told, self.stamps = [], []
        self.until, self.blocked, self.ranges = 0.0, False, [1.0]
        twist = types.TWIST_STAMPED if stamped else types.TWIST
        self.session.subscribe("cmd_vel", twist, lambda data: self._obey(twist, data))
        self.odometry = self.session.publisher("odom", types.ODOMETRY)
        self.laser = self.session.publisher("scan", types.LASER_SCAN)
        self.depth, self.camera = self.session.publisher("depth", types.RANGE), True
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *exc):
        self.over.set()
        self.thread.join()
        self.session.close()

    def _obey(self, kind, data):
        twist = messages().decode(kind, data)
        if self.stamped:
            self.stamps.append(stamp_of(twist))
            twist = twist.twist
        self.velocity = Velocity(twist.linear.x, float(np.degrees(twist.angular.z)))
        self.until = time.monotonic() + BEAT
        self.told.append(self.velocity)

    def _run(self):
        make, before = messages(), time.monotonic()
        nothing = np.zeros(36)
        while not self.over.wait(PERIOD):
            now = time.monotonic()
            seconds, before = max(0.0, min(now, self.until) - before), now
            if not self.blocked:
                self.pose = driven(self.pose, self.velocity, seconds)
            header = make.header("wheels", time.time_ns())
            at = make.pose(self.pose.x, self.pose.y, self.pose.angle)
            pose = make.make(
                "geometry_msgs/msg/PoseWithCovariance", pose=at, covariance=nothing
            )  # fmt: skip
            twist = make.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=make.twist(0.0, 0.0), covariance=nothing,
            )  # fmt: skip
            odometry = make.make(
                types.ODOMETRY, header=header, child_frame_id="base_link", pose=pose, twist=twist
            )
            self.odometry.put(odometry)
            if self.camera:
                self.depth.put(self._depth(make, header))
            if self.ranges is not None:
                self.laser.put(self._scan(make, header))

    def _depth(self, make, header):
        return make.make(
            types.RANGE, header=header, radiation_type=1, field_of_view=0.1, min_range=0.1,
            max_range=2.0, range=1.0, variance=0.0,
        )  # fmt: skip

    def _scan(self, make, header):
        return make.make(
            types.LASER_SCAN,
            header=header, angle_min=0.0, angle_max=0.0, angle_increment=0.1, time_increment=0.0,
            scan_time=0.1, range_min=0.1, range_max=8.0,
            ranges=np.array(self.ranges, np.float32), intensities=np.zeros(0, np.float32),
        )  # fmt: skip


class Body:
    """Drives the device as a world does."""

    def __init__(self, endpoint, **options):
        self.device = Ros2Robot(endpoint, mount="0, 0, 0", decide="eDecide", **options)
        self.device.joined(WorldInfo("w", vocabulary, 0, 0.1))
        self.frame = 0

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.device.close()

    def frames(self, *moves, halted=()):
        """Execute moves; returns the events and readings of the last frame."""
        events, published = [], {}
        for move in moves:
            view = TPlace(5.0, 5.0, 90.0)(action_of(move, "r1", 0.18))
            shown = View(self.frame, "eRepresent", view, halted=frozenset(halted))
            self.device.show(shown)
            decided = False
            while not decided:
                tick = Tick(Frame(self.frame, 0.1, 0), "robot")
                *events, decided = self.device.generate(tick) or (False,)
                published = dict(tick.published)
            self.frame += 1
        return events, published

    def settle(self, base, goal, move=STAY, halted=()):
        """Execute the move until the base stands at a pose."""

        def there():
            self.frames(move, halted=halted)
            far = goal.seen(base.pose)
            return base.told[-1] == STILL and math.hypot(far.x, far.y) < 0.03 and abs(far.angle) < 2

        eventually(there, lambda: f"{base.pose} is {goal}")


def test_it_drives_and_publishes_its_scan_at_its_believed_pose():
    with network() as (endpoint, _):
        net = Ros2Network(endpoint, "dds", namespace="bot1")
        options = {"layout": "dds", "namespace": "bot1", "stamped": True, "detections": ""}
        with Base(net, stamped=True) as base, Body(endpoint, **options) as body:
            base.blocked = True
            # What is missing is within the tolerances, so that the device goes on.
            events, published = body.frames(Move(6.0, 0.08))
            scan = published["scan"]
            believed = Pose(angle=6.0).compose(Pose(x=0.08))
            lag = believed.seen(base.pose)
            base.blocked = False
            body.frames(*[Move(0.0, 0.1)] * 3, Move(18.0, 0.0))
            goal = believed.compose(Pose(x=0.3, angle=18.0))
            body.settle(base, goal)
            saved = body.device.save()
    assert isinstance(scan, Scan)
    assert not events
    assert (scan.robot, scan.ranges.tolist()) == ("r1", [1.0])
    assert (scan.mount_x, scan.mount_y, scan.mount_angle) == pytest.approx(
        (lag.x, lag.y, lag.angle)
    )
    assert saved["goal"] == pytest.approx([goal.x, goal.y, goal.angle])


def test_the_pose_of_odometry_on_the_map_is_published():
    with network() as (endpoint, _):
        heard = []
        with Base(Ros2Network(endpoint)) as base, Body(endpoint, map_frame="map") as body:
            base.session.subscribe("/tf", types.TRANSFORMS, heard.append)
            body.frames(STAY, Move(0.0, 0.05), STAY, STAY)

            def placed():
                """The view places the robot at (5, 5), independent of its odometry."""
                (transform,) = messages().decode(types.TRANSFORMS, heard[-1]).transforms
                at = transform.transform
                assert (transform.header.frame_id, transform.child_frame_id) == ("map", "wheels")
                assert heading_of(at.rotation) == pytest.approx(90.0, abs=1.0)
                return math.dist((at.translation.x, at.translation.y), (5.0, 5.0 - 0.05)) < 0.02

            eventually(lambda: heard and placed(), "odometry begins behind the robot")


def test_motors_without_odometry_are_believed():
    with (
        network() as (endpoint, _),
        Base(Ros2Network(endpoint), stamped=True) as base,
        Body(endpoint, odometry="", stamped=True) as body,
    ):
        body.frames(*[Move(0.0, 0.1)] * 5)
        eventually(lambda: body.frames(STAY) and base.told[-1] == STILL, "the motors stop")
        goal = body.device.save()["goal"]
    assert goal == [pytest.approx(0.5), 0.0, 0.0]
    far = sum(
        velocity.speed * (after - stamp)
        for (velocity, stamp), (_, after) in pairwise(zip(base.told, base.stamps, strict=True))
    )
    assert far == pytest.approx(0.5, abs=0.03)


def test_without_the_robot_frames_go_on_without_decisions(monkeypatch, capsys):
    monkeypatch.setattr("minerva_services.bridges.ros2.mobile_base._SILENT_SECONDS", 0.0)
    with network() as (endpoint, _), Body(endpoint, blind={"odometry": 0.2}) as body:
        device, before = body.device, Tick(Frame(0, 0.01, 0), "robot")
        assert [event.type for event in device.generate(before)] == ["eDecide"]
        device.show(View(0, "eRepresent", TPlace(5.0, 5.0, 90.0)(action_of(STAY, "r1", 0.18))))
        for number in range(3):
            assert device.generate(Tick(Frame(number, 0.01, 0), "robot")) == ()
        assert device.report()["frames without robot"] == 3
        with Base(Ros2Network(endpoint)) as base:
            body.frames(STAY, Move(0.0, 0.1))
            base.over.set()
            eventually(lambda: "no /odom" in device.report()["source"], "it has gone")
            view = TPlace(5.0, 5.0, 90.0)(action_of(Move(0.0, 0.5), "r1", 0.18))
            for number in range(5, 8):
                device.show(View(number, "eRepresent", view))
                assert device.generate(Tick(Frame(number, 0.01, 0), "robot")) == ()
            # The command has begun once, and its successor begins it again.
            assert device.save()["goal"] == pytest.approx([0.1, 0.0, 0.0])
            assert device.save()["carried_out"] < 5
            goal = device._base.driver.goal
        with Base(Ros2Network(endpoint)) as base:
            base.pose = Pose(0.1)
            body.frame = 9
            body.frames(Move(0.0, 0.5))
            assert device._base.driver.goal == goal == Pose(pytest.approx(0.6), 0.0, 0.0)
    said = capsys.readouterr().out
    assert said.count("no robot yet: no /odom and no /scan from tcp/127.0.0.1:") == 1
    assert "; connect it, and compare: minerva doctor --ros2 tcp/" in said
    lines = ("is there", "no /odom from", "/odom from", "has returned; driving on")
    assert [said.count(line) for line in lines] == [1, 1, 2, 1]


BLIND = {
    "scan": ({}, "ranges", [1.0], None, "/scan"),
    "only nan": ({}, "ranges", [1.0], [math.nan], "/scan (without a valid range)"),
    "no beams": ({}, "ranges", [1.0], [], "/scan"),
    "camera": ({"watch": {"depth": types.RANGE}}, "camera", True, False, "/depth"),
}


@pytest.mark.parametrize(("options", "sensor", "good", "bad", "name"), BLIND.values(), ids=BLIND)
def test_a_robot_that_is_blind_stops_and_says_so_once(options, sensor, good, bad, name, capsys):
    watched = dict.fromkeys(["odometry", "scan", *options.get("watch", ())], 0.3)
    with (
        network() as (endpoint, _),
        Base(Ros2Network(endpoint)) as base,
        Body(endpoint, **options, blind=watched) as body,
    ):
        body.frames(Move(0.0, 0.05))
        setattr(base, sensor, bad)
        view = TPlace(5.0, 5.0, 90.0)(action_of(Move(0.0, 1.0), "r1", 0.18))
        body.device.show(View(body.frame, "eRepresent", view))

        def frame(decided):
            tick = Tick(Frame(body.frame, 0.1, 0), "robot")
            return bool(body.device.generate(tick)) is decided

        eventually(lambda: frame(False) and base.told[-1] == STILL, "it stops")
        stood = base.pose
        for _ in range(3):
            assert frame(False)
        assert base.pose == stood
        assert stood.x < 0.5
        setattr(base, sensor, good)
        eventually(lambda: frame(True), "it drives on")
        assert base.pose.x > 0.85
    said = capsys.readouterr().out
    assert said.count("stopped until") == said.count("driving on") == 1
    assert f"no {name} from {endpoint} since " in said
    assert "shows nothing" not in said


def test_a_laser_that_sees_nothing_in_its_range_is_not_blind(capsys):
    with network() as (endpoint, _), Base(Ros2Network(endpoint)) as base, Body(endpoint) as body:
        eventually(lambda: STILL in base.told, "it stops what a predecessor has begun")
        base.ranges = [math.inf, 9.0]
        body.frames(STAY)
        assert body.device.report()["scans without a hit"] > 0
    assert capsys.readouterr().out.count("shows nothing within 8 m") == 1


def test_one_body_is_not_for_two_robots():
    device = Ros2Robot("tcp/127.0.0.1:1")
    both = [TPlace(1.0, 1.0)(action_of(Move(), name, 0.18)) for name in ("r1", "r2")]
    view = View(0, "eRepresent", both[0] + both[1])
    with pytest.raises(MisuseError, match='robot = "r1"'):
        device.show(view)
    Ros2Robot("tcp/127.0.0.1:1", robot="r2").show(view)


@pytest.mark.parametrize("saved", [{}, {"goal": ["x"], "carried_out": 1}, {"goal": [1.0]}])
def test_unsaved_state_is_not_restored(saved):
    with pytest.raises(MisuseError, match="saved state"):
        Ros2Robot("tcp/127.0.0.1:1").restore(saved)


def test_a_view_that_was_carried_out_is_not_carried_out_again():
    device = Ros2Robot("tcp/127.0.0.1:1")
    device.restore({"goal": [1.0, 2.0, 3.0], "carried_out": 7})
    device.show(View(7, "eRepresent", action_of(Move(0.0, 1.0), "r1", 0.18)))
    assert device._ordered is None
    device.show(View(8, "eRepresent", action_of(Move(0.0, 1.0), "r1", 0.18)))
    assert device._ordered is not None
    assert device._ordered.command.forward_m == 1.0


def test_a_robot_that_is_halted_stops_and_is_not_believed_to_have_driven():
    with network() as (endpoint, _), Base(Ros2Network(endpoint)) as base, Body(endpoint) as body:
        body.frames(*[Move(0.0, 0.1)] * 3)
        goal = body.device.save()["goal"]
        body.settle(base, Pose(*goal), Move(0.0, 0.1), halted=("r1",))
        assert body.device.save()["goal"] == goal == pytest.approx([0.3, 0.0, 0.0], abs=0.02)
        body.frames(Move(0.0, 0.1), halted=("r2",))
        assert body.device.save()["goal"] == pytest.approx([0.4, 0.0, 0.0], abs=0.02)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"near": 0.0}, "near is 0"),
        ({"rate": -1.0}, "rate"),
        ({"cmd_vel": "a//b"}, "is not a valid name"),
        ({"blind": 3}, "blind is 3; expected a table"),
        ({"blind": {"scam": 3}}, "'scam', which is no sensor; did you mean 'scan'"),
        ({"blind": {"odometry": 0}}, "blind.odometry is 0; expected seconds"),
        ({"blind": {"scan": -1}}, "blind.scan is -1; expected seconds"),
        ({"blind": {"scan": math.nan}}, "blind.scan is nan; expected seconds"),
        ({"watch": ["scan"]}, "expected a table"),
        ({"watch": {"a//b": types.POINTS}}, "is not a valid name"),
    ],
)
def test_wrong_options(options, problem):
    with pytest.raises(MisuseError, match=problem):
        Ros2Robot("tcp/127.0.0.1:1", **options)


def test_a_watched_topic_has_a_known_type():
    robot = Ros2Robot("tcp/127.0.0.1:1", watch={"camera": "sensor_msgs/msg/PointCloud3"})
    with pytest.raises(MisuseError, match=r"watch: camera: .* did you mean 'sensor_msgs/msg/Point"):
        robot.check(WorldInfo("w", vocabulary, 0, 0.1))


def test_missing_rosbags_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[ros\]'"):
        types.MessageTypes()
