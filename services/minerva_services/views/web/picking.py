"""Picking: the disc or text nearest to the ray of a click."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.picture import Texts
from minerva_services.views.solids import DiscTable

_TOLERANCE = 0.012
"""Tolerance of a click as an angle in radians: about ten pixels."""


@dataclass(frozen=True, slots=True)
class Clicked:
    """An agent and the fragment it belongs to, or a text; unused fields are empty."""

    agent: str = ""
    owner: str = ""
    text: str = ""


def clicked(
    origin: NDArray[Any],
    direction: NDArray[Any],
    discs: DiscTable,
    texts: list[Texts],
    height: float,
) -> Clicked | None:
    """What a ray from the camera hits: discs of agents and texts on pins, or None."""
    disc, miss = _nearest(
        origin,
        direction,
        np.stack([discs.x, discs.y, discs.height / 2], axis=1),
        np.maximum(discs.radius, discs.height / 2),
    )
    # A pin is picked as a ball around its upper part.
    places = [
        (x, y, 0.7 * height) for batch in texts for x, y in zip(batch.x, batch.y, strict=True)
    ]
    pin, beside = _nearest(
        origin,
        direction,
        np.array(places, np.float64).reshape(-1, 3),
        np.full(len(places), 0.35 * height),
    )
    if min(miss, beside) > 1.0:
        return None
    if beside <= miss:
        return Clicked(text=[text for batch in texts for text in batch.texts][pin])
    return Clicked(discs.agent(disc), discs.owner(disc)) if discs.owner(disc) else None


def _nearest(
    origin: NDArray[Any], direction: NDArray[Any], places: NDArray[Any], reach: NDArray[Any]
) -> tuple[int, float]:
    """The position nearest to the ray, and its normalised distance: up to 1 is a hit."""
    if not len(places):
        return -1, np.inf
    ray = direction / np.linalg.norm(direction)
    to = places - origin
    along = to @ ray
    beside = np.linalg.norm(to - along[:, None] * ray, axis=1)
    miss = np.where(along > 0, beside / np.maximum(reach, _TOLERANCE * along), np.inf)
    best = int(np.argmin(miss))
    return best, float(miss[best])
