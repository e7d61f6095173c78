"""The camera: projection from metres to pixels, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_MIN_ELEVATION, _MAX_ELEVATION = 8.0, 90.0
_MIN_DISTANCE, _MAX_DISTANCE = 0.2, 1e6
_DEPTH_RANGE = 100.0
"""Depth range of the projection as a multiple of the distance to the target."""


MARGIN = 0.06
"""Share of the picture that stays free at each of its edges."""


class SceneCamera(Protocol):
    """What a scene is drawn through."""

    @property
    def eye(self) -> Floats:
        """Position in metres, (3,)."""
        ...

    def metre(self, height: int) -> float:
        """Pixels per metre at a distance of one metre, for a picture of this height."""
        ...

    def matrix(self, aspect: float) -> Floats:
        """From (x, y, z, 1) to OpenGL's clip coordinates, (4, 4); `aspect` is width / height."""
        ...


def perspective(
    axes: Floats, eye: Floats, slopes: tuple[float, float], depths: tuple[float, float]
) -> Floats:
    """From (x, y, z, 1) to OpenGL's clip coordinates, (4, 4).

    Args:
        axes: unit vectors to the right, up and forward, (3, 3).
        eye: position in metres, (3,).
        slopes: half the width and half the height of what is seen at a distance of one metre.
        depths: the nearest and the farthest depth that is drawn, metres.

    """
    near, far = depths
    look = np.eye(4)
    # OpenGL's camera looks along its negative z axis.
    look[:3, :3] = axes * [[1.0], [1.0], [-1.0]]
    look[:3, 3] = -look[:3, :3] @ eye
    lens = np.zeros((4, 4))
    lens[0, 0], lens[1, 1] = 1 / slopes[0], 1 / slopes[1]
    lens[2, 2], lens[2, 3] = (far + near) / (near - far), 2 * far * near / (near - far)
    lens[3, 2] = -1.0
    return lens @ look


