"""Keys, attachments, frames, readings and steering: the parts that need no network."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from minerva_agents.robot.vocabulary import PRobot, TMove, TPlace, TRotate
from minerva_bus import Scene
from minerva_bus.errors import MisuseError
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Mount, Scan, Sighting, Sightings
from minerva_services.bridges.ros2.driver import (
    STILL,
    Driver,
    DriveTolerances,
    MotorLimits,
    OdometryTrack,
    SensorWatch,
    State,
    driven,
)
from minerva_services.bridges.ros2.layout import Attachment, Ros2Network
from minerva_services.bridges.ros2.mobile_base import (
    FramePacer,
    SensorBuffers,
    scanned_from,
    seen_from,
)
from minerva_services.bridges.ros2.sensors import Ros2
from minerva_services.bridges.ros_messages import Frames, SensorMount
from minerva_services.bridges.ros_messages.frames import mount_of
from minerva_services.bridges.ros_messages.messages import ODOMETRY, messages
from minerva_services.bridges.ros_messages.readings import sightings_of
from minerva_services.bridging.transforms import unit_quaternion
from minerva_services.physics.body import DriveCommand
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.geometry import PhysicalGeometry

SCAN = "sensor_msgs/msg/LaserScan"
BLIND = 0.5
"""Seconds for which sensors may be silent."""

LIMITS = MotorLimits(speed=0.5, turn=90.0, acceleration=1.0, turn_acceleration=360.0)


# --- command rate ---


def test_the_time_that_the_world_needs_is_time_of_the_next_command():
    rhythm, now = FramePacer(), 100.0
    assert rhythm.begin(0.1, now) == pytest.approx(0.1)
    for _ in range(10):
        now = rhythm.due + 0.04
        assert rhythm.begin(0.1, now) == pytest.approx(0.06)
    assert rhythm.due == pytest.approx(101.1)


def test_a_world_that_is_too_slow_never_waits():
    rhythm = FramePacer()
    rhythm.begin(0.1, 100.0)
    assert rhythm.begin(0.1, 100.25) == 0.0
    assert rhythm.begin(0.1, 100.30) == pytest.approx(0.05)


def test_after_a_rest_the_rhythm_restarts():
    rhythm = FramePacer()
    rhythm.begin(0.1, 100.0)
    assert rhythm.begin(0.1, 160.0) == pytest.approx(0.1)


# --- names and attachments; test_ros2_golden.py has keys and tokens ---


def test_a_topic_with_a_slash_is_in_no_namespace():
    network = Ros2Network("tcp/h:7447", namespace="bot1")
    assert network.name("cmd_vel") == "bot1/cmd_vel"
    assert network.name("/tf_static") == "tf_static"


@pytest.mark.parametrize("data", [b"", bytes(32), bytes(33), bytes(34)])
def test_other_bytes_are_no_attachment(data):
    with pytest.raises(MisuseError, match="attachment"):
        Attachment.unpacked(data)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"layout": "dsd"}, "did you mean 'dds'"),
        ({"router": "robot:7447"}, "tcp/HOST:7447"),
        ({"domain": 300}, "0 to 232"),
        ({"namespace": "bot#1"}, "is not a valid name"),
    ],
)
def test_invalid_networks(options, problem):
    with pytest.raises(MisuseError, match=problem):
        Ros2Network(**{"router": "tcp/h:7447", **options})


# --- sensor mounts ---


class Told:
    """A stand-in for a message, with the given attributes."""

    def __init__(self, **fields):
        self.__dict__.update(fields)


def transform(parent, child, x=0.0, y=0.0, z=0.0, roll=0.0, yaw=0.0):
    half, flip = math.radians(yaw) / 2, math.radians(roll) / 2
    turned = Told(
        x=math.sin(flip) * math.cos(half), y=math.sin(flip) * math.sin(half),
        z=math.cos(flip) * math.sin(half), w=math.cos(flip) * math.cos(half),
    )  # fmt: skip
    moved = Told(translation=Told(x=x, y=y, z=z), rotation=turned)
    return Told(header=Told(frame_id=parent), child_frame_id=child, transform=moved)


def frames(*transforms):
    made = Frames()
    made.update(Told(transforms=list(transforms)))
    return made


def near(mount, x, y, angle):
    return (mount.x, mount.y, mount.angle) == pytest.approx((x, y, angle), abs=1e-9)


def test_a_laser_on_a_shelf_on_the_robot():
    tree = frames(
        transform("base_link", "shelf", x=-0.1, yaw=90.0), transform("shelf", "laser", x=0.2)
    )
    mounting = tree.mounting("base_link", "laser")
    assert mounting is not None
    assert near(mounting.mount, -0.1, 0.2, 90.0)
    assert not mounting.flipped


def test_a_base_that_hangs_on_another_frame():
    tree = frames(
        transform("base_footprint", "base_link", x=0.1, yaw=90.0),
        transform("base_footprint", "laser", x=0.3),
    )
    mounting = tree.mounting("base_link", "laser")
    assert mounting is not None
    assert near(mounting.mount, 0.0, -0.2, -90.0)


def test_frames_that_are_not_connected():
    assert frames(transform("a", "b")).mounting("base_link", "b") is None


def test_frames_in_a_circle_end():
    assert frames(transform("a", "b"), transform("b", "a")).mounting("base_link", "a") is None


def test_a_laser_upside_down():
    mounting = frames(transform("base_link", "laser", roll=180.0)).mounting("base_link", "laser")
    assert mounting is not None
    assert mounting.flipped
    assert near(mounting.mount, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("text", ["1", "1, 2, x", "1, 2, nan"])
def test_wrong_mounts(text):
    with pytest.raises(MisuseError, match="'x, y, degrees'"):
        mount_of(text)


# --- readings relative to the believed pose ---


def test_a_scan_of_a_robot_that_lags_behind_is_of_the_same_walls():
    scan = Scan("", np.array([2.0], np.float32), 0.0, 1.0, 8.0, 0.0, 0.1, 0.0, 90.0)
    seen = scanned_from(Pose(-0.05, 0.02, -10.0), scan, "r1")
    at = Pose(-0.05, 0.02, -10.0).compose(Pose(0.1, 0.0, 90.0)).compose(Pose(x=2.0))
    again = Pose(seen.mount_x, seen.mount_y, seen.mount_angle).compose(Pose(x=2.0))
    assert (again.x, again.y) == pytest.approx((at.x, at.y))
    assert seen.robot == "r1"


def test_a_sighting_of_a_robot_that_lags_behind():
    sightings = Sightings("", (Sighting("door", 2.0, 0.0),), 0.0)
    (seen,) = seen_from(Pose(0.0, -1.0, 90.0), sightings, "r1").seen
    assert (seen.marker, seen.distance, seen.angle) == ("door", pytest.approx(1.0), 90.0)


# --- commands of a string ---


def commands(scene: Scene):
    seen = PhysicalGeometry()
    interpret(scene, seen)
    return {name: robot.command for name, robot in seen.robots.items()}


def test_turns_and_moves_within_a_place_are_commands():
    robot = TRotate(10.0)(TMove(0.5)(PRobot("r1", 0.2)))
    other = TPlace(3.0, 0.0, 0.0)(PRobot("r2", 0.2))
    assert commands(TPlace(1.0, 2.0, 30.0)(robot) + other) == {
        "r1": DriveCommand(10.0, 0.5),
        "r2": DriveCommand(),
    }


def test_command_numbers_restart_within_a_place():
    scene = TMove(9.0)(TPlace(0.0, 0.0, 0.0)(TMove(0.5)(PRobot("r1", 0.2))))
    assert commands(scene) == {"r1": DriveCommand(0.0, 0.5)}


def test_a_turn_within_a_move_is_refused():
    with pytest.raises(PhysicsError, match="put TMove within TRotate"):
        commands(TMove(0.5)(TRotate(10.0)(PRobot("r1", 0.2))))


# --- odometry ---


def test_poses_between_two():
    track = OdometryTrack(fastest=1.0, turning=90.0)
    track.add(10.0, Pose(0.0, 0.0, 170.0))
    track.add(12.0, Pose(1.0, 0.0, -170.0))
    pose = track.at(11.0)
    assert pose is not None
    assert (pose.x, pose.y) == pytest.approx((0.5, 0.0))
    assert abs(pose.angle) == pytest.approx(180.0)
    assert track.covers(11.0)
    assert not track.covers(12.5)


def test_a_clock_that_is_set_back_restarts():
    track = OdometryTrack(fastest=1.0, turning=90.0)
    track.add(1000.0, Pose(0.0, 0.0, 0.0))
    assert not track.add(3.0, Pose(0.1, 0.0, 0.0))
    assert track.restarts == 1
    assert track.at(3.0) == Pose(0.1, 0.0, 0.0)


# --- command execution ---


def new_driver(limits=LIMITS, care=None, *sensors):
    watch = SensorWatch(dict.fromkeys(("odometry", *sensors), BLIND))
    return Driver(limits, care or DriveTolerances(), watch)


class Wheels:
    """A robot that executes commands at once, on a simulated clock."""

    STEP = 0.01

    def __init__(self, care=None, limits=LIMITS, sensors=()):
        self.now, self.pose, self.velocity = 0.0, Pose(), STILL
        self.driver = new_driver(limits, care, *sensors)
        self.deaf = False
        self.wall = math.inf
        self.fastest = 0.0
        self.driver.update(self.now, self.pose, self.now)

    def step(self):
        velocity = self.driver.velocity(self.now)
        if velocity is not None:
            self.velocity = velocity
        self.fastest = max(self.fastest, abs(self.velocity.speed))
        moved = driven(self.pose, self.velocity, self.STEP)
        self.pose = moved if moved.x < self.wall else Pose(self.pose.x, self.pose.y, moved.angle)
        self.now += self.STEP
        if not self.deaf:
            self.driver.update(self.now, self.pose, self.now)
        return velocity

    def carry_out(self, command, seconds=0.1, most=2000):
        self.driver.begin(command, seconds, self.now)
        state = None
        for _ in range(most):
            self.step()
            state = self.driver.state(self.now)
            if state in (State.DONE, State.BLOCKED):
                return state
        raise AssertionError(f"{command} is not carried out: {state}")

    def missing(self):
        assert self.driver.goal is not None
        return self.driver.goal.seen(self.pose)


def test_commands_bring_the_robot_where_they_lead():
    wheels = Wheels()
    done = (
        [DriveCommand(0.0, 0.05)] * 20
        + [DriveCommand(18.0, 0.0)] * 5
        + [DriveCommand(0.0, 0.05)] * 20
    )
    for command in done:
        assert wheels.carry_out(command) is State.DONE
        assert abs(wheels.missing().y) < 0.03
    for _ in range(15):
        wheels.carry_out(DriveCommand())
    assert (wheels.pose.x, wheels.pose.y) == pytest.approx((1.0, 1.0), abs=0.02)
    assert wheels.pose.angle == pytest.approx(90.0, abs=2.0)


def test_it_turns_where_the_command_turns():
    wheels = Wheels(DriveTolerances(near=0.3))
    wheels.carry_out(DriveCommand(0.0, 0.5))
    assert wheels.missing().x < -0.25
    wheels.driver.begin(DriveCommand(90.0, 0.5), 0.1, wheels.now)
    off = 0.0
    for _ in range(600):
        wheels.step()
        wheels.driver.state(wheels.now)
        off = max(off, min(abs(wheels.pose.y), abs(wheels.pose.x - 0.5)))
    assert off < 0.03
    assert (wheels.pose.x, wheels.pose.y) == pytest.approx((0.5, 0.5), abs=0.03)


def test_it_never_drives_past_its_goal_and_never_too_fast():
    wheels = Wheels()
    for _ in range(10):
        wheels.carry_out(DriveCommand(0.0, 0.2))
        assert wheels.missing().x < 0.01
    assert 0.3 < wheels.fastest <= LIMITS.speed


def test_a_frame_takes_as_long_as_the_motors_need():
    wheels = Wheels()
    wheels.carry_out(DriveCommand(0.0, 2.0))
    assert wheels.now > (2.0 - wheels.driver.tolerances.near) / LIMITS.speed
    before = wheels.now
    wheels.carry_out(DriveCommand(), seconds=0.5)
    assert wheels.now - before == pytest.approx(0.5, abs=0.02)


def test_a_stop_at_a_wall_is_reported():
    wheels = Wheels()
    wheels.wall = 0.4
    assert wheels.carry_out(DriveCommand(0.0, 1.0)) is State.BLOCKED
    assert wheels.driver.give_up() == pytest.approx(0.6, abs=0.01)
    assert wheels.driver.goal is not None
    assert wheels.driver.goal.x == pytest.approx(wheels.pose.x)


def test_a_robot_without_commands_stops_and_receives_none():
    wheels = Wheels()
    wheels.driver.begin(DriveCommand(0.0, 5.0), 0.1, wheels.now)
    commands = [wheels.step() for _ in range(300)]
    assert any(command is not None and command.speed > 0 for command in commands)
    stopped = commands.index(STILL, 30)
    assert stopped * wheels.STEP < 0.1 + wheels.driver.tolerances.dead_man + 0.05
    assert commands[-1] is None
    assert all(command is None or command == STILL for command in commands[stopped:])


@pytest.mark.parametrize(
    "failure", ["no odometry", "no scan", "frozen odometry", "frozen scan", "nan"]
)
def test_a_blind_robot_stops_and_goes_on_when_it_sees(failure):
    wheels = Wheels(sensors=("scan",))
    watch, is_blind = wheels.driver.watch, False

    def step():
        """A step, in which the failed sensor sends nothing, the same again, or garbage."""
        if not (is_blind and failure == "no scan"):
            mark = "frozen" if is_blind and failure == "frozen scan" else wheels.now
            watch.note("scan", wheels.now, mark, "nan" if is_blind and failure == "nan" else "")
        wheels.deaf = is_blind and "odometry" in failure
        velocity = wheels.step()
        if is_blind and failure == "frozen odometry":
            wheels.driver.update(frozen, wheels.pose, wheels.now)
        return velocity, wheels.driver.state(wheels.now)

    wheels.driver.begin(DriveCommand(0.0, 5.0), 8.0, wheels.now)
    drives = [step() for _ in range(30)]
    assert drives[-1][0].speed > 0.1
    is_blind, frozen = True, wheels.driver.track.latest
    steps = round(BLIND / wheels.STEP)
    last = [step() for _ in range(steps + 4)]
    # Not before its time.
    assert last[steps - 3][0].speed > 0.1
    assert last[-1] == (STILL, State.LOST)
    (silent,) = watch.silent(wheels.now)
    assert silent in failure or failure == "nan"
    assert ("repeats" in watch.fault(silent)) == failure.startswith("frozen")
    is_blind = False
    state = next(state for _ in range(1500) if (state := step()[1]) is State.DONE)
    assert state is State.DONE
    assert abs(wheels.missing().x) < 0.11


def test_a_sensor_that_never_was_there_is_missing():
    watch = SensorWatch({"scan": BLIND, "odometry": math.inf})
    assert watch.missing() == ["scan", "odometry"]
    for now in (1.0, 9.0):
        # One that is not watched only has to be there once, with whatever it sends.
        watch.note("odometry", now, "frozen", "nan")
        watch.note("scan", now, now, "nan")
        watch.note("camera", now, now)
        assert watch.missing() == [*watch.silent(99.0)] == ["scan"]
    watch.note("scan", 9.0, 10.0)
    assert not watch.missing()
    assert watch.silent(9.0 + BLIND) == {}
    assert watch.silent(9.1 + BLIND) == {"scan": 9.0}
    # A clock that jumps, forwards or back, blinds no robot.
    for now, stamp in ((9.2, 1e9), (9.4, 3.0)):
        watch.note("scan", now, stamp)
    assert watch.silent(9.4 + BLIND) == {}


def test_a_new_process_stops_the_robot_that_drives_by_the_last_one():
    wheels = Wheels()
    assert wheels.step() is None
    wheels.driver.halt(wheels.now)
    assert [wheels.step() for _ in range(20)] == [STILL] * 20


def test_odometry_that_restarts_elsewhere_moves_no_robot():
    wheels = Wheels()
    wheels.carry_out(DriveCommand(0.0, 0.5))
    for _ in range(10):
        wheels.carry_out(DriveCommand())
    missing = wheels.missing()
    wheels.pose = Pose(20.0, -3.0, 45.0)
    wheels.step()
    assert wheels.driver.jumps == 1
    assert (wheels.missing().x, wheels.missing().y) == pytest.approx(
        (missing.x, missing.y), abs=0.01
    )


def test_a_robot_restarted_while_unreachable_stands():
    wheels = Wheels()
    for _ in range(10):
        wheels.carry_out(DriveCommand(0.0, 0.5))
    wheels.now += 600.0
    wheels.pose = Pose()
    wheels.step()
    assert wheels.driver.jumps == 1
    assert wheels.missing().x > -0.2


def test_a_goal_of_another_odometry_is_not_driven_to():
    driver = new_driver()
    driver.set_goal(Pose(7.0, 3.0, 90.0))
    driver.update(0.0, Pose(0.1, 0.0, 0.0), 0.0)
    assert driver.goal == Pose(0.1, 0.0, 0.0)
    assert driver.jumps == 1


def test_a_goal_of_a_predecessor_is_driven_to():
    driver = new_driver()
    driver.set_goal(Pose(0.3, 0.0, 0.0))
    driver.update(0.0, Pose(0.1, 0.0, 0.0), 0.0)
    assert driver.goal == Pose(0.3, 0.0, 0.0)
    assert driver.jumps == 0


def test_odometry_that_jumps_has_restarted():
    track = OdometryTrack(fastest=1.0, turning=90.0)
    track.add(0.0, Pose(0.0, 0.0, 90.0))
    assert not track.add(0.1, Pose(0.0, 0.0, 100.0))
    assert track.add(0.2, Pose())


@pytest.mark.parametrize("name", ["speed", "turn", "acceleration", "turn_acceleration"])
def test_wrong_limits(name):
    values = dict.fromkeys(("speed", "turn", "acceleration", "turn_acceleration"), 1.0)
    with pytest.raises(MisuseError, match=f"{name} is 0"):
        MotorLimits(**(values | {name: 0.0}))


def test_mounts_are_as_declared():
    assert mount_of(" 0.1, 0, 90") == Mount(0.1, 0.0, 90.0)
    assert mount_of("") is None
    assert SensorMount(Mount()) == SensorMount(Mount(), flipped=False)


# --- invalid values ---


def encoded(kind, message):
    return messages().encode(kind, message)


def odometry(heading=0.0, length=1.0, time=1.0):
    make = messages()
    pose = make.pose(1.0, 2.0, heading)
    for name in "xyzw":
        setattr(pose.orientation, name, length * getattr(pose.orientation, name))
    covariance, still = np.zeros(36), make.vector(0.0, 0.0)
    return make.make(
        ODOMETRY, header=make.header("odom", round(time * 1e9)), child_frame_id="base_link",
        pose=make.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        twist=make.make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=make.make("geometry_msgs/msg/Twist", linear=still, angular=still),
            covariance=covariance,
        ),
    )  # fmt: skip


def test_invalid_messages_of_a_network_are_counted_and_the_first_is_explained(capsys):
    pytest.importorskip("rosbags")
    bridge = Ros2("tcp/h:7447")
    for _ in range(2):
        assert bridge.reading(ODOMETRY, encoded(ODOMETRY, odometry(length=0.0))) is None
    assert bridge.report()["garbage"] == 2
    (line,) = capsys.readouterr().out.splitlines()
    assert f"a {ODOMETRY} skipped: the quaternion (0, 0, 0, 0) is not a rotation" in line
    _, reading = bridge.reading(ODOMETRY, encoded(ODOMETRY, odometry(30.0, length=4.0)))
    assert reading.angle == pytest.approx(30.0)


def test_invalid_odometry_of_a_robot_is_counted_and_explained(capsys):
    pytest.importorskip("rosbags")
    poses = []
    buffers = SensorBuffers(
        "base_link", None, lambda time, pose: poses.append(pose), lambda *_: None
    )
    receive = buffers._decoder(ODOMETRY, buffers._take_odometry)
    for length in (0.0, 0.0, 2.0):
        receive(encoded(ODOMETRY, odometry(90.0, length)))
    assert [pose.angle for pose in poses] == [pytest.approx(90.0)]
    assert buffers.counts == {"garbage": 2}
    assert capsys.readouterr().out.count("is not a rotation") == 1


def test_a_quaternion_of_length_1_keeps_its_bits():
    rotation = SimpleNamespace(x=0.0, y=0.0, z=0.6 + 1e-16, w=0.8)
    assert unit_quaternion(rotation) == (0.0, 0.0, 0.6 + 1e-16, 0.8)


def test_a_class_without_a_score_is_not_the_most_likely_one():
    def result(name, score):
        place = SimpleNamespace(position=SimpleNamespace(x=1.0, y=0.0, z=0.0))
        hypothesis = SimpleNamespace(class_id=name, score=score)
        return SimpleNamespace(hypothesis=hypothesis, pose=SimpleNamespace(pose=place))

    for results in (
        [result("a", math.nan), result("b", 0.5)],
        [result("b", 0.5), result("a", math.nan)],
    ):
        message = SimpleNamespace(detections=[SimpleNamespace(results=results)])
        (seen,) = sightings_of(message, "r1", np.eye(4), 1.0).seen
        assert seen.marker == "b"
