"""Transforms of ROS as matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


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
