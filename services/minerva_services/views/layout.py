"""What views share to fit a picture: extents of items, rows of texts, and lengths of grids."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.picture import Copies, Discs, Item, Marks, Polyline, Texts

Floats = NDArray[np.float64]


def extremes(item: Item) -> tuple[Floats, Floats]:
    """Points (n,) and (n,) in metres whose bounding box contains an item."""
    if isinstance(item, Polyline):
        return item.points[:, 0], item.points[:, 1]
    if isinstance(item, Discs):
        r = item.radius
        return np.concatenate([item.x - r, item.x + r]), np.concatenate([item.y - r, item.y + r])
    if isinstance(item, Copies):
        low, high = item.extents()
        return np.concatenate([low[:, 0], high[:, 0]]), np.concatenate([low[:, 1], high[:, 1]])
    if isinstance(item, Texts):
        return item.x, item.y
    if isinstance(item, Marks):
        return np.zeros(0), np.zeros(0)
    width, depth = item.size
    corners = np.array([item.pose.point(x, y) for x in (0.0, width) for y in (0.0, depth)])
    return corners[:, 0], corners[:, 1]


def flow(widths: Sequence[float], room: float, gap: float) -> list[list[int]]:
    """Numbers of things of these widths, in rows that fit into `room`, at least one per row."""
    rows: list[list[int]] = []
    left = 0.0
    for number, width in enumerate(widths):
        if not rows or left + width > room:
            rows.append([])
            left = 0.0
        rows[-1].append(number)
        left += width + gap
    return rows


def round_step(wanted: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is not below `wanted`."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= wanted)
