"""Readings as ROS 2 messages, the inverse of the other conversions here."""

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
    Position,
    Reading,
    Scan,
    Sighting,
)
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages

_NAN: Final = math.nan
_APPROXIMATED: Final = 1
_COVARIANCE: Final = 36


def mount_of(reading: Reading) -> Mount:
    """The pose of the sensor on its robot."""
    if isinstance(reading, Scan):
        return Mount(reading.mount_x, reading.mount_y, reading.mount_angle)
    return reading.mount if isinstance(reading, Image) else CENTRE


def message_of(reading: Reading, header: Any) -> tuple[str, Any]:
    """The type of a reading's message, and the message."""
    if isinstance(reading, Scan):
        return types.LASER_SCAN, _scan(reading, header)
    if isinstance(reading, Image):
        return _image(reading, header)
    if isinstance(reading, Odometry):
        return types.ODOMETRY, _odometry(reading, header)
    if isinstance(reading, Battery):
        return types.BATTERY, _battery(reading, header)
    if isinstance(reading, Position):
        return types.FIX, _position(reading, header)
    detections = [_detection(sighting, header) for sighting in reading.seen]
    return types.DETECTIONS, messages().make(types.DETECTIONS, header=header, detections=detections)


def _scan(scan: Scan, header: Any) -> Any:
    ranges = np.asarray(scan.ranges, np.float32)
    # REP 117: infinity means no obstacle in range, NaN no measurement.
    measured = np.where(ranges >= scan.range_max, np.float32(math.inf), ranges)
    ranges = np.where(ranges > 0, measured, np.float32(_NAN)).astype(np.float32)
    last = scan.first + scan.step * (len(ranges) - 1)
    return messages().make(
        types.LASER_SCAN,
        header=header,
        angle_min=math.radians(scan.first),
        angle_max=math.radians(last),
        angle_increment=math.radians(scan.step),
        time_increment=scan.beam_time,
        scan_time=scan.beam_time * len(ranges),
        range_min=0.0,
        range_max=scan.range_max,
        ranges=ranges,
        intensities=np.empty(0, np.float32),
    )


_PIXEL_BYTES: Final = {"rgb8": 3, "mono8": 1, "32FC1": 4}


def _image(image: Image, header: Any) -> tuple[str, Any]:
    data = np.frombuffer(image.data, np.uint8)
    pixel = _PIXEL_BYTES.get(image.encoding)
    if pixel is None:
        compressed = messages().make(
            types.COMPRESSED, header=header, format=image.encoding, data=data
        )
        return types.COMPRESSED, compressed
    raw = messages().make(
        types.IMAGE, header=header, height=image.height, width=image.width,
        encoding=image.encoding, is_bigendian=0, step=pixel * image.width, data=data,
    )  # fmt: skip
    return types.IMAGE, raw


def _odometry(odometry: Odometry, header: Any) -> Any:
    make, unknown = messages().make, np.zeros(_COVARIANCE)
    header = make("std_msgs/msg/Header", stamp=header.stamp, frame_id=f"{odometry.robot}/odom")
    pose = messages().pose(odometry.x, odometry.y, odometry.angle)
    twist = messages().twist(odometry.speed, odometry.turn)
    return make(
        types.ODOMETRY,
        header=header,
        child_frame_id=odometry.robot,
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )


def _battery(battery: Battery, header: Any) -> Any:
    none = np.empty(0, np.float32)
    return messages().make(
        types.BATTERY, header=header, voltage=battery.volts or _NAN, temperature=_NAN,
        current=_NAN, charge=_NAN, capacity=_NAN, design_capacity=_NAN, percentage=battery.charge,
        power_supply_status=0, power_supply_health=0, power_supply_technology=0, present=True,
        cell_voltage=none, cell_temperature=none, location="", serial_number="",
    )  # fmt: skip


def _position(position: Position, header: Any) -> Any:
    known = position.accuracy is not None
    return messages().make(
        types.FIX,
        header=header,
        status=messages().make("sensor_msgs/msg/NavSatStatus", status=0, service=1),
        latitude=position.latitude,
        longitude=position.longitude,
        altitude=_NAN if position.altitude is None else position.altitude,
        position_covariance=(np.eye(3) * (position.accuracy or 0.0) ** 2).ravel(),
        position_covariance_type=_APPROXIMATED if known else 0,
    )


def _detection(sighting: Sighting, header: Any) -> Any:
    make, turn = messages().make, math.radians(sighting.angle)
    at = messages().pose(sighting.distance * math.cos(turn), sighting.distance * math.sin(turn))
    result = make(
        "vision_msgs/msg/ObjectHypothesisWithPose",
        hypothesis=make("vision_msgs/msg/ObjectHypothesis", class_id=sighting.marker, score=1.0),
        pose=make(
            "geometry_msgs/msg/PoseWithCovariance", pose=at, covariance=np.zeros(_COVARIANCE)
        ),
    )
    box = make("vision_msgs/msg/BoundingBox3D", center=at, size=messages().vector())
    return make("vision_msgs/msg/Detection3D", header=header, results=[result], bbox=box, id="")


def frame_of(reading: Reading, topic: str) -> str:
    """The frame of reference of a reading: its sensor if that has a mount, or its robot."""
    if not isinstance(reading, Scan | Image):
        return reading.robot
    return f"{reading.robot}/{topic}" if reading.robot else topic
