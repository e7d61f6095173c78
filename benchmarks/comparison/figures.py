"""Statistics of the models, computed alike for every system."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Statistics = dict[str, float]


def of_flock(x: Any, y: Any, vx: Any, vy: Any) -> Statistics:
    """Order: the length of the mean unit velocity, 1 if all birds fly in one direction."""
    length = np.maximum(np.hypot(vx, vy), 1e-12)
    return {"order": float(np.hypot((vx / length).mean(), (vy / length).mean()))}


def of_wealth(coins: NDArray[Any]) -> Statistics:
    """Inequality as the Gini coefficient, and the share of people without coins."""
    ranked, count = np.sort(coins).astype(float), len(coins)
    gini = 2 * (np.arange(1, count + 1) @ ranked) / (count * ranked.sum()) - (count + 1) / count
    return {"gini": float(gini), "poor": float((ranked == 0).mean())}


def of_town(groups: NDArray[Any], radius: int, wanted: int) -> Statistics:
    """Shares of similar neighbours, and of happy agents, in a matrix of groups with 0 if vacant."""
    side = len(groups)
    padded = np.pad(groups, radius)
    same, neighbours = np.zeros(groups.shape, int), np.zeros(groups.shape, int)
    for dx in range(2 * radius + 1):
        for dy in range(2 * radius + 1):
            if (dx, dy) != (radius, radius):
                other = padded[dx : dx + side, dy : dy + side]
                same += (other == groups) & (groups > 0)
                neighbours += other > 0
    there = groups > 0
    share = same[there] / np.maximum(neighbours[there], 1)
    return {
        "similar": float(share[neighbours[there] > 0].mean()),
        "happy": float((same[there] >= wanted).mean()),
    }
