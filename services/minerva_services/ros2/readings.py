"""Readings made of ROS 2 messages: pure functions, units of REP 103 to ours."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from minerva_bus.world.readings import (
    CENTRE,
    Battery,
    Image,
    Mount,
    Odometry,
    Scan,
    Sighting,
    Sightings,
)
from minerva_services.ros2.frames import Matrix, Mounting
from minerva_services.ros2.messages import GarbageError, seconds
from minerva_services.ros2.plane import Pose, heading

_ENCODINGS: Final = {"rgb8": (3, "rgb8"), "bgr8": (3, "rgb8"), "mono8": (1, "mono8")}
_FILES: Final = ((b"\xff\xd8", "jpeg"), (b"\x89PNG", "png"))


def scan_of(message: Any, robot: str, mounting: Mounting) -> Scan:
    """A LaserScan: what is too near, or no number, hit nothing. Raises GarbageError."""
    ranges = np.asarray(message.ranges, np.float32)
    most, step = float(message.range_max), math.degrees(message.angle_increment)
    if not (math.isfinite(most) and math.isfinite(step) and math.isfinite(message.angle_min)):
        raise GarbageError("a LaserScan whose range or angles are no numbers")
    valid = np.isfinite(ranges) & (ranges >= message.range_min)
    # Beyond the range is what hit nothing [REP 117]; NaN and what is too near are errors.
    ranges = np.where(valid, ranges, np.where(np.isposinf(ranges), np.float32(most), 0))
    first, mount = math.degrees(message.angle_min), mounting.mount
    if mounting.flipped:
        first, step = -first, -step
    return Scan(
        robot, ranges.astype(np.float32), first, step, most, seconds(message.header.stamp),
        mount.x, mount.y, mount.angle,
    )  # fmt: skip


def odometry_of(message: Any, robot: str) -> Odometry:
    """An Odometry: the pose in the frame of odometry, speeds in that of the robot."""
    pose, twist = pose_of(message.pose.pose), message.twist.twist
    turn = math.degrees(twist.angular.z)
    time = seconds(message.header.stamp)
    return Odometry(robot, pose.x, pose.y, pose.angle, float(twist.linear.x), turn, time)


def pose_of(message: Any) -> Pose:
    """A Pose in the plane. Raises GarbageError where it is none."""
    place = message.position
    pose = Pose(float(place.x), float(place.y), heading(message.orientation))
    if not all(map(math.isfinite, (pose.x, pose.y, pose.angle))):
        raise GarbageError("a pose that is not finite")
    return pose


def battery_of(message: Any, robot: str) -> Battery:
    """A BatteryState; one that does not know its charge has none. Raises GarbageError."""
    charge, volts = float(message.percentage), float(message.voltage)
    if not math.isfinite(charge):
        raise GarbageError("a BatteryState without a percentage")
    volts = volts if math.isfinite(volts) else 0.0
    return Battery(robot, min(1.0, max(0.0, charge)), volts, seconds(message.header.stamp))


def image_of(message: Any, robot: str, mount: Mount = CENTRE) -> Image:
    """An Image in rgb8, bgr8 or mono8. Raises GarbageError for others."""
    depth, encoding = _ENCODINGS.get(message.encoding, (0, ""))
    if not depth:
        raise GarbageError(f"an Image in {message.encoding[:20]!r}; expected rgb8, bgr8 or mono8")
    height, width, step = message.height, message.width, message.step
    data = np.asarray(message.data, np.uint8)
    if not (width and height) or step < width * depth or data.size < height * step:
        raise GarbageError(f"an Image of {data.size} bytes for {width} × {height} pixels")
    rows = data[: height * step].reshape(height, step)[:, : width * depth]
    if message.encoding == "bgr8":
        rows = rows.reshape(height, width, 3)[:, :, ::-1]
    time = seconds(message.header.stamp)
    return Image(robot, rows.tobytes(), encoding, width, height, time, mount)


def file_of(message: Any, robot: str, mount: Mount = CENTRE) -> Image:
    """A CompressedImage that is a JPEG or a PNG. Raises GarbageError for others."""
    data = bytes(message.data)
    kind = next((name for start, name in _FILES if data.startswith(start)), "")
    size = (_jpeg_size if kind == "jpeg" else _png_size)(data) if kind else None
    if size is None:
        raise GarbageError(f"a CompressedImage in {message.format[:20]!r} is no JPEG or PNG")
    return Image(robot, data, kind, *size, seconds(message.header.stamp), mount)


def sightings_of(message: Any, robot: str, placed: Matrix) -> Sightings:
    """A Detection3DArray: each detection's likeliest class is a marker's name, its pose a place.

    `placed` is the transform from the message's frame to the robot, 4 x 4. Raises GarbageError.
    """
    seen = [_sighting(one, placed) for one in message.detections if len(one.results)]
    return Sightings(robot, tuple(seen), seconds(message.header.stamp))


def _sighting(detection: Any, placed: Matrix) -> Sighting:
    best = max(detection.results, key=lambda one: one.hypothesis.score)
    place = best.pose.pose.position
    x, y, _, _ = (placed @ np.array([place.x, place.y, place.z, 1.0])).tolist()
    if not (math.isfinite(x) and math.isfinite(y)):
        raise GarbageError("a detection that is nowhere")
    return Sighting(best.hypothesis.class_id, math.hypot(x, y), math.degrees(math.atan2(y, x)))


def _png_size(data: bytes) -> tuple[int, int] | None:
    size = int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    return size if len(data) >= 24 and all(size) else None


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Width and height from the frame header [ITU-T T.81, B.2.2]."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4])
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            size = int.from_bytes(data[at + 7 : at + 9]), int.from_bytes(data[at + 5 : at + 7])
            return size if all(size) else None
        at += 2 + length
    return None
