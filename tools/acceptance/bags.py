"""Bags of ROS: topics and types as in the metadata of those of rosbag2, readings of one of SICK."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from minerva_bus.log.recordings import RecordingError
from minerva_bus.world.readings import Scan
from minerva_services.bridges.ros_messages.ranges import HeightBand
from minerva_services.bridges.rosbag.bag import Bag, open_bag
from tools.acceptance.suite import Outcome, Result, Suite, judged, whole_files

_FORMAT = re.compile(r"serialization_format: (\S+)")
_TOPIC = re.compile(r"name: (/\S+)\n\s+type: (\S+)")


def _problems(folder: Path) -> Iterator[str]:
    (bag,) = whole_files([*folder.glob("*.mcap"), *folder.glob("*.db3")])
    metadata = (folder / "metadata.yaml").read_text(encoding="utf-8")
    for path in (folder, bag):
        try:
            open_bag(path, lambda *_: None).close()
        except RecordingError as error:
            others = {name for name in _FORMAT.findall(metadata) if name != "cdr"}
            if path == folder and others:  # The metadata, but not the files, say that.
                wanted = others
            else:
                wanted = {f"{topic} ({kind})" for topic, kind in _TOPIC.findall(metadata)}
            reason = str(error).removeprefix(f"{path}: ")
            yield from (
                f"no {name}: {reason:.120}" for name in sorted(wanted) if name not in reason
            )
        else:
            yield f"{path.name}: it has a topic to play"


def _results(folder: Path) -> Iterator[Result]:
    for metadata in sorted(folder.rglob("metadata.yaml")):
        bag = metadata.parent
        yield judged(f"{bag.parent.name}/{bag.name}", _problems(bag))


ROSBAG2 = Suite(
    "rosbag2",
    "ros2/rosbag2",
    "rosbag2_tests/resources",
    "the reader of bags: topics and types, from the folder and from the file",
    _results,
)

BAND = 0.5
"""Heights of the points of a cloud that are obstacles, in metres from its sensor."""

NO_PLACE = "the bag does not say where the sensor is on the vehicle: it is refused"
RAW = "a capture of the sensor's own protocol, which its driver reads: the bridges read the driver"


def _scan_problems(bag: Path, topic: str) -> Iterator[str]:
    """What differs in the scans of a bag from its messages."""
    from rosbags.highlevel import AnyReader

    with AnyReader([bag]) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == topic]
        messages: list[Any] = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages(chosen)
        ]
    played = Bag(bag, lambda *_: None, topics={topic: "scan"}, band=HeightBand(-BAND, BAND))
    scans = [recorded.reading for recorded in played.readings()]
    played.close()
    if len(scans) != len(messages):
        yield f"{len(scans)} scans of {len(messages)} messages"
    for number, (scan, message) in enumerate(zip(scans, messages, strict=False)):
        assert isinstance(scan, Scan)
        if hasattr(message, "point_step"):
            ranges = _nearest(message, scan)
            wanted = [-np.pi, 2 * np.pi / len(ranges)]
        else:
            # A shorter range is no measurement.
            ranges = np.where(message.ranges < message.range_min, 0.0, message.ranges)
            wanted = [message.angle_min, message.angle_increment]
        angles = np.radians([scan.first, scan.step])
        if not np.array_equal(ranges, scan.ranges) or not np.allclose(angles, wanted, atol=1e-6):
            yield f"scan {number} differs"


def _nearest(message: Any, scan: Scan) -> Any:
    """The range of the nearest point of a cloud by direction; its sensor is in the middle."""
    ranges: dict[int, float] = {}
    data = message.data.tobytes()
    for at in range(0, message.width * message.point_step, message.point_step):
        x, y, z = struct.unpack_from("<fff", data, at)
        far = math.hypot(x, y)
        if 0 < far <= scan.range_max and abs(z) <= BAND:
            beam = round((math.degrees(math.atan2(y, x)) - scan.first) / scan.step)
            ranges[beam] = min(far, ranges.get(beam, far))
    return np.array([ranges.get(beam, 0.0) for beam in range(len(scan.ranges))], np.float32)


def _sick_results(repository: Path) -> Iterator[Result]:
    for bag in whole_files(repository.rglob("*.bag")):
        yield judged(f"{bag.name}: /sick_lms_1xx/scan", _scan_problems(bag, "/sick_lms_1xx/scan"))
        for topic in ("/cloud", "/cloud_radar_track", "/cloud_radar_rawtarget"):
            try:
                problems = [*_scan_problems(bag, topic)]
            except RecordingError as error:
                refused = "no transform from" in str(error)
                yield judged(f"{bag.name}: {topic}", [str(error)], NO_PLACE if refused else "")
            else:
                yield judged(f"{bag.name}: {topic}", problems)
    for capture in sorted(repository.rglob("*.pcapng.json")):
        yield Result(capture.name, Outcome.EXPECTED, RAW)


SICK = Suite(
    "sick",
    "SICKAG/sick_scan_xd",
    ".",
    "the bridge `rosbag`: scans of a bag of ROS 1 that the driver of SICK's sensors has published",
    _sick_results,
)
