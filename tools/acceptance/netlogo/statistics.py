"""Statistics of the models, of arrays with a number for each agent."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

Figures = Mapping[str, float]


def wolf_sheep(sheep: float, wolves: float, grown: float) -> Figures:
    """Numbers of sheep, of wolves, and of cells with grass."""
    return {"sheep": sheep, "wolves": wolves, "grass": grown}


def flocking(x: Any, y: Any, vx: Any, vy: Any) -> Figures:
    """The order of the directions, from 0 to 1, and the mean distance to the next bird."""
    speed = np.hypot(vx, vy)
    order = np.hypot((vx / speed).mean(), (vy / speed).mean())
    return {"order": float(order), "distance": _nearest(x, y, 100)}


def heatbugs(x: Any, y: Any, unhappiness: Any) -> Figures:
    """The mean and the median unhappiness, and the mean distance to the next bug."""
    return {
        "unhappiness": float(np.mean(unhappiness)),
        "median": float(np.median(unhappiness)),
        "distance": _nearest(x, y, 100),
    }


def ants(piles: ArrayLike) -> Figures:
    """The food in each pile."""
    return {f"pile {number}": float(food) for number, food in enumerate(np.ravel(piles), 1)}


def aids(infected: ArrayLike, known: ArrayLike, coupled: ArrayLike) -> Figures:
    """Numbers of people."""
    return {
        "infected": float(np.sum(infected)),
        "known": float(np.sum(known)),
        "coupled": float(np.sum(coupled)),
    }


def _nearest(x: Any, y: Any, side: int) -> float:
    """The mean distance to the nearest other place on a torus."""
    places = np.stack([x, y], axis=1) % side
    return float(cKDTree(places, boxsize=side).query(places, 2)[0][:, 1].mean())
