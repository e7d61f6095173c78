"""ROS transforms as matrices.

Products are summed in a fixed order, because numpy's `@` depends on the processor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Matrix: TypeAlias = NDArray[np.float64]

_SHORTEST: Final = 1e-6
"""Length below which a quaternion is rounding noise around 0."""

_ROUNDING: Final = 1e-9


def matrix_of(transform: Any) -> NDArray[np.float64]:
    """A geometry_msgs/Transform, a rotation and a translation in metres, as (4, 4).

    Raises ValueError if it is not finite.
    """
    moved = transform.translation
    if not all(map(math.isfinite, (moved.x, moved.y, moved.z))):
        raise ValueError("translation not finite")
    x, y, z, w = unit_quaternion(transform.rotation)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), moved.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), moved.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), moved.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def unit_quaternion(rotation: Any) -> tuple[float, float, float, float]:
    """A geometry_msgs/Quaternion as (x, y, z, w) of length 1; others are scaled, as in tf2.

    Raises ValueError if it has no direction.
    """
    x, y, z, w = (float(getattr(rotation, name)) for name in "xyzw")
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not _SHORTEST <= length < math.inf:
        raise ValueError(f"the quaternion ({x:g}, {y:g}, {z:g}, {w:g}) is not a rotation")
    # Rounding is kept, so that the readings of a stepped simulation are those of physics.
    if abs(length - 1.0) < _ROUNDING:
        return x, y, z, w
    return x / length, y / length, z / length, w / length


def product(first: Matrix, second: Matrix) -> Matrix:
    """The matrix product of two transforms, (4, 4): `second` is applied before `first`."""
    product = np.zeros((4, 4))
    for k in range(4):
        product += first[:, k, None] * second[k]
    return product


def inverse(transform: Matrix) -> Matrix:
    """Inverse of a rotation and translation, (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = [-part for part in moved(inverse, transform[:3, 3].tolist())]
    return inverse


def moved(transform: Matrix, place: Sequence[float]) -> tuple[float, float, float]:
    """A point (x, y, z) in metres after a transform, (4, 4)."""
    x, y, z = place
    first, second, third = (a * x + b * y + c * z + d for a, b, c, d in transform[:3].tolist())
    return first, second, third
