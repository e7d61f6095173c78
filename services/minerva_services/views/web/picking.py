"""Picking: the disc or text nearest to the ray of a click."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.picture import Copies, Texts
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
    copies: Sequence[Copies],
    texts: list[Texts],
    height: float,
) -> Clicked | None:
    """What a ray from the camera hits: discs and solids of agents, texts on pins, or None."""
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
    solids = [_nearest_copy(origin, direction, each) for each in copies]
    solid, off = min(solids, key=lambda hit: hit[1], default=(Clicked(), np.inf))
    if min(miss, beside, off) > 1.0:
        return None
    if off < min(miss, beside):
        return solid
    if beside <= miss:
        return Clicked(text=[text for batch in texts for text in batch.texts][pin])
    return Clicked(discs.agent(disc), discs.owner(disc)) if discs.owner(disc) else None


def _nearest_copy(
    origin: NDArray[Any], direction: NDArray[Any], copies: Copies
) -> tuple[Clicked, float]:
    """The solid of an agent nearest to the ray, as the ball within its bounding box."""
    low, high = copies.extents()
    # Scenery, such as a ground, is behind everything.
    owned = np.flatnonzero([bool(owner) for owner in copies.owners])
    middle, reach = ((low + high) / 2)[owned], ((high - low).max(axis=1) / 2)[owned]
    nearest, miss = _nearest(origin, direction, middle, reach)
    if nearest < 0:
        return Clicked(), miss
    row = int(owned[nearest])
    return Clicked(copies.agent(row), copies.owners[row]), miss


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
