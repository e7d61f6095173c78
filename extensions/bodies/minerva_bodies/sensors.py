"""Sensors in space, declared by the symbols of a vocabulary, and what they measure.

    PScanner = Primitive("PScanner", Lidar(rings=16, beams=360, low=-15, high=15))

A sensor is a figure within its agent's view, at the place of its mount: x points ahead, z up. The
service `bodies` measures after each step of physics, and notifies the agent by an event of the type
that its option of the sensor's name gives; the event's `sensor` is the figure's symbol. Random
errors come from the stream keyed by (seed, service/agent/sensor, frame).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.errors import BodiesError
from minerva_bodies.rigid import Rigid
from minerva_bus import portable
from minerva_bus.grammar.appearance import Disc, Measure
from minerva_bus.portable import normals
from minerva_bus.world.context import stream
from minerva_bus.world.services import Tick

SENSORS = {
    "lidar": ("sensor", "ranges", "intensities"),
    "imu": ("sensor", "ax", "ay", "az", "wx", "wy", "wz"),
    "distance": ("sensor", "dist"),
    "gps": ("sensor", "latitude", "longitude", "altitude", "accuracy"),
}
"""Sensors by name, with the data that their events may have."""
MAX_RAYS = 100_000
_Vector = tuple[float, float, float]
_EQUATOR, _FLATTENING = 6378137.0, 1 / 298.257223563
"""Of WGS 84: radius in metres, and 1 - the ratio of the axes."""


def Lidar(
    rings: int = 1,
    beams: int = 360,
    *,
    low: Measure = 0.0,
    high: Measure = 0.0,
    reach: Measure = 30.0,
    noise: Measure = 0.0,
    color: str = "#222222",
    meaning: str = "",
) -> Disc:
    """A range finder that turns about its z axis, with one ring or more.

    Its event has `ranges`, metres for rings × beams: the lowest ring first, and in each the beam
    ahead first, counter-clockwise. A beam without a hit has the range `reach`. `intensities` are
    cosines of the angles at which beams meet a surface, 0 without a hit.

    Args:
        rings: number of rings.
        beams: number of beams of each ring.
        low: elevation of the lowest ring, degrees.
        high: of the highest ring; a single ring has `low`.
        reach: longest range, metres.
        noise: standard deviation of ranges, metres.
        color: of its mark.
        meaning: text of the legend.

    """
    if rings < 1 or beams < 1 or rings * beams > MAX_RAYS:
        raise BodiesError(
            f"Lidar: {rings} rings of {beams} beams; expected 1 or more, {MAX_RAYS} in all at most"
        )
    return _sensor("lidar", color, meaning, rings, beams, low, high, reach, noise)


def Imu(
    *,
    noise: Measure = 0.0,
    bias: Measure = 0.0,
    spin_noise: Measure = 0.0,
    spin_bias: Measure = 0.0,
    color: str = "#222222",
    meaning: str = "",
) -> Disc:
    """An inertial unit: the specific force and the angular rate along its axes.

    Its event has `ax`, `ay` and `az` (m/s²: the mean acceleration in the frame without gravity, so
    9.81 upwards at rest), and `wx`, `wy` and `wz` (rad/s). It measures from a body's second frame
    on. A bias is drawn once in a run for each axis.

    Args:
        noise: standard deviation of specific forces, m/s².
        bias: of their biases.
        spin_noise: of angular rates, rad/s.
        spin_bias: of their biases.
        color: of its mark.
        meaning: text of the legend.

    """
    return _sensor("imu", color, meaning, noise, bias, spin_noise, spin_bias)


def Distance(
    reach: Measure = 5.0, *, noise: Measure = 0.0, color: str = "#222222", meaning: str = ""
) -> Disc:
    """A beam along x; its event has `dist`, in metres, which is `reach` without a hit.

    Args:
        reach: longest range, metres.
        noise: standard deviation, metres.
        color: of its mark.
        meaning: text of the legend.

    """
    return _sensor("distance", color, meaning, reach, noise)


def Gps(
    latitude: Measure,
    longitude: Measure,
    altitude: Measure = 0.0,
    *,
    noise: Measure = 0.0,
    noise_up: Measure = 0.0,
    color: str = "#222222",
    meaning: str = "",
) -> Disc:
    """A receiver of satellite navigation; x points east, y north.

    Its event has the data of the reading `Position`: `latitude` and `longitude` (degrees of WGS
    84), `altitude` (m above the ellipsoid) and `accuracy` (m, the standard deviation `noise`).

    Args:
        latitude: of the world's origin, degrees north.
        longitude: of the origin, degrees east.
        altitude: of the origin, metres.
        noise: standard deviation to the east and to the north, metres.
        noise_up: of the altitude, metres.
        color: of its mark.
        meaning: text of the legend.

    """
    return _sensor("gps", color, meaning, latitude, longitude, altitude, noise, noise_up)


def _sensor(kind: str, color: str, meaning: str, *measures: Measure) -> Disc:
    return Disc(0.05, color, height=0.05, meaning=meaning, spatial=(kind, *measures))


class Sensor(NamedTuple):
    """A sensor that a view shows: its mount is a pose in the body of its owner."""

    kind: str
    owner: str
    symbol: str
    mount: Rigid
    values: Sequence[float]


def check_sensor(sensor: Sensor) -> None:
    """Raise BodiesError for a sensor without an agent, or with measures that mean nothing."""
    where, values = f"agent {sensor.owner}, {sensor.symbol}", sensor.values
    if not sensor.owner:
        raise BodiesError(
            f"{sensor.symbol}: a sensor notifies its agent, and scenery has none; put it in the"
            " view of an agent"
        )
    reach = {"lidar": 4, "distance": 0}.get(sensor.kind)
    if reach is not None and not values[reach] > 0.0:
        raise BodiesError(f"{where}: it reaches {values[reach]:g} m; expected metres above 0")
    if sensor.kind == "gps" and not (abs(values[0]) <= 90.0 and abs(values[1]) <= 180.0):
        raise BodiesError(
            f"{where}: the origin is at latitude {values[0]:g}, longitude {values[1]:g}; expected"
            " degrees up to 90 and 180"
        )
    errors = values if sensor.kind == "imu" else values[-2 if sensor.kind == "gps" else -1 :]
    if any(error < 0.0 for error in errors):
        raise BodiesError(f"{where}: standard deviations {errors}; expected numbers from 0")


class Motions:
    """Velocities of the points where inertial units are, before a step of physics."""

    def __init__(self, engine: Any, sensors: Sequence[Sensor]) -> None:
        self.speeds: dict[tuple[str, str, Rigid], _Vector] = {
            sensor[1:4]: engine.velocity(sensor.owner, sensor.mount)
            for sensor in sensors
            if sensor.kind == "imu" and sensor.owner in engine.bodies
        }


def measured(
    sensor: Sensor, engine: Any, before: Motions, tick: Tick, names: Sequence[str], gravity: float
) -> Mapping[str, Any] | None:
    """The data of a sensor's event; None if there is nothing to measure yet.

    Args:
        sensor: one of a body that exists.
        engine: the space after a step.
        before: velocities before it.
        tick: of the frame.
        names: the data that the event type declares.
        gravity: m/s², downwards.

    """
    values: dict[str, Any] = {"sensor": sensor.symbol}
    pose = engine.pose(sensor.owner).then(sensor.mount)
    if sensor.kind == "imu":
        if sensor[1:4] not in before.speeds:
            return None
        values |= _inertia(sensor, engine, before, tick, pose, gravity)
    elif sensor.kind == "gps":
        *origin, noise, noise_up = sensor.values
        place = np.array((pose.x, pose.y, pose.z))
        if noise or noise_up:
            place += normals(_stream(sensor, tick, tick.number), 3) * (noise, noise, noise_up)
        fix = zip(SENSORS["gps"][1:4], geodetic(origin, place.tolist()), strict=True)
        values |= {**dict(fix), "accuracy": noise}
    else:
        rings, beams, low, high, reach, noise = (
            sensor.values if sensor.kind == "lidar" else (1, 1, 0.0, 0.0, *sensor.values)
        )
        along = np.column_stack(pose.turned(*ray_axes(int(rings), int(beams), low, high).T))
        start = (pose.x, pose.y, pose.z)
        is_lit = "intensities" in names
        ranges: NDArray[np.float64]
        ranges, lit = engine.echoes(start, along, reach, sensor.owner, is_lit)
        if noise:
            errors = normals(_stream(sensor, tick, tick.number), len(ranges), noise)
            noisy = np.clip(ranges + errors, 0.0, reach)
            ranges = np.where(ranges < reach, noisy, ranges)
        metres: list[float] = ranges.tolist()
        values |= {"ranges": tuple(metres), "dist": metres[0], "intensities": lit}
    return {name: values[name] for name in names}


def geodetic(origin: Sequence[float], place: Sequence[float]) -> _Vector:
    """Latitude, longitude (degrees) and altitude (m) of a place east, north and up of an origin.

    By Bowring's formula (Survey Review 181, 1976), to less than a millimetre near the ground.
    """
    square = _FLATTENING * (2.0 - _FLATTENING)
    (cos, sin), (east_x, east_y) = [portable.cos_sin(math.radians(angle)) for angle in origin[:2]]
    normal = _EQUATOR / math.sqrt(1.0 - square * sin * sin)
    x, y, z = place
    out = (normal + origin[2] + z) * cos - sin * y
    at_x, at_y = east_x * out - east_y * x, east_y * out + east_x * x
    up = (normal * (1.0 - square) + origin[2] + z) * sin + cos * y
    flat, axis = portable.hypot(at_x, at_y), _EQUATOR * (1.0 - _FLATTENING)
    length = portable.hypot(up * _EQUATOR, flat * axis)
    rise, run = up * _EQUATOR / length, flat * axis / length
    latitude = portable.atan2(
        up + square / (1.0 - square) * axis * rise * rise * rise,
        flat - square * _EQUATOR * run * run * run,
    )
    cos, sin = portable.cos_sin(latitude)
    altitude = flat * cos + up * sin - _EQUATOR * math.sqrt(1.0 - square * sin * sin)
    return math.degrees(latitude), math.degrees(portable.atan2(at_y, at_x)), altitude


def _inertia(
    sensor: Sensor, engine: Any, before: Motions, tick: Tick, pose: Rigid, gravity: float
) -> dict[str, float]:
    fast = engine.velocity(sensor.owner, sensor.mount)
    x, y, z = [(b - a) / tick.dt for a, b in zip(before.speeds[sensor[1:4]], fast, strict=True)]
    back = pose.inverse()
    exact = np.array((*back.turned(x, y, z + gravity), *back.turned(*engine.spin(sensor.owner))))
    noise, bias, spin_noise, spin_bias = sensor.values
    if noise or spin_noise:
        exact += normals(_stream(sensor, tick, tick.number), 6) * np.repeat((noise, spin_noise), 3)
    if bias or spin_bias:
        # Frame 0 has no measurements, so its stream is free for what is drawn once.
        exact += normals(_stream(sensor, tick, 0), 6) * np.repeat((bias, spin_bias), 3)
    return dict(zip(SENSORS["imu"][1:], exact.tolist(), strict=True))


def _stream(sensor: Sensor, tick: Tick, frame: int) -> np.random.Generator:
    return stream(tick.frame.seed, f"{tick.who}/{sensor.owner}/{sensor.symbol}", frame)


@lru_cache(maxsize=16)
def ray_axes(rings: int, beams: int, low: float, high: float) -> NDArray[np.float64]:
    """Directions of the rays along the axes of a sensor, shape (rings · beams, 3)."""
    step = (high - low) / (rings - 1) if rings > 1 else 0.0
    up = np.radians(low + step * np.arange(rings))
    around = 2.0 * math.pi / beams * np.arange(beams)
    flat, rise = portable.cos_sin(np.repeat(up, beams))
    cos, sin = portable.cos_sin(np.tile(around, rings))
    return np.column_stack((flat * cos, flat * sin, rise))
