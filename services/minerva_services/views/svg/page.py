"""The layout of a picture: world metres with y up, and pixels with y down."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minerva_bus.grammar.appearance import Disc, Raster, Shape
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import BoundingGeometry, Bounds, resolve
from minerva_bus.semantics.poses import Pose
from minerva_services.views.layout import round_step

PIN = "M0 0L-6.6-12.4a8 8 0 1 1 13.2 0z"
"""Its tip is at the position itself, so that it does not hide what is there."""
LETTER_WIDTH = 0.7
"""Width of a character in font sizes, of a wide bold font: the viewer chooses the actual font."""
_MIN_ASPECT, _MAX_ASPECT = 0.25, 1.5
_MAX_COORDINATE = 1e8
_MARGIN = 0.05
_DISC_MARGIN = 3.0
"""Margin in radii of the largest disc, so that a single robot does not fill the picture."""


@dataclass(frozen=True, slots=True)
class Page:
    """A picture `width` pixels wide that shows a part of the world, the frame (metres)."""

    frame: Bounds
    width: int

    @property
    def padding(self) -> float:
        """Pixels around the frame."""
        return self.width * 0.025

    @property
    def font_size(self) -> float:
        """Pixels; readable at half the picture's width, as on a web page."""
        return self.width * 0.016

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return (self.width - 2 * self.padding) / (self.frame.right - self.frame.left)

    @property
    def panel(self) -> tuple[float, float]:
        """Width and height of the frame in pixels."""
        return self.width - 2 * self.padding, (self.frame.top - self.frame.bottom) * self.scale

    @property
    def height(self) -> int:
        """Pixels, including a caption below the frame."""
        return math.ceil(self.padding + self.panel[1] + 3 * self.font_size)

    @property
    def decimals(self) -> int:
        """Decimals of a metre required for a hundredth of a pixel."""
        return max(3, 1 + math.ceil(math.log10(self.scale)))

    @property
    def origin(self) -> Pose:
        """The world's origin relative to the frame's lower left corner.

        Drawings are relative to that corner, because renderers compute with 24 bits, too few for a
        small area far from the origin.
        """
        return Pose(-self.frame.left, -self.frame.bottom)

    def pixel(self, right: float, up: float) -> tuple[float, float]:
        """Pixel of a point given in metres from the frame's lower left corner."""
        bottom = self.padding + self.panel[1]
        return self.padding + right * self.scale, bottom - up * self.scale

    @property
    def grid_step(self) -> float:
        """Grid spacing in metres: 1, 2 or 5 times a power of ten."""
        return round_step((self.frame.right - self.frame.left) / 20)


class _DrawnBounds(BoundingGeometry):
    """Bounding box of a string's rasters or, without any, of everything it draws."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.has_raster = False
        self.largest_disc = 0.0

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        if isinstance(shape, Raster):
            # From the first raster on, only rasters count.
            if not self.has_raster:
                self.has_raster, self.bounds = True, None
        elif self.has_raster:
            return
        elif isinstance(shape, Disc):
            radius = resolve(shape.radius, figure.parameters)
            self.largest_disc = max(self.largest_disc, radius)
        super().shape(shape, figure)


def frame_of(scene: Scene, vocabulary: Vocabulary, before: Bounds | None = None) -> Bounds:
    """The part of the world to show: a string's rasters or, without any, everything it draws.

    Without rasters the frame only grows from `before`, so that a series of pictures does not jump.
    """
    extent = _DrawnBounds(vocabulary)
    interpret(scene, extent)
    if extent.bounds is None:
        return before or Bounds(-1.0, -1.0, 1.0, 1.0)
    drawn = _sized(extent.bounds)
    if extent.has_raster:
        return _within_aspect(drawn)
    # Compared without the margin, so that the frame changes only when something leaves it.
    if before is not None and before.around(drawn) == before:
        return before
    side = max(drawn.right - drawn.left, drawn.top - drawn.bottom)
    margin = max(_MARGIN * side, _DISC_MARGIN * extent.largest_disc)
    wider = _grown(drawn, margin, margin)
    return _within_aspect(wider if before is None else before.around(wider))


def _sized(bounds: Bounds) -> Bounds:
    """The bounds, limited to numbers that a picture can contain, and larger than a point."""
    sides = (bounds.left, bounds.bottom, bounds.right, bounds.top)
    left, bottom, right, top = (min(max(side, -_MAX_COORDINATE), _MAX_COORDINATE) for side in sides)
    frame = Bounds(left, bottom, right, top)
    return frame if max(right - left, top - bottom) > 1e-6 else _grown(frame, 1.0, 1.0)


def _within_aspect(frame: Bounds) -> Bounds:
    """The frame, enlarged if it would be too flat or too tall for a page."""
    width, height = frame.right - frame.left, frame.top - frame.bottom
    wider, taller = max(width, height / _MAX_ASPECT), max(height, width * _MIN_ASPECT)
    return _grown(frame, (wider - width) / 2, (taller - height) / 2)


def _grown(frame: Bounds, x: float, y: float) -> Bounds:
    return Bounds(frame.left - x, frame.bottom - y, frame.right + x, frame.top + y)
