"""Pairs of points in a plane that are within a radius of each other."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_services.options import require
from minerva_services.physics.neighbours.cells import Candidates, candidates, order_of

Numbers = NDArray[np.float64]
Rows = NDArray[np.intp]
Size = tuple[float, float]

_NONE: Final = np.zeros(0, np.intp)
_MARGIN: Final = 1.0 + 1e-6
"""How much further a search looks: coordinates of cells and boxes of the tree are rounded."""
_LEAST: Final = 1e-150
"""The least radius of a search; squares of shorter distances have few digits, or are 0."""


_MOST: Final = 1e150
"""The largest coordinate that the tree can square."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of points, each once: rows, displacement from `first` to `second`, squared distance.

    They are ordered by both rows, `first` < `second`.
    """

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
    require("neighbours", "scipy.spatial", "scipy", "neighbours")
    spatial: Any = import_module("scipy.spatial")
    return spatial.cKDTree


def near(x: Numbers, y: Numbers, radius: float, size: Size | None = None) -> Pairs:
    """All pairs within a radius; `size` is (width, height) of a periodic plane.

    The radius must be below half of both. Whether two points are a pair depends on nothing but
    them, and sums over pairs have the order of the rows, so a part of a plane has the same ones,
    and cell lists find those of a tree.
    """
    x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
    if size is not None:
        x, y = _wrapped(x, size[0]), _wrapped(y, size[1])
    reach = max(radius, _LEAST) * _MARGIN
    close = candidates(x, y, reach, size) if len(x) else None
    if close is not None and close.win():
        rows = in_cells(close, x, y, radius, size)
    else:
        rows = in_tree(x, y, reach, size)
    pairs = _between(x, y, *_ordered(*rows, len(x)), size)
    within = pairs.squared <= radius * radius
    return pairs if within.all() else pairs.take(np.flatnonzero(within))


def in_cells(
    close: Candidates, x: Numbers, y: Numbers, radius: float, size: Size | None
) -> tuple[Rows, Rows]:
    """Both rows of all pairs within a radius, in no order, by comparison of candidates."""
    x, y = x[close.rows], y[close.rows]
    places: list[tuple[Rows, Rows]] = [(_NONE, _NONE)]
    for first, second in close.blocks():
        squared = _between(x, y, first, second, size).squared
        within = np.flatnonzero(squared <= radius * radius)
        places.append((first[within], second[within]))
    first, second = (np.concatenate(part) for part in zip(*places, strict=True))
    return close.rows[first], close.rows[second]


def in_tree(x: Numbers, y: Numbers, reach: float, size: Size | None) -> tuple[Rows, Rows]:
    """The same of pairs within about a distance, from a k-d tree."""
    points = np.column_stack((x, y))
    if size is None:
        # Clipped points are not further apart than before, so no pair is lost.
        points, reach = points.clip(-_MOST, _MOST), min(reach, 4 * _MOST)
    close = tree()(points, boxsize=size).query_pairs(reach, output_type="ndarray")
    return close[:, 0], close[:, 1]


def _wrapped(at: Numbers, size: float) -> Numbers:
    if not len(at) or (at.min() >= 0.0 and at.max() < size):
        return at  # `%` takes many times as long
    at = at % size
    at[at >= size] = 0.0  # a value just below 0 wraps to the far edge, which is 0
    return at


def _ordered(first: Rows, second: Rows, points: int) -> tuple[Rows, Rows]:
    """Pairs ordered by the lower row, then by the higher one."""
    lower, higher = np.minimum(first, second), np.maximum(first, second)
    order = order_of(lower, higher, below=points)
    return lower[order], higher[order]


def _between(x: Numbers, y: Numbers, first: Rows, second: Rows, size: Size | None) -> Pairs:
    """Points with their displacements, the shortest ones in a periodic plane.

    An exchange of both points changes signs only, so squared distances have the same bits.
    """
    with np.errstate(over="ignore"):  # a distance that is no real number is infinite
        dx, dy = x[second] - x[first], y[second] - y[first]
        if size is not None:
            # The shortest displacement may lead across an edge (minimum image convention).
            dx -= np.rint(dx / size[0]) * size[0]
            dy -= np.rint(dy / size[1]) * size[1]
        return Pairs(first, second, dx, dy, dx * dx + dy * dy)
