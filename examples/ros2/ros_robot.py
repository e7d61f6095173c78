"""A simulated ROS 2 robot, in a process of its own: the node that a real robot would run.

    python ros_robot.py --map office.yaml --start "1.4, 1.3, 90"

It speaks rmw_zenoh: /scan, /odom, /detections and /tf_static out, /cmd_vel in, CDR on Zenoh. It
is its own router, as `ros2 run rmw_zenoh_cpp rmw_zenohd` would be. It has two wheels, a floor
from a map_server map, and knows nothing of any string; without a command for half a second it
stops.
"""

import argparse
import json
import math
import signal
import struct
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zenoh
import zenoh.ext
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from ruamel.yaml import YAML

DEAD_MAN = 0.5
VISION = {
    "Detection3DArray": "std_msgs/Header header\nDetection3D[] detections",
    "Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
    "BoundingBox3D bbox\nstring id",
    "ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose",
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
}

store = get_typestore(Stores.LATEST)
definitions = {}
for vision_type, fields in VISION.items():
    definitions |= get_types_from_msg(fields, f"vision_msgs/msg/{vision_type}")
store.register(definitions)


def make(name, **values):
    """A ROS message."""
    return store.types[name](**values)


class Floor:
    """A map_server map: which cells are occupied, and how far it is to the next one."""

    def __init__(self, path):
        told = YAML(typ="safe").load(path.read_text())
        image = read_pgm(path.parent / told["image"])
        dark = image / 255 if told["negate"] else 1 - image / 255
        self.walls = (dark > told["occupied_thresh"])[::-1].T  # [x, y], y upwards
        self.cell = told["resolution"]
        self.origin = told["origin"][:2]
        self.start = told.get("start", [0.0, 0.0, 0.0])
        self.markers = told.get("markers", {})

    def ranges(self, x, y, angles, most):
        """Metres from a place to the first wall in each direction, exactly; inf beyond `most`."""
        x0, y0 = (x - self.origin[0]) / self.cell, (y - self.origin[1]) / self.cell
        cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
        reach = most / self.cell
        steps = np.arange(int(reach) + 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            down = np.where(cos > 0, np.floor(x0) + 1 + steps - x0, np.ceil(x0) - 1 - steps - x0)
            along = np.where(sin > 0, np.floor(y0) + 1 + steps - y0, np.ceil(y0) - 1 - steps - y0)
            crossings = np.concatenate([down / cos, along / sin], axis=1)
        crossings = np.where(np.isfinite(crossings) & (crossings <= reach), crossings, np.inf)
        probes = np.where(np.isfinite(crossings), crossings, 0) + 1e-6
        rows = np.floor(x0 + probes * cos).astype(int)
        columns = np.floor(y0 + probes * sin).astype(int)
        inside = (rows >= 0) & (rows < self.walls.shape[0])
        inside &= (columns >= 0) & (columns < self.walls.shape[1])
        hit = ~inside | self.walls[np.where(inside, rows, 0), np.where(inside, columns, 0)]
        return np.where(hit, crossings, np.inf).min(axis=1) * self.cell

    def is_free(self, x, y, radius):
        """Whether a disc stands on no wall."""
        row, column = (x - self.origin[0]) / self.cell, (y - self.origin[1]) / self.cell
        reach = radius / self.cell
        first, last = int(row - reach), int(row + reach) + 1
        left, right = int(column - reach), int(column + reach) + 1
        rows, columns = np.mgrid[first:last, left:right]
        near_x = np.clip(row, rows, rows + 1) - row
        near_y = np.clip(column, columns, columns + 1) - column
        walls = self.walls[max(0, first) : last, max(0, left) : right]
        if walls.shape != rows.shape:
            return False
        return not (walls & (near_x**2 + near_y**2 < reach**2)).any()


def read_pgm(path):
    """A binary PGM, by rows from the top."""
    data = path.read_bytes()
    words, at = [], 0
    while len(words) < 4:
        end = at
        while not data[end : end + 1].isspace():
            end += 1
        if data[at : at + 1] == b"#":
            end = data.index(b"\n", at)
        elif end > at:
            words.append(data[at:end])
        at = end + 1
    width, height = int(words[1]), int(words[2])
    return np.frombuffer(data, np.uint8, width * height, at).reshape(height, width)


@dataclass
class Wheels:
    """Where the robot is (metres, radians), and what its wheels do (per second)."""

    x: float
    y: float
    angle: float
    speed: float = 0.0
    turn: float = 0.0

    def roll(self, speed, turn, seconds, args, floor):
        """Change the velocity as fast as the motors can, and drive an arc with it."""
        most, turned = args.acceleration * seconds, args.turn_acceleration * seconds
        self.speed += min(most, max(-most, speed - self.speed))
        self.turn += min(turned, max(-turned, turn - self.turn))
        half = self.turn * seconds / 2
        chord = self.speed * seconds * (math.sin(half) / half if half else 1.0)
        x = self.x + chord * math.cos(self.angle + half)
        y = self.y + chord * math.sin(self.angle + half)
        self.angle += self.turn * seconds
        if floor.is_free(x, y, args.radius):
            self.x, self.y = x, y
        else:
            self.speed = 0.0


class Ros:
    """A node that speaks rmw_zenoh."""

    def __init__(self, listen, domain):
        config = zenoh.Config()
        for key, value in {
            "mode": "router",
            "listen/endpoints": [listen],
            "scouting/multicast/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.domain = domain
        self.publishers = {}
        self.kept = []

    def key(self, topic, message, type_hash=None):
        package, kind, name = message.split("/")
        type_hash = type_hash or store.hash_rihs01(message)
        return f"{self.domain}/{topic}/{package}::{kind}::dds_::{name}_/{type_hash}"

    def advertise(self, topic, message, lasting=False):
        key = self.key(topic, message)
        if lasting:
            cache = zenoh.ext.CacheConfig(1)
            publisher = zenoh.ext.declare_advanced_publisher(
                self.session, key, cache=cache, publisher_detection=True
            )
        else:
            publisher = self.session.declare_publisher(key)
        self.publishers[topic] = [message, publisher, 0]

    def publish(self, topic, value):
        message, publisher, number = self.publishers[topic]
        self.publishers[topic][2] = number + 1
        attachment = struct.pack("<qqB16s", number + 1, time.time_ns(), 16, topic.encode()[:16])
        publisher.put(bytes(store.serialize_cdr(value, message)), attachment=attachment)

    def subscribe(self, topic, message, hear):
        def heard(sample):
            hear(store.deserialize_cdr(sample.payload.to_bytes(), message))

        key = self.key(topic, message, "*")
        self.kept.append(self.session.declare_subscriber(key, heard))


class Robot:
    """The node: it drives, measures and tells."""

    def __init__(self, args):
        self.args = args
        self.floor = Floor(args.map)
        start = [float(one) for one in args.start.split(",")] if args.start else self.floor.start
        self.start = start[0], start[1], math.radians(start[2])
        self.wheels = Wheels(*self.start)
        self.ros = Ros(args.listen, args.domain)
        self.ros.advertise("scan", "sensor_msgs/msg/LaserScan")
        self.ros.advertise("odom", "nav_msgs/msg/Odometry")
        self.ros.advertise("detections", "vision_msgs/msg/Detection3DArray")
        self.ros.advertise("tf_static", "tf2_msgs/msg/TFMessage", lasting=True)
        self.wanted, self.wanted_at = (0.0, 0.0), -math.inf
        self.stops = 0
        self.ros.subscribe("cmd_vel", "geometry_msgs/msg/Twist", self.hear)
        self.ros.publish("tf_static", self.transforms())

    def hear(self, twist):
        speed = max(-self.args.speed, min(self.args.speed, twist.linear.x))
        turn = math.radians(self.args.turn)
        self.wanted = speed, max(-turn, min(turn, twist.angular.z))
        self.wanted_at = time.monotonic()

    def run(self, over):
        """Turn the wheels 100 times a second, tell odometry 50 times and scans 20 times."""
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
                place = self.wheels
                print(f"{place.x:.4f} {place.y:.4f} {math.degrees(place.angle):.3f}", flush=True)

    def header(self, frame):
        seconds, rest = divmod(time.time_ns(), 10**9)
        stamp = make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def odometry(self):
        """From where it was switched on."""
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
        """One turn of a laser that is mounted as on a TurtleBot 4, a quarter to the left."""
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
            bearing = math.atan2(y - here.y, x - here.x) - here.angle
            off = math.remainder(bearing, 2 * math.pi)
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


def vector(x=0.0, y=0.0, z=0.0):
    return make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def pose(x, y, angle=0.0):
    half = angle / 2
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=make(
            "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)
        ),
    )


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--map", type=Path, required=True, help="a map_server .yaml file")
    parser.add_argument("--start", default="", help='"x, y, degrees"; "": the map\'s own')
    parser.add_argument("--listen", default="tcp/127.0.0.1:7447")
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument("--beams", type=int, default=90)
    parser.add_argument("--range", type=float, default=8.0, help="metres")
    parser.add_argument("--laser-yaw", type=float, default=90.0, help="degrees")
    parser.add_argument("--fov", type=float, default=60.0, help="degrees of the camera")
    parser.add_argument("--sight", type=float, default=5.0, help="metres of the camera")
    parser.add_argument("--radius", type=float, default=0.18, help="metres")
    parser.add_argument("--speed", type=float, default=1.0, help="metres per second at most")
    parser.add_argument("--turn", type=float, default=180.0, help="degrees per second at most")
    parser.add_argument("--acceleration", type=float, default=2.0, help="m/s²")
    parser.add_argument("--turn-acceleration", type=float, default=20.0, help="rad/s²")
    parser.add_argument(
        "--trace", action="store_true", help="print where it is, ten times a second"
    )
    return parser.parse_args()


def main():
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    robot = Robot(arguments())
    print("the robot is on", flush=True)
    robot.run(over)
    robot.ros.session.close()


if __name__ == "__main__":
    main()
