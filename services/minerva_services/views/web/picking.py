"""What a click in the world means: the disc or the text that is nearest to its ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.picture import Texts
from minerva_services.views.web.movers import Bodies

_NEAR = 0.012
"""How far beside a thing a click may be, as an angle in radians: ten pixels or so."""


@dataclass(frozen=True, slots=True)
class Clicked:
    """An agent with the fragment it belongs to, or a text; the others are empty."""

    agent: str = ""
    owner: str = ""
    text: str = ""


def clicked(
    origin: NDArray[Any], direction: NDArray[Any], found: Bodies, texts: list[Texts], height: float
) -> Clicked | None:
    """What a ray from the eye hits: agents' discs, and texts on pins of a height; or None."""
    disc, miss = _nearest(
        origin,
        direction,
        np.stack([found.x, found.y, found.height / 2], axis=1),
        np.maximum(found.radius, found.height / 2),
    )
    places = [(x, y, 0.7 * height) for one in texts for x, y in zip(one.x, one.y, strict=True)]
    pin, beside = _nearest(
        origin,
        direction,
        np.array(places, np.float64).reshape(-1, 3),
        np.full(len(places), 0.35 * height),
    )
    if min(miss, beside) > 1.0:
        return None
    if beside <= miss:
        return Clicked(text=[text for one in texts for text in one.texts][pin])
    return Clicked(found.agent(disc), found.owner(disc)) if found.owner(disc) else None


def _nearest(
    origin: NDArray[Any], direction: NDArray[Any], places: NDArray[Any], reach: NDArray[Any]
) -> tuple[int, float]:
    """Which place the ray passes nearest, and how near: up to 1 is a hit."""
    if not len(places):
        return -1, np.inf
    ray = direction / np.linalg.norm(direction)
    to = places - origin
    along = to @ ray
    beside = np.linalg.norm(to - along[:, None] * ray, axis=1)
    miss = np.where(along > 0, beside / np.maximum(reach, _NEAR * along), np.inf)
    best = int(np.argmin(miss))
    return best, float(miss[best])
