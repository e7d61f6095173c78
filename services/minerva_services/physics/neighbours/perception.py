"""Data about neighbours in a plane: one row per neighbour, or a summary per agent."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_services.options import require
from minerva_services.physics.neighbours.spots import Spots

Numbers = NDArray[np.float64]
Rows = NDArray[np.intp]


_MARGIN: Final = 1.0 + 1e-9
"""How much further the tree looks: it compares distances between boxes, which are rounded."""


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


def near(x: Numbers, y: Numbers, radius: float, size: tuple[float, float] | None = None) -> Pairs:
    """All pairs within a radius; `size` is (width, height) of a periodic plane.

    The radius must be below half of both. Whether two points are a pair depends on nothing but
    them, and sums over pairs have the order of the rows, so a part of a plane has the same ones.
    """
    points = np.column_stack((x, y))
    if size is not None:
        points %= size
        points[points >= size] = 0.0  # a value just below 0 wraps to the far edge, which is 0
    close = tree()(points, boxsize=size).query_pairs(radius * _MARGIN, output_type="ndarray")
    ordered = close[:, 0] * len(points) + close[:, 1]
    ordered.sort()
    first, second = np.divmod(ordered, max(len(points), 1))
    way = points[second] - points[first]
    if size is not None:
        # The shortest displacement may lead across an edge (minimum image convention).
        way -= np.round(way / size) * size
    dx, dy = np.ascontiguousarray(way[:, 0]), np.ascontiguousarray(way[:, 1])
    pairs = Pairs(first, second, dx, dy, dx * dx + dy * dy)
    within = pairs.squared <= radius * radius
    return pairs if within.all() else pairs.take(np.flatnonzero(within))


Data = Mapping[str, Any]

_OFFSETS = frozenset(("apart_x", "apart_y"))
_OBSERVED = _OFFSETS | {"number", "dx", "dy", "distance"}


def individual(
    spots: Spots, pairs: Pairs, wanted: AbstractSet[str], nearest: int
) -> tuple[Rows, Data]:
    """Receivers (rows of the spots) and the requested data of one neighbour each.

    Ordered by agent, then by neighbour; with `nearest` > 0 only that many, nearest first.
    """
    to = np.concatenate((pairs.first, pairs.second))
    about = np.concatenate((pairs.second, pairs.first))
    # 0.0 - x instead of -x avoids negative zeros.
    dx = np.concatenate((pairs.dx, 0.0 - pairs.dx))
    dy = np.concatenate((pairs.dy, 0.0 - pairs.dy))
    distance = np.sqrt(np.concatenate((pairs.squared, pairs.squared)))
    # Rows break ties between equal distances, because the order of the tree's pairs means nothing.
    order = np.lexsort((about, distance, to) if nearest else (about, to))
    if nearest:
        # Rank of each neighbour among those of its agent, without a loop over agents.
        ordered = to[order]
        order = order[np.arange(len(order)) - np.searchsorted(ordered, ordered) < nearest]
    about = about[order]
    data: dict[str, Any] = {"dx": dx[order], "dy": dy[order], "distance": distance[order]}
    if "who" in wanted:
        data["who"] = spots.ids.take(about)
    for name in spots.shown.keys() - data.keys():
        data[name] = spots.shown[name][about]
    return to[order], {name: data[name] for name in data.keys() & wanted}


def summary(spots: Spots, pairs: Pairs, wanted: AbstractSet[str], apart: float) -> Data:
    """The requested data of each agent's neighbours: number, means, and summed displacements.

    `apart_x` and `apart_y` sum the displacements away from neighbours closer than `apart`.
    """
    count = len(spots)
    number = np.bincount(pairs.first, minlength=count) + np.bincount(pairs.second, minlength=count)
    numbers = spots.numbers()
    sums: dict[str, NDArray[Any]] = {}
    for name, offset in (("dx", pairs.dx), ("dy", pairs.dy)):
        if name in wanted:
            sums[name] = _summed(pairs, offset, -offset, count)
    if "distance" in wanted:
        distance = np.sqrt(pairs.squared)
        sums["distance"] = _summed(pairs, distance, distance, count)
    for name in numbers.keys() & (wanted - _OBSERVED):
        values = numbers[name]
        sums[name] = _summed(pairs, values[pairs.second], values[pairs.first], count)
    several = np.maximum(number, 1)
    data: dict[str, NDArray[Any]] = {name: values / several for name, values in sums.items()}
    if wanted & _OFFSETS:
        close = pairs.take(np.flatnonzero(pairs.squared < apart * apart))
        data["apart_x"] = _summed(close, -close.dx, close.dx, count)
        data["apart_y"] = _summed(close, -close.dy, close.dy, count)
    data["number"] = number
    return {name: data[name] for name in data.keys() & wanted}


def _summed(pairs: Pairs, to_first: Numbers, to_second: Numbers, count: int) -> Numbers:
    """Sums over pairs for each point."""
    return np.add(
        np.bincount(pairs.first, to_first, count), np.bincount(pairs.second, to_second, count)
    ).astype(np.float64, copy=False)
