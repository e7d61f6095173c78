"""The map camera: metres with y up, and pixels with y down."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import TypeVar

import numpy as np

from minerva_bus.semantics.plane import Bounds
from minerva_services.geometry.picture import Discs, Picture, Tiles
from minerva_services.views.layout import extremes
from minerva_services.views.window.painter import Floats

Number = TypeVar("Number", float, Floats)
# Factor of the scale per step of the wheel.
_STEP = 1.2
_MIN_SCALE, _MAX_SCALE = 1e-6, 1e5
"""Limits of the scale in pixels per metre."""
# Metres beyond which an item does not extend the view.
_MAX_COORDINATE = 1e8
_DISC_MARGIN = 3.0
"""Margin in radii of the largest disc, so that a single robot does not fill the picture."""


@dataclass(frozen=True, slots=True)
class MapCamera:
    """Shows (`x`, `y`) at the centre of `size` pixels, with `scale` pixels per metre."""

    x: float = 0.0
    y: float = 0.0
    scale: float = 100.0
    size: tuple[int, int] = (1200, 800)

    def to_screen(self, x: Number, y: Number) -> tuple[Number, Number]:
        """Pixels from left and top of a position."""
        width, height = self.size
        return (x - self.x) * self.scale + width / 2, (self.y - y) * self.scale + height / 2

    def to_world(self, right: float, down: float) -> tuple[float, float]:
        """Position at a pixel."""
        width, height = self.size
        return (
            self.x + (right - width / 2) / self.scale,
            self.y - (down - height / 2) / self.scale,
        )

    def dragged(self, dx: float, dy: float) -> MapCamera:
        """The camera after dragging the world by pixels."""
        return replace(self, x=self.x - dx / self.scale, y=self.y + dy / self.scale)

    def zoomed(
        self, steps: float, at: tuple[float, float], scales: tuple[float, float]
    ) -> MapCamera:
        """Zoomed by steps within two scales; the point at the pixel stays in place."""
        x, y = self.to_world(*at)
        scale = min(max(self.scale * _STEP**steps, scales[0]), scales[1])
        grown = self.scale / scale
        return replace(self, x=x + (self.x - x) * grown, y=y + (self.y - y) * grown, scale=scale)

    def centred(self, x: float, y: float) -> MapCamera:
        """Centred on another position."""
        return replace(self, x=x, y=y)

    def resized(self, size: tuple[int, int]) -> MapCamera:
        """With another size in pixels."""
        return replace(self, size=size)

    def fitted(self, bounds: Bounds, padding: float) -> MapCamera:
        """The bounds centred and as large as possible, with a padding in pixels."""
        width, height = (max(side - 2 * padding, 1.0) for side in self.size)
        across = max(bounds.right - bounds.left, 1e-9)
        along = max(bounds.top - bounds.bottom, 1e-9)
        scale = min(max(min(width / across, height / along), _MIN_SCALE), _MAX_SCALE)
        middle = (bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2
        return MapCamera(*middle, scale, self.size)


def extent(picture: Picture, before: Bounds | None = None) -> Bounds | None:
    """The bounds to show: the matrices of a picture or, without any, everything.

    Without matrices it only grows from `before`, so that moving items do not shift the view.
    """
    tiles = [_of_points(*extremes(matrix)) for matrix in picture.of(Tiles) if matrix.cells.size]
    if tiles:
        return _around(tiles)
    points = [extremes(item) for item in picture.items if not isinstance(item, Tiles)]
    bounds = _around([_of_points(x, y) for x, y in points if len(x)])
    if bounds is None:
        return before
    # Compared without the margin, so that the view changes only when an item leaves it.
    if before is not None and before.around(bounds) == before:
        return before
    side = max(bounds.right - bounds.left, bounds.top - bounds.bottom)
    largest = max(
        (float(batch.radius.max()) for batch in picture.of(Discs) if len(batch)), default=0.0
    )
    margin = max(0.05 * side, _DISC_MARGIN * largest, 1e-3)
    wider = _grown(bounds, margin)
    return wider if before is None else before.around(wider)


def _of_points(x: Floats, y: Floats) -> Bounds:
    x, y = (
        np.clip(x, -_MAX_COORDINATE, _MAX_COORDINATE),
        np.clip(y, -_MAX_COORDINATE, _MAX_COORDINATE),
    )
    return Bounds(float(x.min()), float(y.min()), float(x.max()), float(y.max()))


def _around(boxes: list[Bounds]) -> Bounds | None:
    return reduce(Bounds.around, boxes) if boxes else None


def _grown(bounds: Bounds, by: float) -> Bounds:
    return Bounds(bounds.left - by, bounds.bottom - by, bounds.right + by, bounds.top + by)
