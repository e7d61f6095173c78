"""Raw sensor data in a record: lossless messages for replay, and messages for other tools.

    topic = ["topic", name, member, frame, [reading, ...]]      as on the bus (PROTOCOL.md)
          | ["dropped", count]                                  number of missing messages

`frame` is -1 for free-running members.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.messages import Readings
from minerva_bus.log.showing import GROUND, pose_of, time_stamp
from minerva_bus.wire.message_limits import ON_DISK
from minerva_bus.wire.plain import as_int, as_list, as_text, pack, unpack
from minerva_bus.wire.readings_codec import plain_reading, read_reading
from minerva_bus.world.readings import Image, Mount, Odometry, Position, Reading, Scan


@dataclass(frozen=True, slots=True)
class Dropped:
    """Number of messages on topics that arrived faster than they could be written."""

    count: int


def encode_readings(message: Readings) -> bytes:
    """Readings of a topic as bytes."""
    readings = [plain_reading(reading) for reading in message.readings]
    return pack(["topic", message.topic, message.member, message.frame, readings])


def encode_dropped(count: int) -> bytes:
    """A number of missing messages as bytes."""
    return pack(["dropped", count])


def decode_sensed(data: bytes) -> Readings | Dropped:
    """A message of the channel of topics. Raises ProtocolError."""
    items = as_list(unpack(data, ON_DISK), "a message of a topic")
    if items[:1] == ["dropped"] and len(items) == 2:
        return Dropped(as_int(items[1], "a count"))
    if items[:1] != ["topic"] or len(items) != 5:
        raise ProtocolError("a message of a topic has 5 items and begins with its name")
    readings = tuple([read_reading(reading) for reading in as_list(items[4], "readings")])
    return Readings(
        as_text(items[2], "a member"),
        as_text(items[1], "a topic"),
        as_int(items[3], "the frame", -1),
        readings,
    )


# --- for other tools ---


def shown_readings(message: Readings, time: int) -> Iterator[tuple[str, bytes]]:
    """Schema and JSON message of each reading of a kind that has a schema."""
    for reading in message.readings:
        shown = _shown(reading, time)
        if shown is not None:
            schema, plain = shown
            # `allow_nan=False`, because NaN and Infinity are not JSON, and
            # other tools would reject the file.
            yield schema, json.dumps(plain, separators=(",", ":"), allow_nan=False).encode()


def encode_transform(robot: str, time: int, x: float, y: float, angle: float) -> bytes:
    """Pose of a robot at which its sensor data are shown, in metres and degrees."""
    pose = pose_of(x, y, angle)
    plain = {
        "timestamp": time_stamp(time),
        "parent_frame_id": GROUND,
        "child_frame_id": robot,
        "translation": pose["position"],
        "rotation": pose["orientation"],
    }
    return json.dumps(plain, separators=(",", ":")).encode()


def _shown(reading: Reading, time: int) -> tuple[str, dict[str, Any]] | None:
    about: dict[str, Any] = {"timestamp": time_stamp(time), "frame_id": reading.robot or GROUND}
    if isinstance(reading, Scan):
        return "foxglove.LaserScan", about | _scan(reading)
    if isinstance(reading, Image):
        return _image(reading, about)
    if isinstance(reading, Odometry):
        about["frame_id"] = f"{reading.robot}/odometry"
        about["pose"] = pose_of(reading.x, reading.y, reading.angle)
        return "foxglove.PoseInFrame", about
    if isinstance(reading, Position):
        return "foxglove.LocationFix", about | _location(reading)
    return None


_UNKNOWN, _APPROXIMATED = 0, 1
"""Types of covariance in foxglove.LocationFix."""


def _location(position: Position) -> dict[str, Any]:
    """A position; an unknown altitude is 0, because the schema requires a number."""
    return {
        "latitude": position.latitude,
        "longitude": position.longitude,
        "altitude": position.altitude or 0.0,
        "position_covariance": _covariance(position.accuracy or 0.0),
        "position_covariance_type": _UNKNOWN if position.accuracy is None else _APPROXIMATED,
    }


def _covariance(accuracy: float) -> Sequence[float]:
    variance = accuracy * accuracy
    return [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance]


def _scan(scan: Scan) -> dict[str, Any]:
    last = scan.first + scan.step * (len(scan.ranges) - 1)
    ranges: list[float] = scan.ranges.astype("f8").tolist()
    return {
        "pose": _mounted(Mount(scan.mount_x, scan.mount_y, scan.mount_angle)),
        "start_angle": math.radians(scan.first),
        "end_angle": math.radians(last),
        # JSON has no infinity; 0 also means no hit.
        "ranges": [value if math.isfinite(value) else 0.0 for value in ranges],
        "intensities": [],
    }


def _mounted(mount: Mount) -> Mapping[str, Any]:
    return pose_of(mount.x, mount.y, mount.angle)


_STEPS: Final = {"rgb8": 3, "mono8": 1}


def _image(image: Image, about: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    about["data"] = base64.b64encode(image.data).decode()
    step = _STEPS.get(image.encoding)
    if step is None:
        return "foxglove.CompressedImage", about | {"format": image.encoding}
    return "foxglove.RawImage", about | {
        "width": image.width,
        "height": image.height,
        "encoding": image.encoding,
        "step": step * image.width,
    }
