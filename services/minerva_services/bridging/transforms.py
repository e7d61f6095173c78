"""ROS transforms as matrices.

Products are summed in a fixed order, because numpy's `@` depends on the processor.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Matrix: TypeAlias = NDArray[np.float64]


def matrix_of(transform: Any) -> NDArray[np.float64]:
    """A geometry_msgs/Transform, quaternion (x, y, z, w) and translation (m), as (4, 4)."""
    turned, moved = transform.rotation, transform.translation
    x, y, z, w = turned.x, turned.y, turned.z, turned.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), moved.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), moved.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), moved.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


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
