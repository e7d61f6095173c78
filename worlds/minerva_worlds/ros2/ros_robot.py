"""A simulated ROS 2 robot in its own process: the node that a real robot would run.

    python ros_robot.py --map house.yaml --start "1.4, 1.3, 90"

It uses rmw_zenoh: publishes /scan, /odom, /detections and /tf_static, subscribes to /cmd_vel, with
CDR on Zenoh. It is its own router, like `ros2 run rmw_zenoh_cpp rmw_zenohd`. It has two wheels and
a floor from a map_server map, and is independent of Minerva Bus. Without a command for half a
second it stops.

With --clock it is a simulation driven by /clock (use_sim_time): its time advances only by Clock
messages. It answers each of them with odometry, scan and detections of that time. The velocity
between two times is the TwistStamped with the earlier one.
"""

import argparse
import math
import signal
import threading
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from floor import Floor
from node import Ros, make, pose, vector

DEAD_MAN = 0.5


@dataclass
class Wheels:
    """The robot's pose in metres and radians, and its velocities per second."""

    x: float
    y: float
    angle: float
    speed: float = 0.0
    turn: float = 0.0

    def roll(self, speed, turn, seconds, args, floor):
        """Change the velocity within the motors' limits, and drive an arc with it."""
        most, turned = args.acceleration * seconds, args.turn_acceleration * seconds
        self.speed += min(most, max(-most, speed - self.speed))
        self.turn += min(turned, max(-turned, turn - self.turn))
        half = self.turn * seconds / 2
        chord = self.speed * seconds * (math.sin(half) / half if half else 1.0)
        heading = self.angle + half
        self.angle += self.turn * seconds
        free = self.free(chord, heading, args.radius, floor)
        self.x += free * math.cos(heading)
        self.y += free * math.sin(heading)
        if free != chord:
            self.speed = 0.0

    def free(self, chord, heading, radius, floor):
        """The free length of a straight path in metres."""

        def collides(far):
            x, y = self.x + far * math.cos(heading), self.y + far * math.sin(heading)
            return not floor.is_free(x, y, radius)

        steps = max(1, math.ceil(abs(chord) / 0.01))
        ways = [chord * (number + 1) / steps for number in range(steps)]
        touched = next((number for number, far in enumerate(ways) if collides(far)), None)
        if touched is None:
            return chord
        free, stopped = (ways[touched - 1] if touched else 0.0), ways[touched]
        for _ in range(30):
            middle = (free + stopped) / 2
            free, stopped = (free, middle) if collides(middle) else (middle, stopped)
        return free


