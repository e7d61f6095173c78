"""Where places of the world are on the screen: metres, y up, and pixels, y down."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from minerva_bus.semantics.bounds import Bounds
from minerva_bus.semantics.picture import Discs, Item, Picture, Polyline, Texts, Tiles
from minerva_services.views.window.painter import Floats

Number = TypeVar("Number", float, Floats)
_STEP = 1.2
_FARTHEST, _NEAREST = 1e-6, 1e5
"""Pixels for a metre."""
_REACH = 1e8
_LONE = 3.0
"""Radii of the largest disc: a lone robot must not fill the picture."""


@dataclass(frozen=True, slots=True)
class Camera:
    """Shows (`x`, `y`) in the middle of `size` pixels, `scale` pixels for a metre."""

    x: float = 0.0
    y: float = 0.0
    scale: float = 100.0
    size: tuple[int, int] = (1200, 800)

    def to_screen(self, x: Number, y: Number) -> tuple[Number, Number]:
        """Pixels from the left and from the top of a place."""
        width, height = self.size
        return (x - self.x) * self.scale + width / 2, (self.y - y) * self.scale + height / 2

    def to_world(self, right: float, down: float) -> tuple[float, float]:
        """The place at a pixel."""
        width, height = self.size
        return (
            self.x + (right - width / 2) / self.scale,
            self.y - (down - height / 2) / self.scale,
        )

    def dragged(self, dx: float, dy: float) -> Camera:
        """The world moved by so many pixels."""
        return replace(self, x=self.x - dx / self.scale, y=self.y + dy / self.scale)

    def zoomed(self, steps: float, at: tuple[float, float], scales: tuple[float, float]) -> Camera:
        """Nearer by so many steps, between two scales; what is at the pixel stays there."""
        x, y = self.to_world(*at)
        scale = min(max(self.scale * _STEP**steps, scales[0]), scales[1])
        grown = self.scale / scale
        return replace(self, x=x + (self.x - x) * grown, y=y + (self.y - y) * grown, scale=scale)

    def centred(self, x: float, y: float) -> Camera:
        """The same, with another place in the middle."""
        return replace(self, x=x, y=y)

    def resized(self, size: tuple[int, int]) -> Camera:
        """The same on another number of pixels."""
        return replace(self, size=size)

    def fitted(self, bounds: Bounds, padding: float) -> Camera:
        """The bounds in the middle, as large as they go, with pixels left free around them."""
        width, height = (max(one - 2 * padding, 1.0) for one in self.size)
        across = max(bounds.right - bounds.left, 1e-9)
        along = max(bounds.top - bounds.bottom, 1e-9)
        scale = min(max(min(width / across, height / along), _FARTHEST), _NEAREST)
        middle = (bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2
        return Camera(*middle, scale, self.size)


def extent(picture: Picture, before: Bounds | None = None) -> Bounds | None:
    """The rectangle to show: around the matrices of a picture or, where it has none, around all.

    Without matrices it only grows from `before`, so that what moves does not move the rest.
    """
    tiles = [_of_tiles(one) for one in picture.of(Tiles) if one.cells.size]
    if tiles:
        return _around(tiles)
    points = [_points(item) for item in picture.items]
    found = _around([_of_points(x, y) for x, y in points if len(x)])
    if found is None:
        return before
    if before is not None and before.around(found) == before:
        return before
    side = max(found.right - found.left, found.top - found.bottom)
    largest = max((float(one.radius.max()) for one in picture.of(Discs) if len(one)), default=0.0)
    margin = max(0.05 * side, _LONE * largest, 1e-3)
    wider = _grown(found, margin)
    return wider if before is None else before.around(wider)


def _points(item: Item) -> tuple[Floats, Floats]:
    """Points (n,) and (n,) that an item lies within; none for a matrix."""
    if isinstance(item, Polyline):
        return item.points[:, 0], item.points[:, 1]
    if isinstance(item, Discs):
        r = item.radius
        return np.concatenate([item.x - r, item.x + r]), np.concatenate([item.y - r, item.y + r])
    return (item.x, item.y) if isinstance(item, Texts) else (np.empty(0), np.empty(0))


def _of_points(x: Floats, y: Floats) -> Bounds:
    x, y = np.clip(x, -_REACH, _REACH), np.clip(y, -_REACH, _REACH)
    return Bounds(float(x.min()), float(y.min()), float(x.max()), float(y.max()))


def _of_tiles(tiles: Tiles) -> Bounds:
    across, along = tiles.size
    steps = (0.0, 0.0), (across, 0.0), (0.0, along), (across, along)
    corners = [tiles.pose.then(x, y, 0.0, 0.0) for x, y in steps]
    return _of_points(np.array([one.x for one in corners]), np.array([one.y for one in corners]))


def _around(bounds: list[Bounds]) -> Bounds | None:
    found = bounds[0] if bounds else None
    for one in bounds[1:]:
        found = one.around(found) if found is not None else one
    return found


def _grown(bounds: Bounds, by: float) -> Bounds:
    return Bounds(bounds.left - by, bounds.bottom - by, bounds.right + by, bounds.top + by)
