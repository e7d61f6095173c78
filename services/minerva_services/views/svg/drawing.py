"""The geometric system of pictures: draws each form of a vocabulary in SVG."""

from __future__ import annotations

import math

from minerva_bus.grammar.forms import Disc, Label, Line, Raster, Shape
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.plane import PlaneGeometry, raster_corner, resolve
from minerva_services.views.palette import HEADING_MARK
from minerva_services.views.svg.markup import exact, line_of_text, paint, short
from minerva_services.views.svg.page import Page
from minerva_services.views.svg.tracing import Tracer

_MIN_RADIUS = 3
_LETTER_WIDTH = 0.7
"""Width of a character in font sizes, of a wide bold font: the viewer chooses the actual font."""
_PIN = "M0 0L-6.6-12.4a8 8 0 1 1 13.2 0z"
"""Its tip is at the position itself, so that it does not hide what is there."""


class Drawing(PlaneGeometry):
    """Turns a string of L(E) into SVG elements.

    `elements` are in metres from the frame's lower left corner, y up, in the order of the string;
    `labels`, which lie on top of everything, are in pixels of the page, y down.
    """

    def __init__(self, vocabulary: Vocabulary, page: Page, tracer: Tracer) -> None:
        super().__init__(vocabulary)
        self.pose = page.origin
        self.elements: list[str] = []
        self.labels: list[str] = []
        self._page = page
        self._tracer = tracer
        self._pixel = 1 / page.scale
        self._decimals = page.decimals

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        if isinstance(shape, Disc):
            self._disc(shape, figure)
        elif isinstance(shape, Line):
            self._line(shape, figure)
        elif isinstance(shape, Raster):
            self._raster(shape, figure)
        else:
            self._label(shape, figure)

    def _disc(self, disc: Disc, figure: FigureNode) -> None:
        at = self.pose
        # On the map of a city a robot would be smaller than a pixel and vanish.
        radius = max(resolve(disc.radius, figure.parameters), _MIN_RADIUS * self._pixel)
        outline = min(1.6 * self._pixel, radius / 3)
        self.elements.append(
            f'<circle cx="{self._m(at.x)}" cy="{self._m(at.y)}" r="{self._m(radius)}"'
            f' fill="{paint(disc.color)}" stroke="#1d232b" stroke-opacity=".55"'
            f' stroke-width="{self._m(outline)}"/>'
        )
        if disc.heading:
            corners = (
                at.then(0.0, 0.0, direction, distance * radius)
                for distance, direction in HEADING_MARK
            )
            points = " ".join(f"{self._m(corner.x)},{self._m(corner.y)}" for corner in corners)
            self.elements.append(f'<polygon points="{points}" fill="#fff" fill-opacity=".95"/>')

    def _line(self, line: Line, figure: FigureNode) -> None:
        parameters = figure.parameters
        at, turn = self.pose, math.radians(self.pose.angle)
        cos, sin = math.cos(turn), math.sin(turn)
        points = " ".join(
            f"{self._m(at.x + x * cos - y * sin)},{self._m(at.y + x * sin + y * cos)}"
            for x, y in zip(parameters[line.xs], parameters[line.ys], strict=False)
        )
        width = max(line.width, 1.5 * self._pixel)
        dashes = f' stroke-dasharray="{self._m(2.5 * width)} {self._m(2.5 * width)}"'
        self.elements.append(
            f'<polyline points="{points}" fill="none" stroke="{paint(line.color)}"'
            f' stroke-width="{self._m(width)}" stroke-linejoin="round" stroke-linecap="round"'
            f"{dashes if line.dashed else ''}/>"
        )

    def _raster(self, raster: Raster, figure: FigureNode) -> None:
        parameters = figure.parameters
        corner = raster_corner(raster, parameters, self.pose)
        cell = resolve(raster.cell, parameters)
        paths = self._tracer.paths(parameters[raster.cells], raster.colors)
        self.elements += [
            # Without anti-aliasing, so that no seams appear between neighbouring rectangles.
            f'<g transform="translate({exact(corner.x)} {exact(corner.y)})'
            f' rotate({exact(corner.angle)}) scale({exact(cell)})"'
            f' fill-opacity="{short(raster.opacity)}" shape-rendering="crispEdges">',
            *(f'<path fill="{paint(color)}" d="{data}"/>' for color, data in paths),
            "</g>",
        ]

    def _label(self, label: Label, figure: FigureNode) -> None:
        size = self._page.font_size
        x, y = self._page.pixel(self.pose.x, self.pose.y)
        text = line_of_text(str(figure.parameters[label.text]))
        self.labels.append(
            f'<g transform="translate({short(x)} {short(y)}) scale({short(size / 20)})">'
            f'<path d="{_PIN}" fill="{paint(label.color)}" stroke="#fff" stroke-width="1.2"/>'
            f'<circle cy="-17" r="3" fill="#fff"/>'
            f"{self._beside_pin(text, x)}</g>"
        )

    def _beside_pin(self, text: str, x: float) -> str:
        """The text to the right of its pin, or to its left if the picture is too narrow."""
        page = self._page
        ends_at = x + page.font_size * (0.6 + _LETTER_WIDTH * len(text))
        side = 'x="-12" text-anchor="end"' if ends_at > page.width - page.padding else 'x="12"'
        return (
            f'<text {side} y="-10" font-size="20" font-weight="600" fill="#2f3640" stroke="#fff"'
            f' stroke-width="4.5" stroke-linejoin="round" paint-order="stroke">{text}</text>'
        )

    def _m(self, metres: float) -> str:
        return short(metres, self._decimals)