class Robot:
    """The node: drives, measures and publishes."""

    def __init__(self, args):
        self.args = args
        self.floor = Floor(args.map)
        start = (
            [float(number) for number in args.start.split(",")] if args.start else self.floor.start
        )
        self.start = start[0], start[1], math.radians(start[2])
        self.wheels = Wheels(*self.start)
        self.ros = Ros(args.listen, args.domain)
        self.ros.advertise("scan", "sensor_msgs/msg/LaserScan")
        self.ros.advertise("odom", "nav_msgs/msg/Odometry")
        self.ros.advertise("detections", "vision_msgs/msg/Detection3DArray")
        self.ros.advertise("tf_static", "tf2_msgs/msg/TFMessage", lasting=True)
        self.wanted, self.wanted_at = (0.0, 0.0), -math.inf
        self.now, self.clock = None, None
        self.news = threading.Condition()
        if args.clock:
            self.ros.subscribe("cmd_vel", "geometry_msgs/msg/TwistStamped", self.on_stamped)
            self.ros.subscribe("clock", "rosgraph_msgs/msg/Clock", self.on_clock)
        else:
            self.ros.subscribe("cmd_vel", "geometry_msgs/msg/Twist", self.on_twist)
        self.ros.publish("tf_static", self.transforms())

    def on_twist(self, twist):
        speed = max(-self.args.speed, min(self.args.speed, twist.linear.x))
        turn = math.radians(self.args.turn)
        self.wanted = speed, max(-turn, min(turn, twist.angular.z))
        self.wanted_at = time.monotonic()

    def on_stamped(self, message):
        with self.news:
            self.on_twist(message.twist)
            self.wanted_at = nanoseconds(message.header.stamp)
            self.news.notify()

    def on_clock(self, message):
        with self.news:
            self.clock = nanoseconds(message.clock)
            self.news.notify()

    def run_by_clock(self, over):
        """Advance to each new time once its velocity is known, and publish the measurements."""
        while not over.is_set():
            with self.news:
                if not self.news.wait_for(self.can_advance, 0.1):
                    continue
                until, self.clock = self.clock, None
                wanted = self.wanted
            if self.now is not None and until > self.now:
                self.wheels.roll(*wanted, (until - self.now) * 1e-9, self.args, self.floor)
            self.now = max(until, self.now or 0)
            self.ros.publish("scan", self.scan())
            self.ros.publish("detections", self.detections())
            self.ros.publish("odom", self.odometry())
            if self.args.trace:
                self.trace()

    def can_advance(self):
        """True if a new time has arrived, and the velocity until then."""
        if self.clock is None or self.now is None or self.clock <= self.now:
            return self.clock is not None
        return self.wanted_at == self.now

    def run(self, over):
        """Drive at 100 Hz; publish odometry at 50 Hz and scans at 20 Hz."""
        begun = before = time.monotonic()
        number = 0
        while not over.is_set():
            number += 1
            over.wait(max(0.0, begun + number / 100 - time.monotonic()))
            now = time.monotonic()
            wanted = self.wanted if now - self.wanted_at < DEAD_MAN else (0.0, 0.0)
            self.wheels.roll(*wanted, now - before, self.args, self.floor)
            before = now
            if number % 2 == 0:
                self.ros.publish("odom", self.odometry())
            if number % 5 == 0:
                self.ros.publish("scan", self.scan())
                self.ros.publish("detections", self.detections())
            if self.args.trace and number % 10 == 0:
                self.trace()

    def trace(self):
        place = self.wheels
        print(f"{place.x:.4f} {place.y:.4f} {math.degrees(place.angle):.3f}", flush=True)

    def header(self, frame):
        seconds, rest = divmod(time.time_ns() if self.now is None else self.now, 10**9)
        stamp = make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def odometry(self):
        """The pose relative to the start."""
        x0, y0, angle0 = self.start
        x, y = self.wheels.x - x0, self.wheels.y - y0
        cos, sin = math.cos(angle0), math.sin(angle0)
        twist = make(
            "geometry_msgs/msg/Twist",
            linear=vector(self.wheels.speed),
            angular=vector(z=self.wheels.turn),
        )
        nothing = np.zeros(36)
        return make(
            "nav_msgs/msg/Odometry",
            header=self.header("odom"),
            child_frame_id="base_link",
            pose=make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=pose(x * cos + y * sin, y * cos - x * sin, self.wheels.angle - angle0),
                covariance=nothing,
            ),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=nothing),
        )

    def scan(self):
        """A revolution of a laser mounted as on a TurtleBot 4, rotated by 90° to the left."""
        args = self.args
        step = 2 * math.pi / args.beams
        first = -step * (args.beams // 2)
        turned = self.wheels.angle + math.radians(args.laser_yaw) + first
        angles = turned + step * np.arange(args.beams)
        ranges = self.floor.ranges(self.wheels.x, self.wheels.y, angles, args.range)
        return make(
            "sensor_msgs/msg/LaserScan",
            header=self.header("rplidar_link"),
            angle_min=first,
            angle_max=first + step * (args.beams - 1),
            angle_increment=step,
            time_increment=0.0,
            scan_time=0.05,
            range_min=0.01,
            range_max=args.range,
            ranges=ranges.astype(np.float32),
            intensities=np.zeros(0, np.float32),
        )

    def detections(self):
        """The markers in the camera's view."""
        seen = []
        here = self.wheels
        for name, (x, y) in sorted(self.floor.markers.items()):
            far = math.hypot(x - here.x, y - here.y)
            cos, sin = math.cos(here.angle), math.sin(here.angle)
            ahead = (x - here.x) * cos + (y - here.y) * sin
            off = math.atan2((y - here.y) * cos - (x - here.x) * sin, ahead)
            if far > self.args.sight or abs(off) > math.radians(self.args.fov) / 2:
                continue
            free = self.floor.ranges(here.x, here.y, np.array([here.angle + off]), far + 1)[0]
            if free >= far - 1e-3:
                seen.append(self.detection(name, far * math.cos(off), far * math.sin(off)))
        return make(
            "vision_msgs/msg/Detection3DArray", header=self.header("base_link"), detections=seen
        )

    def detection(self, name, x, y):
        result = make(
            "vision_msgs/msg/ObjectHypothesisWithPose",
            hypothesis=make("vision_msgs/msg/ObjectHypothesis", class_id=name, score=1.0),
            pose=make(
                "geometry_msgs/msg/PoseWithCovariance", pose=pose(x, y), covariance=np.zeros(36)
            ),
        )
        box = make("vision_msgs/msg/BoundingBox3D", center=pose(x, y), size=vector())
        return make(
            "vision_msgs/msg/Detection3D",
            header=self.header("base_link"), results=[result], bbox=box, id="",
        )  # fmt: skip

    def transforms(self):
        half = math.radians(self.args.laser_yaw) / 2
        turned = make(
            "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)
        )
        return make(
            "tf2_msgs/msg/TFMessage",
            transforms=[
                make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header("base_link"),
                    child_frame_id="rplidar_link",
                    transform=make(
                        "geometry_msgs/msg/Transform", translation=vector(z=0.2), rotation=turned
                    ),
                )
            ],
        )


def nanoseconds(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    # The plan is a file; nothing of the package that ships it is imported.
    agents = find_spec("minerva_agents")
    plan = Path(agents.origin).parent / "robot" / "plan" / "office.yaml" if agents else None
    parser.add_argument("--map", type=Path, default=plan, required=agents is None,
                        help="a map_server .yaml file; by default the office plan")  # fmt: skip
    parser.add_argument("--start", default="", help='"x, y, degrees"; "": the map\'s own')
    parser.add_argument("--listen", default="tcp/127.0.0.1:7447")
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument("--beams", type=int, default=90)
    parser.add_argument("--range", type=float, default=8.0, help="metres")
    parser.add_argument("--laser-yaw", type=float, default=90.0, help="degrees")
    parser.add_argument("--fov", type=float, default=60.0, help="degrees of the camera")
    parser.add_argument("--sight", type=float, default=5.0, help="metres of the camera")
    parser.add_argument("--radius", type=float, default=0.18, help="metres")
    parser.add_argument("--speed", type=float, default=1.0, help="maximum in m/s")
    parser.add_argument("--turn", type=float, default=180.0, help="maximum in degrees/s")
    parser.add_argument("--acceleration", type=float, default=2.0, help="m/s²")
    parser.add_argument("--turn-acceleration", type=float, default=20.0, help="rad/s²")
    parser.add_argument("--clock", action="store_true", help="use /clock as the only time")
    parser.add_argument("--trace", action="store_true", help="print the pose, ten times per second")
    return parser.parse_args()


def main():
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    robot = Robot(arguments())
    print("the robot is on", flush=True)
    (robot.run_by_clock if robot.args.clock else robot.run)(over)
    robot.ros.session.close()


if __name__ == "__main__":
    main()
