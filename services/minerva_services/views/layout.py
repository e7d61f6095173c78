"""What views share to fit a picture: extents of items, and round lengths for grids."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.picture import Discs, Item, Polyline, Texts, Tiles

Floats = NDArray[np.float64]


def extremes(item: Item) -> tuple[Floats, Floats]:
    """Points (n,) and (n,) in metres whose bounding box contains an item."""
    if isinstance(item, Polyline):
        return item.points[:, 0], item.points[:, 1]
    if isinstance(item, Discs):
        r = item.radius
        return np.concatenate([item.x - r, item.x + r]), np.concatenate([item.y - r, item.y + r])
    if isinstance(item, Texts):
        return item.x, item.y
    assert isinstance(item, Tiles)
    width, depth = item.size
    corners = np.array([item.pose.point(x, y) for x in (0.0, width) for y in (0.0, depth)])
    return corners[:, 0], corners[:, 1]


def round_step(wanted: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is not below `wanted`."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= wanted)
