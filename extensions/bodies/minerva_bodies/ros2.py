"""Sensors of a world in space on a network of ROS 2, for the option `ros2` of a service.

Frames of reference are `world`, those of agents, `AGENT/SYMBOL` of sensors and, of cameras,
`AGENT/SYMBOL_optical`, whose z axis points into the picture [REP 103]. Stamps are simulated time,
which `/clock` has, so that nodes run with `use_sim_time`.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import AXIAL
from minerva_bodies.rigid import Rigid
from minerva_bodies.sensors import Sensor, ray_axes
from minerva_bus.world.readings import Image, Position, Scan
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import NetworkLink, Ros2Session, TopicPublisher
from minerva_services.bridges.ros2.qos import DEFAULT, LASTING
from minerva_services.bridges.ros_messages.definitions import built
from minerva_services.bridges.ros_messages.messages import (
    CLOCK,
    POINTS,
    RANGE,
    TRANSFORMS,
    messages,
)
from minerva_services.bridges.ros_messages.sending import message_of
from minerva_services.bridging import SourceError

CAMERA_INFO: Final = "sensor_msgs/msg/CameraInfo"
IMU: Final = "sensor_msgs/msg/Imu"
JOINT_STATE: Final = "sensor_msgs/msg/JointState"
WORLD, SCAN = "world", "scan"

_FLOAT32: Final = 7
"""PointField's number of this type."""
_INFRARED: Final = 1
_UNKNOWN: Final = -1.0
"""First covariance of what an inertial unit does not measure, its orientation."""
_OPTICAL: Final = Rigid(0.0, 0.0, 0.0, 0.5, -0.5, 0.5, -0.5)
"""The axes of a picture, right, down and ahead, along those of a camera: ahead, left and up."""
_BEAT_SECONDS: Final = 0.25

Made = tuple[str, str, Any]
"""A topic, the type of its messages, and one of them."""


class RosNode:
    """A node that publishes; what it sends is lost while the network is not there.

    Args:
        service: its name, for errors.
        options: those of `Ros2Network`, as a table in a world file.

    Raises MisuseError or BodiesError for options that are none.

    Attributes:
        fixed: by frames that never move, their parents and where they are on these.

    """

    def __init__(self, service: str, options: Mapping[str, Any]) -> None:
        known = [each.name for each in fields(Ros2Network)]
        for name in options:
            if name not in known:
                raise BodiesError(
                    f"{service}: ros2 has no {name!r}; it may have {', '.join(known)}"
                )
        if "router" not in options:
            raise BodiesError(f'{service}: ros2 lacks router, such as "tcp/127.0.0.1:7447"')
        self.network = Ros2Network(**options)
        self._service = service
        self._lock = threading.Lock()
        self._session: Ros2Session | None = None
        self._publishers: dict[str, TopicPublisher] = {}
        self.fixed: dict[str, tuple[str, Rigid]] = {}
        self._sent_fixed: dict[str, tuple[str, Rigid]] = {}
        self._link: NetworkLink | None = None

    def open(self) -> None:
        """Begin to connect, in a thread of its own. Raises MisuseError if rosbags is missing."""
        messages()
        node = f"minerva_{self._service}"
        self._link = NetworkLink(self.network, node, self._declare, lambda: None, _BEAT_SECONDS)
        self._link.start()

    def close(self) -> None:
        """Leave the network."""
        if self._link is not None:
            self._link.close()

    @property
    def state(self) -> str:
        """Of its link."""
        return self._link.state if self._link is not None else "not open yet"

    def send(self, made: Iterable[Made]) -> None:
        """Publish messages."""
        for topic, kind, message in made:
            publisher = self._publisher(topic, kind)
            if publisher is not None:
                publisher.put(message)

    def place(self, parent: str, frame: str, pose: Rigid) -> None:
        """Note where a frame is that never moves on its parent."""
        self.fixed[frame] = parent, pose

    def send_fixed(self, nanoseconds: int) -> None:
        """Publish the frames of `place`, if they are others than before."""
        if self.fixed == self._sent_fixed:
            return
        publisher = self._publisher(self.network.static_tf, TRANSFORMS)
        if publisher is not None:
            self._sent_fixed = dict(self.fixed)
            rows = [(parent, frame, pose) for frame, (parent, pose) in self.fixed.items()]
            publisher.put(transforms(rows, nanoseconds))

    def _publisher(self, topic: str, kind: str) -> TopicPublisher | None:
        with self._lock:
            if self._session is not None and topic not in self._publishers:
                qos = LASTING if topic == self.network.static_tf else DEFAULT
                try:
                    self._publishers[topic] = self._session.publisher(topic, kind, qos)
                except SourceError:  # The link makes a new session.
                    self._session = None
            return self._publishers.get(topic)

    def _declare(self, session: Ros2Session) -> None:
        with self._lock:
            self._session, self._publishers, self._sent_fixed = session, {}, {}


