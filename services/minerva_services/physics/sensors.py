"""A planar laser and a camera that recognises markers, both cast as rays from a body's centre."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_services.physics.body import Pose
from minerva_services.physics.obstacles import Ray
from minerva_services.physics.sweep import Point

Distances: TypeAlias = NDArray[np.float64]

_SURFACE: Final = 1e-3
"""Metres before a marker in which the wall that carries it does not hide it."""

_EDGE: Final = 1e-9
"""Degrees by which rounding may push a marker over the edge of the field of view."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A marker as a camera sees it.

    Attributes:
        marker: its name.
        dist_m: distance from the body's centre in metres.
        angle_deg: bearing in degrees from the heading, counter-clockwise, in [-180, 180].

    """

    marker: str
    dist_m: float
    angle_deg: float


def laser(pose: Pose, angles: Iterable[float], range_max: float, ray: Ray) -> Distances:
    """Distances in metres to what a ray hits first, `range_max` where it hits nothing.

    Args:
        pose: where the laser is.
        angles: the beams' directions in degrees from the heading.
        range_max: length of the beams in metres.
        ray: the free part of the way between two points.

    """
    headings = np.radians(pose.angle + np.fromiter(angles, np.float64))
    x = pose.x + range_max * portable.cos(headings)
    y = pose.y + range_max * portable.sin(headings)
    start = pose.x, pose.y
    ends = zip(x.tolist(), y.tolist(), strict=True)
    return range_max * np.array([ray(start, end) for end in ends], dtype=np.float64)


def camera(
    pose: Pose, markers: Mapping[str, Point], fov_deg: float, range_max: float, ray: Ray
) -> tuple[Sighting, ...]:
    """The markers in view, sorted by name.

    Args:
        pose: where the camera is; its axis is the heading.
        markers: places in metres by name.
        fov_deg: whole width of the field of view in degrees.
        range_max: in metres.
        ray: the free part of the way between two points.

    """
    sightings = (_sighting(pose, name, markers[name]) for name in sorted(markers))
    return tuple(
        seen
        for seen in sightings
        if seen.dist_m <= range_max
        and abs(seen.angle_deg) <= fov_deg / 2 + _EDGE
        and _in_sight(pose, markers[seen.marker], seen.dist_m, ray)
    )


def _sighting(pose: Pose, name: str, place: Point) -> Sighting:
    heading = math.radians(pose.angle)
    cos, sin = portable.cos(heading), portable.sin(heading)
    x, y = place[0] - pose.x, place[1] - pose.y
    bearing = math.degrees(portable.atan2(y * cos - x * sin, x * cos + y * sin))
    return Sighting(name, portable.hypot(x, y), bearing)


def _in_sight(pose: Pose, place: Point, distance: float, ray: Ray) -> bool:
    return distance * (1 - ray((pose.x, pose.y), place)) <= _SURFACE
