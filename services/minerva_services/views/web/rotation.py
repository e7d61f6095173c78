"""Rotations around the vertical axis as quaternions (w, x, y, z)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def upright(angles: ArrayLike) -> NDArray[np.float64]:
    """Quaternions of shape (..., 4) for angles in degrees, counter-clockwise, of shape (...)."""
    half = np.radians(np.asarray(angles, np.float64)) / 2
    nothing = np.zeros_like(half)
    return np.stack([np.cos(half), nothing, nothing, np.sin(half)], axis=-1)
