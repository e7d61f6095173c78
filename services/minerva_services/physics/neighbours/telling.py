"""What agents are told of their neighbours in a plane: each of them, or a summary."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_services.physics.neighbours.plane import Numbers, Pairs, Rows
from minerva_services.physics.neighbours.spots import Spots

Data = Mapping[str, Any]

_APART = frozenset(("apart_x", "apart_y"))
_OWN = _APART | {"number", "dx", "dy", "distance"}


def one_by_one(
    spots: Spots, pairs: Pairs, wanted: AbstractSet[str], nearest: int
) -> tuple[Rows, Data]:
    """To whom (rows of the spots), and of one neighbour what is wanted.

    By agent, and then by neighbour; with `nearest` above 0 only so many, the nearest first.
    """
    to = np.concatenate((pairs.one, pairs.other))
    about = np.concatenate((pairs.other, pairs.one))
    # Not -dx, which would make a zero of another sign.
    dx = np.concatenate((pairs.dx, 0.0 - pairs.dx))
    dy = np.concatenate((pairs.dy, 0.0 - pairs.dy))
    distance = np.sqrt(np.concatenate((pairs.squared, pairs.squared)))
    order = np.lexsort((about, distance, to) if nearest else (about, to))
    if nearest:
        ordered = to[order]
        order = order[np.arange(len(order)) - np.searchsorted(ordered, ordered) < nearest]
    about = about[order]
    found: dict[str, Any] = {"dx": dx[order], "dy": dy[order], "distance": distance[order]}
    if "who" in wanted:
        found["who"] = spots.ids.take(about)
    for name in spots.shown.keys() - found.keys():
        found[name] = spots.shown[name][about]
    return to[order], {name: found[name] for name in found.keys() & wanted}


def summary(spots: Spots, pairs: Pairs, wanted: AbstractSet[str], apart: float) -> Data:
    """Of each agent's neighbours what is wanted: how many, means, and sums of the ways from them.

    `apart_x` and `apart_y` add up the ways from those that are nearer than `apart`.
    """
    count = len(spots)
    number = np.bincount(pairs.one, minlength=count) + np.bincount(pairs.other, minlength=count)
    numbers = spots.numbers()
    sums: dict[str, NDArray[Any]] = {
        "dx": _summed(pairs, pairs.dx, -pairs.dx, count),
        "dy": _summed(pairs, pairs.dy, -pairs.dy, count),
    }
    if "distance" in wanted:
        distance = np.sqrt(pairs.squared)
        sums["distance"] = _summed(pairs, distance, distance, count)
    for name in numbers.keys() & (wanted - _OWN):
        values = numbers[name]
        sums[name] = _summed(pairs, values[pairs.other], values[pairs.one], count)
    several = np.maximum(number, 1)
    found: dict[str, NDArray[Any]] = {name: values / several for name, values in sums.items()}
    if wanted & _APART:
        close = pairs.take(np.flatnonzero(pairs.squared < apart * apart))
        found["apart_x"] = _summed(close, -close.dx, close.dx, count)
        found["apart_y"] = _summed(close, -close.dy, close.dy, count)
    found["number"] = number
    return {name: found[name] for name in found.keys() & wanted}


def _summed(pairs: Pairs, to_one: Numbers, to_other: Numbers, count: int) -> Numbers:
    """Sums over pairs, for each point."""
    return np.add(
        np.bincount(pairs.one, to_one, count), np.bincount(pairs.other, to_other, count)
    ).astype(np.float64, copy=False)