class SpaceNode(RosNode):
    """The node of the service `bodies`: simulated time, poses, joints and sensors."""

    def publish(
        self, engine: Any, data: Sequence[tuple[Sensor, Mapping[str, Any]]], nanoseconds: int
    ) -> None:
        """Send what a frame has brought.

        Args:
            engine: the space after a step.
            data: what sensors have measured.
            nanoseconds: simulated time.

        """
        for sensor, _ in data:
            frame = name_of(sensor.owner, sensor.symbol)
            self.place(name_of(sensor.owner), frame, sensor.mount)
        self.send_fixed(nanoseconds)
        bodies = [(WORLD, name_of(who), engine.pose(who)) for who in engine.bodies if who]
        made = [clock(nanoseconds)]
        if bodies:
            made.append((self.network.tf, TRANSFORMS, transforms(bodies, nanoseconds)))
        joints = [name for name, (_, plain) in engine.joints.items() if plain[0] in AXIAL]
        if joints:
            kinds = [engine.joints[name][1][0] for name in joints]
            # The name of a joint begins with its owner and its symbol.
            names = [name_of(*name.split("/")[:2]) for name in joints]
            made.append(joint_states(names, kinds, engine.positions(joints), nanoseconds))
        self.send([*made, *[sensed(sensor, each, nanoseconds) for sensor, each in data]])

    def publish_scans(self, scans: Iterable[Scan], height: float) -> None:
        """Send the scans of robots, whose lasers are at a height above the ground, metres."""
        for scan in scans:
            parent = name_of(scan.robot)
            self.place(parent, name_of(scan.robot, SCAN), Rigid(z=height))
            self.send_fixed(round(scan.time * 1e9))
            self.send([scanned(scan)])


@lru_cache(1 << 16)
def name_of(*parts: str) -> str:
    """A name for topics and frames of the parts, whose other characters become `_`."""
    return "/".join(re.sub(r"[^A-Za-z0-9_]", "_", part) for part in parts)


def transforms(rows: Iterable[tuple[str, str, Rigid]], nanoseconds: int) -> Any:
    """Poses of frames on their parents, each with the names of both."""
    types, placed, headers = messages(), list[Any](), dict[str, Any]()
    # Not by `built`, which would take long for thousands of bodies.
    for parent, frame, pose in rows:
        if parent not in headers:
            headers[parent] = types.header(parent, nanoseconds)
        turn = types.make("geometry_msgs/msg/Quaternion", x=pose.i, y=pose.j, z=pose.k, w=pose.w)
        at = types.make(
            "geometry_msgs/msg/Transform",
            translation=types.vector(pose.x, pose.y, pose.z), rotation=turn,
        )  # fmt: skip
        about = {"header": headers[parent], "child_frame_id": frame, "transform": at}
        placed.append(types.make("geometry_msgs/msg/TransformStamped", **about))
    return types.make(TRANSFORMS, transforms=placed)


def clock(nanoseconds: int) -> Made:
    """Simulated time."""
    return "/clock", CLOCK, built(CLOCK, {"clock": _stamp(nanoseconds)})


def joint_states(
    names: Sequence[str], kinds: Sequence[str], measured: NDArray[np.float64], nanoseconds: int
) -> Made:
    """Joints along or about an axis: positions and velocities (n, 2), in metres or degrees."""
    unit = np.array([1.0 if kind == "prismatic" else math.radians(1.0) for kind in kinds])
    position, velocity = (measured * unit[:, None]).T.tolist()
    about = {"name": list(names), "position": position, "velocity": velocity}
    header = {"header": _header("", nanoseconds)}
    return "/joint_states", JOINT_STATE, built(JOINT_STATE, header | about)