@dataclass(frozen=True, slots=True)
class OrbitCamera:
    """A camera that orbits a target (metres) and looks at it.

    `azimuth` is the camera's direction as seen from the target, in degrees counter-clockwise from
    the x axis; -90 has x to the right and y ahead, as on a map. `elevation` is its height angle; 90
    degrees looks straight down. `field` is the vertical field of view in degrees.
    """

    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    azimuth: float = -90.0
    elevation: float = 50.0
    distance: float = 10.0
    field: float = 30.0

    @property
    def axes(self) -> Floats:
        """Unit vectors to the right, up and forward of the camera, (3, 3)."""
        a, e = math.radians(self.azimuth), math.radians(self.elevation)
        right = (-math.sin(a), math.cos(a), 0.0)
        up = (-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e))
        forward = (-math.cos(e) * math.cos(a), -math.cos(e) * math.sin(a), -math.sin(e))
        return np.array([right, up, forward])

    @property
    def eye(self) -> Floats:
        """Position of the camera in metres, (3,)."""
        return np.array(self.target) - self.distance * self.axes[2]

    @property
    def _slope(self) -> float:
        return math.tan(math.radians(self.field) / 2)

    def metre(self, height: int) -> float:
        """Pixels per metre at a distance of one metre, for a picture of this height."""
        return height / 2 / self._slope

    def matrix(self, aspect: float) -> Floats:
        """From (x, y, z, 1) to OpenGL's clip coordinates, (4, 4); `aspect` is width / height."""
        depths = self.distance / _DEPTH_RANGE, self.distance * _DEPTH_RANGE
        return perspective(self.axes, self.eye, (self._slope * aspect, self._slope), depths)

    def project(self, points: Floats, width: int, height: int) -> Floats:
        """Pixels (n, 2) of points (n, 3), y down; NaN behind the camera."""
        seen = (np.asarray(points, np.float64).reshape(-1, 3) - self.eye) @ self.axes.T
        depth = self.depths(points)
        half = self.metre(height)
        return np.stack(
            [width / 2 + half * seen[:, 0] / depth, height / 2 - half * seen[:, 1] / depth], axis=1
        )

    def depths(self, points: Floats) -> Floats:
        """Depth in metres of points (n, 3) in front of the camera; NaN behind it."""
        depth = (np.asarray(points, np.float64).reshape(-1, 3) - self.eye) @ self.axes[2]
        # Division by NaN gives NaN pixels, which no comparison selects.
        return np.where(depth > 1e-9, depth, np.nan)

    def ground(
        self, x: float, y: float, width: int, height: int, z: float = 0.0
    ) -> tuple[float, float] | None:
        """Where a pixel's ray meets the level `z`, in metres, or None."""
        half = self.metre(height)
        ray = np.array([(x - width / 2) / half, (height / 2 - y) / half, 1.0]) @ self.axes
        rise = z - self.eye[2]
        # A level ray, or one that leads away from the level, never meets it.
        if abs(ray[2]) < 1e-9 or rise / ray[2] <= 0:
            return None
        met = self.eye + ray * (rise / ray[2])
        return float(met[0]), float(met[1])

    def orbited(self, azimuth: float, elevation: float) -> OrbitCamera:
        """Rotated around its target, in degrees."""
        turned = math.remainder(self.azimuth + azimuth, 360.0)
        raised = min(max(self.elevation + elevation, _MIN_ELEVATION), _MAX_ELEVATION)
        return replace(self, azimuth=turned, elevation=raised)

    def panned(self, x: float, y: float, height: int) -> OrbitCamera:
        """Moved along the ground such that the target shifts by (x, y) pixels, y down."""
        metre = self.distance / self.metre(height)
        right, up, _ = self.axes
        ahead = np.array([-right[1], right[0], 0.0])
        # At a low elevation a pixel covers much ground; the limit keeps the motion controllable.
        steep = max(float(np.hypot(up[0], up[1])), 0.2)
        moved = np.array(self.target) - right * (x * metre) + ahead * (y * metre / steep)
        return self.aimed(*(float(coordinate) for coordinate in moved))

    def zoomed(self, factor: float) -> OrbitCamera:
        """Closer to its target by a factor."""
        distance = min(max(self.distance / factor, _MIN_DISTANCE), _MAX_DISTANCE)
        return replace(self, distance=distance)

    def aimed(self, x: float, y: float, z: float = 0.0) -> OrbitCamera:
        """Aimed at (x, y, z) from the same direction and distance."""
        return replace(self, target=(x, y, z))

    def fitted(self, points: Floats, aspect: float, margin: float = MARGIN) -> OrbitCamera:
        """As close as possible with all points (n, 3) in the picture, in the same direction.

        `margin` is the share of the picture that stays free at its upper and its lower edge; at
        the left and the right, it is at most `MARGIN`.

        Each point limits the distance from both sides (left and right, below and above); the camera
        is shifted sideways to where both limits are equal. It stays at least half the points'
        spread away from any point.
        """
        spread = float(np.linalg.norm(np.ptp(points, axis=0)))
        right, up, depth = (np.asarray(points, np.float64) @ self.axes.T).T
        # Along the camera's axes each limit is one linear inequality.
        wide = self._slope * aspect * (1 - 2 * min(margin, MARGIN))
        across, x = _bounded(right, depth, wide)
        along, y = _bounded(up, depth, self._slope * (1 - 2 * margin))
        back = max(across, along, spread / 2 - float(depth.min()))
        eye = np.array([x, y, -back]) @ self.axes
        forward = self.axes[2]
        distance = max(-eye[2] / forward[2], _MIN_DISTANCE)
        met = eye + forward * distance
        return replace(
            self, target=tuple(float(coordinate) for coordinate in met), distance=float(distance)
        )


def _bounded(offset: Floats, depth: Floats, slope: float) -> tuple[float, float]:
    """Minimum distance behind the origin, and the sideways shift at that distance."""
    left = float(np.max(offset / slope - depth))
    right = float(np.max(-offset / slope - depth))
    return (left + right) / 2, slope * (left - right) / 2
