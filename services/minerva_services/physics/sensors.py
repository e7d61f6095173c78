"""A planar laser and a marker camera, both cast as rays from a body's centre."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Sighting
from minerva_services.physics.encounters import Point
from minerva_services.physics.obstacles import Ray

Distances: TypeAlias = NDArray[np.float64]

_SURFACE: Final = 1e-3
"""A wall this close (m) in front of a marker carries the marker and does not hide it."""

_EDGE: Final = 1e-9
"""Tolerance in degrees for rounding at the edge of the field of view."""


def laser(pose: Pose, angles: Iterable[float], range_max: float, ray: Ray) -> Distances:
    """Distances in metres to the first hit of each ray, `range_max` for none.

    Args:
        pose: the laser's pose.
        angles: directions of the beams in degrees from the heading.
        range_max: length of the beams in metres.
        ray: free fraction of the line between two points.

    """
    headings = np.radians(pose.angle + np.fromiter(angles, np.float64))
    cos, sin = portable.cos_sin(headings)
    x, y = pose.x + range_max * cos, pose.y + range_max * sin
    start = pose.x, pose.y
    ends = zip(x.tolist(), y.tolist(), strict=True)
    return range_max * np.array([ray(start, end) for end in ends], dtype=np.float64)


def camera(
    pose: Pose, markers: Mapping[str, Point], fov_deg: float, range_max: float, ray: Ray
) -> tuple[Sighting, ...]:
    """The visible markers, sorted by name.

    Args:
        pose: the camera's pose; its axis is the heading.
        markers: positions in metres by name.
        fov_deg: full field of view in degrees.
        range_max: range in metres.
        ray: free fraction of the line between two points.

    """
    axis = portable.cos_sin(math.radians(pose.angle))
    sightings = (_sighting(pose, axis, name, markers[name]) for name in sorted(markers))
    return tuple(
        seen
        for seen in sightings
        # Rays are the most expensive test, so they come last.
        if seen.distance <= range_max
        and abs(seen.angle) <= fov_deg / 2 + _EDGE
        and _in_sight(pose, markers[seen.marker], seen.distance, ray)
    )


def _sighting(pose: Pose, axis: Point, name: str, place: Point) -> Sighting:
    """A marker as seen along an axis, the cosine and sine of the heading."""
    cos, sin = axis
    x, y = place[0] - pose.x, place[1] - pose.y
    bearing = math.degrees(portable.atan2(y * cos - x * sin, x * cos + y * sin))
    return Sighting(name, portable.hypot(x, y), bearing)


def _in_sight(pose: Pose, place: Point, distance: float, ray: Ray) -> bool:
    return distance * (1 - ray((pose.x, pose.y), place)) <= _SURFACE
