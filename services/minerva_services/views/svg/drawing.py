"""The geometric system of pictures: draws each form of a vocabulary in SVG."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minerva_bus.grammar.appearance import Disc, Line, Raster, Shape
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.picture import text_parameter
from minerva_bus.semantics.plane import PlaneGeometry, raster_corner, resolve
from minerva_services.views.names import MAX_NAMES
from minerva_services.views.palette import HEADING_MARK, INK
from minerva_services.views.svg.markup import exact, line_of_text, paint, short
from minerva_services.views.svg.page import LETTER_WIDTH, PIN, Page
from minerva_services.views.svg.tracing import Tracer

_MIN_RADIUS = 3
_MARKED = 1.3
"""Relative size of a marked label."""
_TEXT = 'font-size="20" font-weight="600" stroke="#fff" stroke-width="4.5" stroke-linejoin="round"'


@dataclass(frozen=True, slots=True)
class _Placed:
    """A text with its position in pixels of the page."""

    text: str
    color: str
    x: float
    y: float


class Drawing(PlaneGeometry):
    """Turns a string of L(E) into SVG elements.

    `elements` are in metres from the frame's lower left corner, y up, in the order of the string
    but matrices first, because what an agent knows of the ground must not cover another agent;
    `labels`, which lie on top of everything, are in pixels of the page, y down. `drawn` are the
    symbols of the primitives, for a legend.
    """

    def __init__(self, vocabulary: Vocabulary, page: Page, tracer: Tracer) -> None:
        super().__init__(vocabulary)
        self.pose = page.origin
        self._ground: list[str] = []
        self._things: list[str] = []
        self.drawn: set[str] = set()
        self._pins: list[_Placed] = []
        self._names: dict[str, _Placed] = {}
        self._marked: dict[str, str] = {}
        self._page = page
        self._tracer = tracer
        self._pixel = 1 / page.scale
        self._decimals = page.decimals

    @property
    def elements(self) -> list[str]:
        """Matrices, then everything else except labels."""
        return self._ground + self._things

    @property
    def labels(self) -> list[str]:
        """Labels on pins, then names of things with a heading unless there are too many."""
        names = self._names.values() if len(self._names) <= MAX_NAMES else ()
        return [*map(self._label, self._pins), *map(self._name, names)]

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        self.drawn.add(figure.symbol)
        if isinstance(shape, Disc):
            self._disc(shape, figure)
        elif isinstance(shape, Line):
            self._line(shape, figure)
        elif isinstance(shape, Raster):
            self._raster(shape, figure)
        else:
            text = str(figure.parameters[shape.text])
            if shape.marks:
                self._marked[text] = shape.color
            else:
                self._pins.append(
                    _Placed(text, shape.color, *self._page.pixel(self.pose.x, self.pose.y))
                )

    def _disc(self, disc: Disc, figure: FigureNode) -> None:
        at = self.pose
        # On the map of a city a robot would be smaller than a pixel and vanish.
        radius = max(resolve(disc.radius, figure.parameters), _MIN_RADIUS * self._pixel)
        outline = min(1.6 * self._pixel, radius / 3)
        self._things.append(
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
            self._things.append(f'<polygon points="{points}" fill="#fff" fill-opacity=".95"/>')
            if name := text_parameter(self.vocabulary.primitives[figure.symbol]):
                text, (x, y) = str(figure.parameters[name]), self._page.pixel(at.x, at.y)
                away = y - radius * self._page.scale - 0.25 * self._page.font_size
                self._names.setdefault(text, _Placed(text, disc.color, x, away))

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
        self._things.append(
            f'<polyline points="{points}" fill="none" stroke="{paint(line.color)}"'
            f' stroke-width="{self._m(width)}" stroke-linejoin="round" stroke-linecap="round"'
            f"{dashes if line.dashed else ''}/>"
        )

    def _raster(self, raster: Raster, figure: FigureNode) -> None:
        parameters = figure.parameters
        corner = raster_corner(raster, parameters, self.pose)
        cell = resolve(raster.cell, parameters)
        paths = self._tracer.paths(parameters[raster.cells], raster.colors)
        self._ground += [
            # Without anti-aliasing, so that no seams appear between neighbouring rectangles.
            f'<g transform="translate({exact(corner.x)} {exact(corner.y)})'
            f' rotate({exact(corner.angle)}) scale({exact(cell)})"'
            f' fill-opacity="{short(raster.opacity)}" shape-rendering="crispEdges">',
            *(f'<path fill="{paint(color)}" d="{data}"/>' for color, data in paths),
            "</g>",
        ]

    def _label(self, label: _Placed) -> str:
        marked = self._marked.get(label.text, "")
        scale = self._page.font_size / 20 * (_MARKED if marked else 1)
        return (
            f'<g transform="translate({short(label.x)} {short(label.y)}) scale({short(scale)})">'
            f'<path d="{PIN}" fill="{paint(marked or label.color)}" stroke="#fff"'
            f' stroke-width="1.2"/><circle cy="-17" r="3" fill="#fff"/>'
            f"{self._beside_pin(label, marked or INK)}</g>"
        )

    def _name(self, name: _Placed) -> str:
        scale = self._page.font_size / 20 * 0.9
        return (
            f'<g transform="translate({short(name.x)} {short(name.y)}) scale({short(scale)})">'
            f'<text text-anchor="middle" {_TEXT} fill="{INK}" paint-order="stroke">'
            f"{line_of_text(name.text)}</text></g>"
        )

    def _beside_pin(self, label: _Placed, color: str) -> str:
        """The text to the right of its pin, or to its left if the picture is too narrow."""
        page = self._page
        ends_at = label.x + page.font_size * (0.6 + LETTER_WIDTH * len(label.text))
        side = 'x="-12" text-anchor="end"' if ends_at > page.width - page.padding else 'x="12"'
        return (
            f'<text {side} y="-10" {_TEXT} fill="{paint(color)}" paint-order="stroke">'
            f"{line_of_text(label.text)}</text>"
        )

    def _m(self, metres: float) -> str:
        return short(metres, self._decimals)
