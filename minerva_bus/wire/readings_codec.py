"""Readings as plain data: section 11 of PROTOCOL.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.plain import as_int, as_list, as_number, as_text
from minerva_bus.world.readings import (
    ENCODINGS,
    Battery,
    Displacement,
    Image,
    Mount,
    Odometry,
    Position,
    Reading,
    Scan,
    Sighting,
    Sightings,
)

_DEPTHS: Final = {"rgb8": 3, "mono8": 1}


def plain_reading(reading: Reading) -> list[Any]:
    """A reading as plain data: its kind, robot and time, and its measurements."""
    kind, write = _WRITERS[type(reading)]
    # A scan with a beam time of 0 is sent as `scan` (PROTOCOL.md, section 11).
    if isinstance(reading, Scan) and reading.beam_time:
        return ["sweep", reading.robot, reading.time, *_write_sweep(reading)]
    return [kind, reading.robot, reading.time, *write(reading)]


def read_reading(plain: Any) -> Reading:
    """A reading from plain data. Raises ProtocolError."""
    items = as_list(plain, "a reading")
    known = _READERS.get(items[0] if items and isinstance(items[0], str) else "")
    if known is None:
        shown = str(items[0] if items else None)[:40]
        raise ProtocolError(f"no reading {shown!r}; expected {', '.join(_READERS)}")
    count, read = known
    if len(items) != count + 3:
        raise ProtocolError(f"a {items[0]} has {count + 3} items, not {len(items)}")
    return read(as_text(items[1], "the robot"), as_number(items[2], "the time"), items[3:])


def _write_scan(scan: Scan) -> list[Any]:
    return [
        np.ascontiguousarray(scan.ranges, "<f4").tobytes(),
        scan.first,
        scan.step,
        scan.range_max,
        [scan.mount_x, scan.mount_y, scan.mount_angle],
    ]


def _write_sweep(scan: Scan) -> list[Any]:
    path = [[place.seconds, place.x, place.y, place.angle] for place in scan.path]
    return [*_write_scan(scan), scan.beam_time, path]


def _write_image(image: Image) -> list[Any]:
    mount = image.mount
    return [image.encoding, image.width, image.height, image.data, [mount.x, mount.y, mount.angle]]


def _mount(plain: Any, what: str) -> Mount:
    mount = [as_number(item, "the mount") for item in as_list(plain, "the mount")]
    if len(mount) != 3:
        raise ProtocolError(f"the mount of {what} is [x, y, angle]")
    return Mount(*mount)


def _scan(robot: str, time: float, items: Sequence[Any]) -> Scan:
    data, mount = items[0], _mount(items[4], "a scan")
    if not isinstance(data, bytes) or len(data) % 4:
        raise ProtocolError("the ranges of a scan are float32 as bytes")
    first, step, most = (as_number(item, "a number of a scan") for item in items[1:4])
    ranges = np.frombuffer(data, "<f4")
    # The protocol defines values for beams without a hit, so a NaN is an error of the sensor.
    if np.isnan(ranges).any():
        raise ProtocolError("a range of a scan is not a number; 0 means that nothing was hit")
    if not step and len(ranges) > 1:
        raise ProtocolError("the beams of a scan are 0 degrees apart: all have one direction")
    if most <= 0:
        raise ProtocolError(f"the range_max of a scan is {most:g}; expected metres above 0")
    return Scan(robot, ranges, first, step, most, time, mount.x, mount.y, mount.angle)


def _sweep(robot: str, time: float, items: Sequence[Any]) -> Scan:
    beam_time = as_number(items[5], "the time of a beam")
    path = tuple([_displacement(place) for place in as_list(items[6], "the path of a scan")])
    seconds = [place.seconds for place in path]
    # Positions between two places are interpolated, which requires distinct ascending times.
    if sorted(set(seconds)) != seconds:
        raise ProtocolError("the seconds of the path of a scan must rise")
    return replace(_scan(robot, time, items), beam_time=beam_time, path=path)


def _displacement(plain: Any) -> Displacement:
    numbers = [
        as_number(item, "the path of a scan") for item in as_list(plain, "the path of a scan")
    ]
    if len(numbers) != 4:
        raise ProtocolError("a place of the path of a scan is [seconds, x, y, angle]")
    return Displacement(*numbers)


def _sightings(robot: str, time: float, items: Sequence[Any]) -> Sightings:
    seen = [as_list(item, "a sighting") for item in as_list(items[0], "sightings")]
    return Sightings(robot, tuple(map(_sighting, seen)), time)


def _sighting(items: list[Any]) -> Sighting:
    if len(items) != 3:
        raise ProtocolError("a sighting is [marker, distance, angle]")
    return Sighting(
        as_text(items[0], "the marker"),
        as_number(items[1], "a distance"),
        as_number(items[2], "an angle"),
    )


def _image(robot: str, time: float, items: Sequence[Any]) -> Image:
    encoding, data = as_text(items[0], "the encoding"), items[3]
    width, height = as_int(items[1], "the width", 1), as_int(items[2], "the height", 1)
    if encoding not in ENCODINGS:
        raise ProtocolError(f"no encoding {encoding[:40]!r}; expected {', '.join(ENCODINGS)}")
    if not isinstance(data, bytes):
        raise ProtocolError("the data of an image are bytes")
    if encoding in _DEPTHS and len(data) != width * height * _DEPTHS[encoding]:
        raise ProtocolError(f"{len(data)} bytes are no {encoding} image of {width}×{height} pixels")
    return Image(robot, data, encoding, width, height, time, _mount(items[4], "an image"))


def _odometry(robot: str, time: float, items: Sequence[Any]) -> Odometry:
    x, y, angle, speed, turn = (as_number(item, "odometry") for item in items)
    return Odometry(robot, x, y, angle, speed, turn, time)


def _battery(robot: str, time: float, items: Sequence[Any]) -> Battery:
    return Battery(robot, as_number(items[0], "the charge"), as_number(items[1], "the volts"), time)


def _position(robot: str, time: float, items: Sequence[Any]) -> Position:
    latitude, longitude = (as_number(degrees, "a position") for degrees in items[:2])
    altitude, accuracy = (_known_number(metres, "a position") for metres in items[2:])
    return Position(robot, latitude, longitude, altitude, accuracy, time)


def _known_number(plain: Any, what: str) -> float | None:
    """A finite number, or None for nil: the sensor does not report it. Raises ProtocolError."""
    return None if plain is None else as_number(plain, what)


_WRITERS: dict[type, tuple[str, Callable[[Any], list[Any]]]] = {
    Scan: ("scan", _write_scan),
    Sightings: ("sightings", lambda s: [[[o.marker, o.distance, o.angle] for o in s.seen]]),
    Image: ("image", _write_image),
    Odometry: ("odometry", lambda o: [o.x, o.y, o.angle, o.speed, o.turn]),
    Battery: ("battery", lambda b: [b.charge, b.volts]),
    Position: ("position", lambda p: [p.latitude, p.longitude, p.altitude, p.accuracy]),
}

_READERS: dict[str, tuple[int, Callable[[str, float, Sequence[Any]], Reading]]] = {
    "scan": (5, _scan),
    "sweep": (7, _sweep),
    "sightings": (1, _sightings),
    "image": (5, _image),
    "odometry": (5, _odometry),
    "battery": (2, _battery),
    "position": (4, _position),
}
