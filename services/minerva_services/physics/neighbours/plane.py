"""Pairs of points that are near each other, in a plane or on a torus: scipy's k-d tree."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError

Numbers = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of points, each once: rows, the way from `one` to `other`, its length squared."""

    one: Rows
    other: Rows
    dx: Numbers
    dy: Numbers
    squared: Numbers

    def take(self, some: Rows) -> Pairs:
        """Some of them."""
        dx, dy, squared = self.dx[some], self.dy[some], self.squared[some]
        return Pairs(self.one[some], self.other[some], dx, dy, squared)


def tree() -> Any:
    """scipy's k-d tree. Raises MisuseError where scipy is not installed."""
    try:
        spatial: Any = import_module("scipy.spatial")
    except ImportError:
        raise MisuseError(
            "neighbours in a plane need scipy: pip install 'minerva-bus[neighbours]'"
        ) from None
    return spatial.cKDTree


def near(x: Numbers, y: Numbers, radius: float, size: tuple[float, float] | None = None) -> Pairs:
    """All pairs up to a radius apart; `size` are width and height of a periodic plane.

    The radius is below half of both.
    """
    points = np.column_stack((x, y))
    if size is not None:
        points %= size
        points[points >= size] = 0.0  # a hair below 0 has become the far edge, which is 0
    found = tree()(points, boxsize=size).query_pairs(radius, output_type="ndarray")
    one, other = found[:, 0], found[:, 1]
    way = points[other] - points[one]
    if size is not None:
        way -= np.round(way / size) * size
    dx, dy = np.ascontiguousarray(way[:, 0]), np.ascontiguousarray(way[:, 1])
    return Pairs(one, other, dx, dy, dx * dx + dy * dy)
