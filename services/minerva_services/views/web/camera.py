"""Initial camera of a page: the whole world in view, from the south and above."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import numpy as np

from minerva_bus.semantics.bounds import Bounds
from minerva_bus.semantics.picture import Picture
from minerva_services.views.layout import extremes

FIELD = math.radians(40.0)
_STEEP = math.radians(66.0)
_ROOM = 1.06

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Position and target of a camera in metres."""

    position: Point
    look_at: Point


def bounds_of(picture: Picture) -> Bounds | None:
    """Bounds of everything that a picture shows; None if it is empty."""
    pairs = [extremes(item) for item in picture.items]
    boxes = [
        Bounds(float(x.min()), float(y.min()), float(x.max()), float(y.max()))
        for x, y in pairs
        if len(x)
    ]
    return reduce(Bounds.around, boxes) if boxes else None


def camera_pose(bounds: Bounds, height: float, aspect: float) -> CameraPose:
    """The nearest position from which a box on these bounds is completely visible."""
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
    return CameraPose(_point(place), _point(middle))


def _point(vector: np.ndarray) -> Point:
    x, y, z = vector.tolist()
    return x, y, z
