"""Pairs of close points in a plane or on a torus, by scipy's k-d tree."""

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
    """Pairs of points, each once: rows, displacement from `first` to `second`, squared distance."""

    first: Rows
    second: Rows
    dx: Numbers
    dy: Numbers
    squared: Numbers

    def take(self, rows: Rows) -> Pairs:
        """The pairs of these rows."""
        dx, dy, squared = self.dx[rows], self.dy[rows], self.squared[rows]
        return Pairs(self.first[rows], self.second[rows], dx, dy, squared)


def tree() -> Any:
    """scipy's k-d tree. Raises MisuseError if scipy is not installed."""
    try:
        spatial: Any = import_module("scipy.spatial")
    except ImportError:
        raise MisuseError(
            "neighbours in a plane need scipy: pip install 'minerva-bus[neighbours]'"
        ) from None
    return spatial.cKDTree


def near(x: Numbers, y: Numbers, radius: float, size: tuple[float, float] | None = None) -> Pairs:
    """All pairs within a radius; `size` is (width, height) of a periodic plane.

    The radius must be below half of both.
    """
    points = np.column_stack((x, y))
    if size is not None:
        points %= size
        points[points >= size] = 0.0  # a value just below 0 wraps to the far edge, which is 0
    indices = tree()(points, boxsize=size).query_pairs(radius, output_type="ndarray")
    first, second = indices[:, 0], indices[:, 1]
    way = points[second] - points[first]
    if size is not None:
        way -= np.round(way / size) * size
    dx, dy = np.ascontiguousarray(way[:, 0]), np.ascontiguousarray(way[:, 1])
    return Pairs(first, second, dx, dy, dx * dx + dy * dy)
