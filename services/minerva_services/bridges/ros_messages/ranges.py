"""Point clouds as scans and as points, and scans from single ranges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Scan
from minerva_services.bridges.ros_messages.frames import GarbageError, Matrix, SensorMount
from minerva_services.bridges.ros_messages.readings import stamp_of

_FORMATS: Final = {7: "f4", 8: "f8"}
"""Types of coordinates, by the number that a PointField has for them."""

_BEAMS: Final = 360
_FARTHEST: Final = 1e9
"""Metres along an axis; squares of larger numbers may overflow."""

_MAX_POINTS: Final = 10_000_000
MAX_KEPT: Final = 10_000
"""Points of a cloud after thinning, at most."""

_MAX_CUBES: Final = 1 << 20
"""Cubes along each axis, so that the number of a cube fits into 64 bits."""

_CENTRE: Final = SensorMount()


@dataclass(frozen=True, slots=True)
class HeightBand:
    """Which points of a cloud are obstacles. Raises MisuseError.

    Args:
        points_low: metres above the base from which points are obstacles.
        points_high: metres above the base up to which they are.
        points_range: metres from the sensor up to which they are.

    """

    points_low: float = 0.1
    points_high: float = 1.0
    points_range: float = 10.0

    def __post_init__(self) -> None:
        low, high, reach = self.points_low, self.points_high, self.points_range
        if not (all(map(math.isfinite, (low, high, reach))) and low < high and reach > 0):
            raise MisuseError(
                f"points_low, points_high and points_range are {low}, {high} and {reach};"
                " expected a lower height, a higher one, and metres above 0"
            )


def scan_of_points(
    message: Any, robot: str, placed: Matrix, band: HeightBand, time: float | None = None
) -> Scan:
    """A PointCloud2 as a scan around the sensor: in each direction, the nearest point of the band.

    A direction without a point is not measured: a cloud does not tell what is free. `placed` is
    the transform from the message's frame to the robot, 4 x 4. Raises GarbageError.
    """
    there = _coordinates(message) @ placed[:3, :3].T
    # Heights are those above the base, directions those from the sensor.
    above = there[:, 2] + placed[2, 3]
    there = there[(above >= band.points_low) & (above <= band.points_high)]
    distances = portable.hypot(there[:, 0], there[:, 1])
    angles = np.degrees(portable.atan2(there[:, 1], there[:, 0]))
    near = (distances > 0) & (distances <= band.points_range)
    beams = np.rint((angles[near] + 180.0) * (_BEAMS / 360.0)).astype(np.intp) % _BEAMS
    ranges = np.full(_BEAMS, np.inf)
    np.minimum.at(ranges, beams, distances[near])
    ranges[np.isinf(ranges)] = 0.0
    return Scan(
        robot, ranges.astype(np.float32), -180.0, 360.0 / _BEAMS, band.points_range,
        stamp_of(message) if time is None else time, float(placed[0, 3]), float(placed[1, 3]), 0.0,
    )  # fmt: skip


def points_of(message: Any, placed: Matrix, reach: float, cube: float) -> NDArray[np.float64]:
    """The points of a PointCloud2, (n, 3): metres ahead of, to the left of and above the robot.

    Those within `reach` metres from the sensor, in their order, and the first of each cube of
    `cube` metres, which is doubled until at most MAX_KEPT remain. `placed` is as for
    `scan_of_points`. Raises GarbageError.
    """
    there = _coordinates(message)
    there = there[(there * there).sum(axis=1) <= reach * reach]
    cube = max(cube, 4 * min(reach, _FARTHEST) / _MAX_CUBES)
    while True:
        x, y, z = np.floor(there / cube).astype(np.int64).T
        _, first = np.unique((x * _MAX_CUBES + y) * _MAX_CUBES + z, return_index=True)
        if len(first) <= MAX_KEPT:
            return there[np.sort(first)] @ placed[:3, :3].T + placed[:3, 3]
        cube *= 2


def _coordinates(message: Any) -> NDArray[np.float64]:
    """The points of a cloud that a sensor can measure, (points, 3). Raises GarbageError."""
    fields = {str(field.name): field for field in message.fields}
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        raise GarbageError(f"a PointCloud2 without {', '.join(missing)}")
    axes = [fields[name] for name in "xyz"]
    if any(axis.datatype not in _FORMATS or axis.count != 1 for axis in axes):
        raise GarbageError("a PointCloud2 whose coordinates are not FLOAT32 or FLOAT64")
    order = ">" if message.is_bigendian else "<"
    width, height, row = int(message.width), int(message.height), int(message.row_step)
    formats = [order + _FORMATS[axis.datatype] for axis in axes]
    data = np.asarray(message.data, np.uint8)
    try:
        point = np.dtype({
            "names": ["x", "y", "z"], "formats": formats,
            "offsets": [int(axis.offset) for axis in axes], "itemsize": int(message.point_step),
        })  # fmt: skip
        if width * height > _MAX_POINTS or row < width * point.itemsize:
            raise ValueError
        rows = data[: row * height].reshape(height, row)[:, : width * point.itemsize]
        points = np.ascontiguousarray(rows).reshape(-1).view(point)
    except (TypeError, ValueError):
        raise GarbageError(
            f"{data.size} bytes are not {width} × {height} points of {message.point_step}"
        ) from None
    places = np.column_stack([points[name].astype(np.float64) for name in "xyz"])
    return places[(np.abs(places) <= _FARTHEST).all(axis=1)]


def scan_of_range(
    message: Any, robot: str, mounting: SensorMount = _CENTRE, time: float | None = None
) -> Scan:
    """A Range as a scan of one beam in the middle of its cone. Raises GarbageError.

    Beyond the range nothing was hit; what is too near, or not a number, was not measured.
    """
    far, least, most = float(message.range), float(message.min_range), float(message.max_range)
    if not (math.isfinite(most) and most > max(0.0, least)):
        raise GarbageError(f"max_range is {most:g}; expected metres above 0 and min_range")
    measured = 0.0 if math.isnan(far) or far < least else min(far, most)
    mount = mounting.mount
    return Scan(
        robot, np.array([measured], np.float32), 0.0, 1.0, most,
        stamp_of(message) if time is None else time, mount.x, mount.y, mount.angle,
    )  # fmt: skip
