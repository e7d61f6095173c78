"""Paths of test recordings, builders for log lines and bags, and a hurried player."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

DATA = Path(__file__).parents[3] / "shared" / "data"
INTEL = DATA / "carmen" / "intel-corrected.log.gz"
DEMO = DATA / "rosbags" / "scan_tools_demo_v2.bag"

needs_intel = pytest.mark.skipif(not INTEL.exists(), reason=f"{INTEL} is not there")
needs_demo = pytest.mark.skipif(not DEMO.exists(), reason=f"{DEMO} is not there")


class Hurried:
    """A stop event that records the waits, which return at once; `most` waits set it."""

    def __init__(self, most):
        self.most, self.asked = most, []

    def wait(self, seconds):
        self.asked.append(seconds)
        return self.is_set()

    def is_set(self):
        return len(self.asked) >= self.most


class Passed(list):
    """Collects skipped input as (reason, line)."""

    def __call__(self, what, line):
        self.append((what, line))

    def of(self, what):
        return [line for kind, line in self if kind == what]


def flaser(ranges, pose=(0.0, 0.0, 0.0), time=1.0, odometry=None):
    numbers = [len(ranges), *ranges, *pose, *(odometry or pose), time, "host", time]
    return "FLASER " + " ".join(map(str, numbers))


def odom(x=0.0, y=0.0, theta=0.0, tv=0.0, rv=0.0, time=1.0):
    return f"ODOM {x} {y} {theta} {tv} {rv} 0 {time} host {time}"


def robot_laser(ranges, laser, robot, first=-math.pi / 4, step=math.pi / 4, most=20.0, time=1.0):
    numbers = [0, first, -2 * first, step, most, 0.01, 0, len(ranges), *ranges, 1, 7]
    numbers += [*laser, *robot, 0.1, 0.2, 0.3, 0.4, 0.5, time, "host", time]
    return "ROBOTLASER1 " + " ".join(map(str, numbers))


def raw_laser(ranges, time=1.0):
    numbers = [0, -math.pi / 2, math.pi, math.pi / 2, 30.0, 0.01, 0, len(ranges), *ranges, 0]
    return "RAWLASER1 " + " ".join(map(str, [*numbers, time, "host", time]))


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n")
    return path


# --- bags ---


class Messages:
    """Builds ROS messages with the types of one store."""

    def __init__(self, store, ros1=False):
        self.types, self.ros1 = store.types, ros1

    def make(self, kind, **fields):
        return self.types[kind](**fields)

    def header(self, time=0.0, frame=""):
        seconds = math.floor(time)
        nanos = round((time - seconds) * 1e9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanos)
        first = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", **first, stamp=stamp, frame_id=frame)

    def scan(self, ranges, time=0.0, frame="laser", **more):
        fields = {
            "angle_min": -0.5, "angle_max": 0.5, "angle_increment": 0.5, "time_increment": 0.0,
            "scan_time": 0.1, "range_min": 0.1, "range_max": 8.0, **more,
        }  # fmt: skip
        return self.make(
            "sensor_msgs/msg/LaserScan", header=self.header(time, frame),
            ranges=np.array(ranges, np.float32), intensities=np.zeros(0, np.float32), **fields,
        )  # fmt: skip

    def point(self, x=0.0, y=0.0, z=0.0, kind="Point"):
        return self.make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def quaternion(self, yaw=0.0, roll=0.0):
        """The quaternion of a roll about x followed by a yaw about z."""
        cy, sy, cr, sr = (f(a / 2) for a in (yaw, roll) for f in (math.cos, math.sin))
        return self.make("geometry_msgs/msg/Quaternion", x=cy * sr, y=sy * sr, z=sy * cr, w=cy * cr)

    def odometry(self, x, y, yaw, speed=0.0, turn=0.0, time=0.0):
        pose = self.make(
            "geometry_msgs/msg/Pose", position=self.point(x, y), orientation=self.quaternion(yaw)
        )
        twist = self.make(
            "geometry_msgs/msg/Twist",
            linear=self.point(speed, kind="Vector3"), angular=self.point(z=turn, kind="Vector3"),
        )  # fmt: skip
        none = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry", header=self.header(time, "odom"), child_frame_id="base_link",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=none),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=none),
        )  # fmt: skip

    def transforms(self, *placed):
        """A TFMessage of transforms (parent, child, x, y, yaw, roll)."""
        made = [
            self.make(
                "geometry_msgs/msg/TransformStamped", header=self.header(0.0, parent),
                child_frame_id=child, transform=self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self.point(x, y, 0.3, kind="Vector3"),
                    rotation=self.quaternion(yaw, roll),
                ),
            )
            for parent, child, x, y, yaw, roll in placed
        ]  # fmt: skip
        return self.make("tf2_msgs/msg/TFMessage", transforms=made)

    def image(self, pixels, encoding, step=None, time=0.0):
        height, width = pixels.shape[:2]
        rows = pixels.reshape(height, -1)
        if step is not None:
            rows = np.pad(rows, ((0, 0), (0, step - rows.shape[1])), constant_values=77)
        return self.make(
            "sensor_msgs/msg/Image", header=self.header(time, "camera"), height=height,
            width=width, encoding=encoding, is_bigendian=0, step=rows.shape[1],
            data=np.ascontiguousarray(rows).reshape(-1),
        )  # fmt: skip

    def compressed(self, data, kind="jpeg", time=0.0):
        return self.make(
            "sensor_msgs/msg/CompressedImage", header=self.header(time, "camera"), format=kind,
            data=np.frombuffer(data, np.uint8),
        )  # fmt: skip

    def battery(self, percentage, voltage=12.0, time=0.0):
        none = np.zeros(0, np.float32)
        return self.make(
            "sensor_msgs/msg/BatteryState", header=self.header(time), voltage=voltage,
            temperature=math.nan, current=math.nan, charge=math.nan, capacity=math.nan,
            design_capacity=math.nan, percentage=percentage, power_supply_status=0,
            power_supply_health=0, power_supply_technology=0, present=True, cell_voltage=none,
            cell_temperature=none, location="", serial_number="",
        )  # fmt: skip

    def fix(self, latitude, longitude, altitude, variance=4.0, status=0, time=0.0):
        covariance = np.diag([variance, variance, variance]).reshape(-1)
        return self.make(
            "sensor_msgs/msg/NavSatFix", header=self.header(time, "gps"),
            status=self.make("sensor_msgs/msg/NavSatStatus", status=status, service=1),
            latitude=latitude, longitude=longitude, altitude=altitude,
            position_covariance=covariance, position_covariance_type=2,
        )  # fmt: skip


@cache
def messages(ros1=False):
    """Builders of ROS 1 or ROS 2 messages, and the store of their types."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        transforms = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(transforms, "tf2_msgs/msg/TFMessage"))
    return Messages(store, ros1), store


def write_bag(path, store, said, broken=()):
    """Write a bag of (seconds, topic, message); the path's suffix selects its format.

    The messages whose numbers are in `broken` are truncated to half their bytes.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    ros1 = path.suffix == ".bag"
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    folder = path.with_suffix("")
    writer = Writer1(path) if ros1 else Writer2(folder, version=9, storage_plugin=plugin)
    with writer:
        connections = {}
        for number, (seconds, topic, message) in enumerate(said):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            made = (store.serialize_ros1 if ros1 else store.serialize_cdr)(message, kind)
            data = bytes(made)
            if number in broken:
                data = data[: len(data) // 2]
            writer.write(connections[topic], round(seconds * 1e9), data)
    return path if ros1 else next(folder.glob(f"*{path.suffix}"))
