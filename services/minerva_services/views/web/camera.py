"""From where a page looks at a world: all of it in sight, from the south and above."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from minerva_bus.semantics.bounds import Bounds
from minerva_bus.semantics.picture import Discs, Item, Picture, Polyline, Texts, Tiles

FIELD = math.radians(40.0)
_STEEP = math.radians(66.0)
_ROOM = 1.06

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Outlook:
    """Where the camera is and what it looks at, metres."""

    position: Point
    look_at: Point


def bounds_of(picture: Picture) -> Bounds | None:
    """The rectangle around all that a picture shows; None where that is nothing."""
    found: Bounds | None = None
    for item in picture.items:
        x, y = _extremes(item)
        if len(x):
            one = Bounds(float(x.min()), float(y.min()), float(x.max()), float(y.max()))
            found = one if found is None else found.around(one)
    return found


def _extremes(item: Item) -> tuple[np.ndarray, np.ndarray]:
    if isinstance(item, Discs):
        return (
            np.concatenate([item.x - item.radius, item.x + item.radius]),
            np.concatenate([item.y - item.radius, item.y + item.radius]),
        )
    if isinstance(item, Polyline):
        return item.points[:, 0], item.points[:, 1]
    if isinstance(item, Texts):
        return item.x, item.y
    assert isinstance(item, Tiles)
    width, depth = item.size
    corners = [item.pose.then(x, y, 0.0, 0.0) for x in (0.0, width) for y in (0.0, depth)]
    return np.array([one.x for one in corners]), np.array([one.y for one in corners])


def outlook(bounds: Bounds, height: float, aspect: float) -> Outlook:
    """The nearest place from which a box of a height on a rectangle is seen as a whole."""
    width, depth = bounds.right - bounds.left, bounds.top - bounds.bottom
    middle = np.array([(bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2, 0.0])
    ahead = np.array([0.0, math.cos(_STEEP), -math.sin(_STEEP)])
    above = np.array([0.0, math.sin(_STEEP), math.cos(_STEEP)])
    tall, wide = math.tan(FIELD / 2), math.tan(FIELD / 2) * max(aspect, 0.1)
    distance = 0.1
    for x in (-width / 2, width / 2):
        for y in (-depth / 2, depth / 2):
            for z in (0.0, height):
                corner = np.array([x, y, z])
                needed = max(abs(x) / wide, abs(float(corner @ above)) / tall)
                distance = max(distance, needed - float(corner @ ahead))
    place = middle - ahead * distance * _ROOM
    return Outlook(_point(place), _point(middle))


def _point(vector: np.ndarray) -> Point:
    x, y, z = vector.tolist()
    return x, y, z