def sensed(sensor: Sensor, data: Mapping[str, Any], nanoseconds: int) -> Made:
    """What a sensor has measured, with all data that its event may have."""
    topic = name_of(sensor.owner, sensor.symbol)
    header = {"header": _header(topic, nanoseconds)}
    if sensor.kind == "imu":
        return f"/{topic}", IMU, built(IMU, header | _imu(data))
    if sensor.kind == "gps":
        position = Position(
            sensor.owner,
            data["latitude"],
            data["longitude"],
            data["altitude"],
            data["accuracy"],
            nanoseconds / 1e9,
        )
        return f"/{topic}", *message_of(position, messages().header(topic, nanoseconds))
    if sensor.kind == "distance":
        reach, _ = sensor.values
        about = {"radiation_type": _INFRARED, "max_range": reach, "range": data["dist"]}
        return f"/{topic}", RANGE, built(RANGE, header | about)
    return f"/{topic}", POINTS, _points(sensor, data, header)


def _imu(data: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "orientation_covariance": [_UNKNOWN, *[0.0] * 8],
        "linear_acceleration": {axis: data[f"a{axis}"] for axis in "xyz"},
        "angular_velocity": {axis: data[f"w{axis}"] for axis in "xyz"},
    }


def _points(sensor: Sensor, data: Mapping[str, Any], header: dict[str, Any]) -> Any:
    """A row of points for each ring; those of beams without a hit are NaN [REP 117]."""
    rings, beams, low, high, reach, _ = sensor.values
    ranges = np.array(data["ranges"])
    known = np.where(ranges < reach, ranges, np.nan)
    axes = ray_axes(int(rings), int(beams), low, high)
    rows = np.column_stack((axes * known[:, None], data["intensities"])).astype("<f4")
    columns = [
        {"name": name, "offset": 4 * place, "datatype": _FLOAT32, "count": 1}
        for place, name in enumerate(("x", "y", "z", "intensity"))
    ]
    about = {
        "height": int(rings),
        "width": int(beams),
        "fields": columns,
        "point_step": 16,
        "row_step": 16 * int(beams),
    }
    # Not by `built`, which would take long for bytes one by one.
    return replace(built(POINTS, header | about), data=np.frombuffer(rows.tobytes(), np.uint8))


def scanned(scan: Scan) -> Made:
    """A turn of a robot's laser, whose frame is `AGENT/scan`."""
    name, nanoseconds = name_of(scan.robot, SCAN), round(scan.time * 1e9)
    kind, message = message_of(scan, messages().header(name, nanoseconds))
    return f"/{name}", kind, message


def optical(mount: Rigid) -> Rigid:
    """The pose of a camera's optical frame on its agent."""
    return mount.then(_OPTICAL)


def pictured(image: Image, symbol: str, focal: float) -> list[Made]:
    """A picture, and the camera that has taken it; `focal` is in pixels."""
    name, nanoseconds = name_of(image.robot, symbol), round(image.time * 1e9)
    folder = f"/{name}/{'depth' if image.encoding == '32FC1' else 'color'}"
    size = {"width": image.width, "height": image.height}
    frame = f"{name}_optical"
    kind, picture = message_of(image, messages().header(frame, nanoseconds))
    # Of the middle pixels' centres, from 0.
    x, y = (image.width - 1) / 2, (image.height - 1) / 2
    lens = {
        "header": _header(frame, nanoseconds),
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [focal, 0.0, x, 0.0, focal, y, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [focal, 0.0, x, 0.0, 0.0, focal, y, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
    return [
        (f"{folder}/image_raw", kind, picture),
        (f"{folder}/camera_info", CAMERA_INFO, built(CAMERA_INFO, size | lens)),
    ]


def _stamp(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {"sec": seconds, "nanosec": rest}


def _header(frame: str, nanoseconds: int) -> dict[str, Any]:
    return {"stamp": _stamp(nanoseconds), "frame_id": frame}
