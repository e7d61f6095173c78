"""Data about neighbours in a plane: one row per neighbour, or a summary per agent."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_services.physics.neighbours.cells import order_of
from minerva_services.physics.neighbours.search import Numbers, Pairs, Rows
from minerva_services.physics.neighbours.spots import Spots

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
    # Rows break ties between equal distances, because no pair comes before another by itself.
    order = np.lexsort((about, distance, to)) if nearest else order_of(to, about, below=len(spots))
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
    """The requested data of each agent's neighbours: number, means, sums and comparisons.

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
    for name, relation, values in spots.related(wanted):
        own, other = values[pairs.first], values[pairs.second]
        if relation == "sum":
            data[name] = _summed(pairs, other, own, count)
        else:
            same = relation == "same"
            first = own == other if same else other > own
            second = first if same else own > other
            counted = _summed(pairs, first.astype(np.float64), second.astype(np.float64), count)
            data[name] = counted.astype(np.int64)
    data["number"] = number
    return {name: data[name] for name in data.keys() & wanted}


def _summed(pairs: Pairs, to_first: Numbers, to_second: Numbers, count: int) -> Numbers:
    """Sums over pairs for each point."""
    return np.add(
        np.bincount(pairs.first, to_first, count), np.bincount(pairs.second, to_second, count)
    ).astype(np.float64, copy=False)
