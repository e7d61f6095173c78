"""Transforms of ROS as matrices.

Products are sums in one order: those of numpy's `@` depend on the processor.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Matrix: TypeAlias = NDArray[np.float64]


def matrix_of(transform: Any) -> NDArray[np.float64]:
    """A geometry_msgs/Transform, its quaternion (x, y, z, w) and translation (m), as (4, 4)."""
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


def product(one: Matrix, other: Matrix) -> Matrix:
    """First the other transform, then the one; all (4, 4)."""
    made = np.zeros((4, 4))
    for k in range(4):
        made += one[:, k, None] * other[k]
    return made


def inverse(transform: Matrix) -> Matrix:
    """The way back from a turn and a translation, (4, 4)."""
    made = np.eye(4)
    made[:3, :3] = transform[:3, :3].T
    made[:3, 3] = [-part for part in moved(made, transform[:3, 3].tolist())]
    return made


def moved(transform: Matrix, place: Sequence[float]) -> tuple[float, float, float]:
    """A place (x, y, z) in metres after a transform, (4, 4)."""
    x, y, z = place
    first, second, third = (a * x + b * y + c * z + d for a, b, c, d in transform[:3].tolist())
    return first, second, third
