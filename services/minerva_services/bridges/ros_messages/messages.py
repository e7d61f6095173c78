"""ROS 2 messages to and from CDR, and type hashes."""

# rosbags creates message classes at run time, so their types are unknown statically.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
from __future__ import annotations

import math
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from minerva_services.bridges.ros_messages.frames import GarbageError
from minerva_services.options import require

if TYPE_CHECKING:
    from rosbags.interfaces import Nodetype
    from rosbags.typesys.store import Typestore

LASER_SCAN: Final = "sensor_msgs/msg/LaserScan"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
IMAGE: Final = "sensor_msgs/msg/Image"
COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
BATTERY: Final = "sensor_msgs/msg/BatteryState"
FIX: Final = "sensor_msgs/msg/NavSatFix"
POINTS: Final = "sensor_msgs/msg/PointCloud2"
RANGE: Final = "sensor_msgs/msg/Range"
DETECTIONS: Final = "vision_msgs/msg/Detection3DArray"
TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
TWIST: Final = "geometry_msgs/msg/Twist"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
POSE_STAMPED: Final = "geometry_msgs/msg/PoseStamped"
PATH: Final = "nav_msgs/msg/Path"
GRID: Final = "nav_msgs/msg/OccupancyGrid"
CLOCK: Final = "rosgraph_msgs/msg/Clock"

_VISION: Final = {
    DETECTIONS: "std_msgs/Header header\nDetection3D[] detections",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\nstring id"
    ),
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
}


class MessageTypes:
    """All supported message types. Raises MisuseError if a library is missing."""

    def __init__(self) -> None:
        require("ros2", "rosbags.typesys", "rosbags", "ros")
        require("ros2", "xxhash", "xxhash", "ros")
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._store = get_typestore(Stores.LATEST)
        types: dict[Any, Any] = {}
        for name, fields in _VISION.items():
            types |= get_types_from_msg(fields, name)
        self._store.register(types)

    @property
    def store(self) -> Typestore:
        """The types in the form of rosbags, for its writers."""
        return self._store

    def hash(self, message: str) -> str:
        """The hash of a message type [REP 2016], as `RIHS01_...`."""
        return self._store.hash_rihs01(message)

    def has_bytes(self, message: str) -> bool:
        """True if a message type, or a part of it, has a sequence of bytes, as an image has."""
        _, fields = self._store.fielddefs[message]
        return any(self._is_bytes(kind, of) for _, (kind, of) in fields)

    def _is_bytes(self, kind: Nodetype, of: Any) -> bool:
        # `of` is a basic type with a limit, the name of a message type, or an element with a size.
        if kind.name == "BASE":
            return False
        if kind.name == "NAME":
            return self.has_bytes(of)
        (element, type_of_element), _ = of
        is_uint8 = element.name == "BASE" and type_of_element[0] == "uint8"
        if is_uint8 and kind.name == "SEQUENCE":
            return True
        return self._is_bytes(element, type_of_element)

    def make(self, message: str, /, **fields: Any) -> Any:
        """A message with these fields; all are required."""
        return self._store.types[message](**fields)

    def encode(self, message: str, value: Any) -> bytes:
        """A message in CDR."""
        return bytes(self._store.serialize_cdr(value, message))

    def decode(self, message: str, data: bytes) -> Any:
        """A message from CDR, as it is today or was in Humble. Raises GarbageError."""
        try:
            return self._store.deserialize_cdr(data, message)
        except Exception as error:  # decoders raise many types for invalid bytes
            with suppress(Exception):
                return self._in_humble(message).deserialize_cdr(data, message)
            raise GarbageError(f"{len(data)} bytes are not a {message}") from error

    def _in_humble(self, message: str) -> Typestore:
        """The types of Humble, if a message has changed since. Raises KeyError if it has not."""
        store = _humble()
        if store.hash_rihs01(message) == self.hash(message):
            raise KeyError(message)
        return store

    # --- parts shared by several messages ---

    def time(self, nanoseconds: int) -> Any:
        """A Time."""
        seconds, rest = divmod(nanoseconds, 1_000_000_000)
        return self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)

    def header(self, frame: str, nanoseconds: int) -> Any:
        """A header with a frame and a time since 1970."""
        return self.make("std_msgs/msg/Header", stamp=self.time(nanoseconds), frame_id=frame)

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        """A Vector3."""
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def pose(self, x: float, y: float, degrees: float = 0.0) -> Any:
        """A Pose in the plane."""
        half = math.radians(degrees) / 2
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
            orientation=self.make(
                "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)
            ),
        )

    def transform(self, header: Any, child: str, x: float, y: float, degrees: float) -> Any:
        """A TransformStamped in the plane."""
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=header,
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.vector(x, y), rotation=self.pose(x, y, degrees).orientation,
            ),
        )  # fmt: skip

    def twist(self, speed: float, turn: float) -> Any:
        """A Twist of a planar robot: metres and degrees per second."""
        return self.make(
            TWIST, linear=self.vector(speed), angular=self.vector(z=math.radians(turn))
        )


@cache
def _humble() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def messages() -> MessageTypes:
    """The message types, created once."""
    return MessageTypes()
