"""A picture as an SVG document: layout, drawing, legend and safe markup.

The layout maps world metres with y up to pixels with y down. The geometric system draws each form
of a vocabulary; a matrix is one path for each colour, made of rectangles merged from its runs. The
legend has swatches with texts, in rows below the caption.
"""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass
from itertools import repeat
from typing import Any, TypeAlias
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.appearance import Disc, Label, Line, Raster, Shape
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import (
    BoundingGeometry,
    Bounds,
    PlaneGeometry,
    raster_corner,
    resolve,
    resolve_all,
)
from minerva_bus.semantics.poses import Pose
from minerva_bus.wording import xml_characters
from minerva_services.geometry.colors import (
    DrawnColors,
    Legend,
    LegendEntry,
    color_of,
    colors_of,
    paint,
)
from minerva_services.geometry.picture import text_parameter
from minerva_services.geometry.volumes import color_ranges, rectangles
from minerva_services.views.layout import (
    MAX_PLACED,
    Floats,
    LabelPlaces,
    Rectangle,
    cells_at,
    flow,
    round_step,
)
from minerva_services.views.names import MAX_NAMES
from minerva_services.views.palette import (
    BORDER,
    DARK,
    FAINT,
    HEADING_MARK,
    INK,
    OUTLINE,
    PANEL,
    PAPER,
)

FONTS = (
    "Inter, 'Segoe UI', 'Helvetica Neue', Arial, 'Liberation Sans', Roboto, Ubuntu, 'Noto Sans',"
    " 'DejaVu Sans', FreeSans, Aileron, sans-serif"
)
"""Fonts of browsers, desktops, a minimal Debian and Pillow (Aileron), in order of preference."""


def svg_document(
    scene: Scene,
    vocabulary: Vocabulary,
    page: Page,
    tracer: Tracer,
    title: str,
    subtitle: str,
    explained: Legend,
) -> str:
    """A string of L(E) as an SVG document, well-formed for any texts in the string."""
    drawing = Drawing(vocabulary, page, tracer)
    interpret(scene, drawing)
    left, bottom = page.pixel(0.0, 0.0)
    scale = exact(page.scale)
    width, height = page.width, math.ceil(page.height + legend_height(explained, page))
    title, subtitle = line_of_text(title), line_of_text(subtitle)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
            f' viewBox="0 0 {width} {height}" font-family="{FONTS}">',
            f"<title>{title}, {subtitle}</title>",
            f'<rect width="{width}" height="{height}" fill="{PAPER}"/>',
            f'<rect {_place(page)} fill="{PANEL}"/>',
            # Metres with y up, only for this group; everything after it is in pixels.
            f'<g transform="translate({exact(left)} {exact(bottom)}) scale({scale} -{scale})">',
            *drawing.elements,
            "</g>",
            _grid(page),
            _margins(page, height),
            # After the margins, which would hide labels at the border.
            *drawing.labels,
            _caption(page, title, subtitle),
            *([legend_markup(explained, page, page.height)] if explained else []),
            "</svg>\n",
        ]
    )


def _place(page: Page) -> str:
    width, height = map(short, page.panel)
    return f'x="{short(page.padding)}" y="{short(page.padding)}" width="{width}" height="{height}"'


def _grid(page: Page) -> str:
    """Faint lines at multiples of the grid spacing, on top of the drawing."""
    frame, step = page.frame, page.grid_step
    start, (width, height) = short(page.padding), map(short, page.panel)
    across = (page.pixel(x, 0.0)[0] for x in _multiples(frame.left, frame.right, step))
    along = (page.pixel(0.0, y)[1] for y in _multiples(frame.bottom, frame.top, step))
    lines = [f"M{short(x)} {start}v{height}" for x in across]
    lines += [f"M{start} {short(y)}h{width}" for y in along]
    return f'<path d="{"".join(lines)}" stroke="{INK}" stroke-opacity=".08"/>'


def _margins(page: Page, bottom: int) -> str:
    """Paper around the frame, which hides everything outside; a clip path renders slowly."""
    start, (width, height) = short(page.padding), map(short, page.panel)
    return (
        f'<path d="M0 0h{page.width}v{bottom}h-{page.width}z'
        f'M{start} {start}h{width}v{height}h-{width}z" fill="{PAPER}" fill-rule="evenodd"/>'
        f'<rect {_place(page)} fill="none" stroke="{BORDER}"/>'
    )


def _multiples(least: float, most: float, step: float) -> list[float]:
    """Multiples of a step between `least` and `most`, relative to `least`."""
    first, end = math.floor(least / step) + 1, math.ceil(most / step)
    return [n * step - least for n in range(first, end)]


def _caption(page: Page, title: str, subtitle: str) -> str:
    """The world's name and the frame on the left, the grid spacing on the right."""
    size = page.font_size * 0.9
    left, right = page.padding, page.width - page.padding
    line = page.padding + page.panel[1] + 1.75 * page.font_size
    bar = page.grid_step * page.scale
    start, middle, tick = right - bar, line - size * 0.35, size * 0.25
    return (
        f'<g font-size="{short(size)}" fill="{FAINT}">'
        f'<text x="{short(left)}" y="{short(line)}">'
        f'<tspan fill="{INK}" font-weight="600">{title}</tspan>'
        f'<tspan dx="{short(size * 0.7)}">{subtitle}</tspan></text>'
        f'<path d="M{short(start)} {short(middle - tick)}v{short(2 * tick)}m0-{short(tick)}'
        f'h{short(bar)}m0-{short(tick)}v{short(2 * tick)}" fill="none" stroke="{FAINT}"/>'
        f'<text x="{short(start - size * 0.6)}" y="{short(line)}" text-anchor="end">'
        f"{length_text(page.grid_step)}</text></g>"
    )


def length_text(metres: float) -> str:
    """A length in a unit that suits it."""
    return f"{metres / 1000:g} km" if metres >= 1000 else f"{metres:g} m"


_MIN_RADIUS = 3
_CROWD = 1000
"""Discs of a picture above which none has an outline."""
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


_SIDES = (
    'x="12" y="-10"',
    'x="-12" y="-10" text-anchor="end"',
    'y="-32" text-anchor="middle"',
    'y="19" text-anchor="middle"',
)
"""Places of a text beside its pin: right, left, above and below."""


def _places(text: str, scale: float, x: float, y: float) -> list[Rectangle]:
    """Rectangles of a text in pixels: those of `_SIDES`, and that of a name with its agent."""
    width = 20 * LETTER_WIDTH * len(text)
    half = width / 2
    corners = [(12, -26, 12 + width, -6), (-12 - width, -26, -12, -6), (-half, -48, half, -28),
               (-half, 3, half, 23), (-half, -16, half, 32)]  # fmt: skip
    return [
        (x + scale * left, y + scale * top, x + scale * right, y + scale * bottom)
        for left, top, right, bottom in corners
    ]


class Drawing(PlaneGeometry):
    """Turns a string of L(E) into SVG elements.

    `elements` are in metres from the frame's lower left corner, y up, in the order of the string
    but matrices first, because what an agent knows of the ground must not cover another agent;
    `labels`, which lie on top of everything, are in pixels of the page, y down.
    """

    def __init__(self, vocabulary: Vocabulary, page: Page, tracer: Tracer) -> None:
        super().__init__(vocabulary)
        self.pose = page.origin
        self._ground: list[str] = []
        self._things: list[str] = []
        self._discs = 0
        self._covered: list[Rectangle] = []
        self._pins: list[_Placed] = []
        self._floor: tuple[NDArray[Any], Pose, float] | None = None
        self._names: dict[str, _Placed] = {}
        self._marked: dict[str, str] = {}
        self._page = page
        self._tracer = tracer
        self._pixel = 1 / page.scale
        self._decimals = page.decimals

    @property
    def elements(self) -> list[str]:
        """Matrices, then everything else except labels."""
        # In a crowd the outlines would be all that is seen.
        outline = "none" if self._discs > _CROWD else OUTLINE
        return [
            *self._ground,
            f'<g stroke="{outline}" stroke-opacity=".55">',
            *self._things,
            "</g>",
        ]

    @property
    def labels(self) -> list[str]:
        """Labels on pins, then names of things with a heading unless there are too many."""
        names = [*self._names.values()] if len(self._names) <= MAX_NAMES else []
        page, scale = self._page, self._page.font_size / 20
        pins = [(pin.x - 8 * scale, pin.y - 28 * scale, pin.x + 8 * scale, pin.y)
                for pin in self._pins[:MAX_PLACED]]  # fmt: skip
        taken = (
            pins
            + self._covered
            + [_places(name.text, 0.9 * scale, name.x, name.y)[-1] for name in names]
        )
        frame = (page.padding, page.padding, page.width - page.padding, float(page.height))
        places = LabelPlaces(frame, taken, None if self._floor is None else self._floor_at)
        return [*(self._label(pin, places) for pin in self._pins), *map(self._name, names)]

    def _floor_at(self, right: Floats, down: Floats) -> Floats:
        """The cells of the floor at pixels of the page."""
        assert self._floor is not None
        page, bottom = self._page, self._page.padding + self._page.panel[1]
        metres = (right - page.padding) / page.scale, (bottom - down) / page.scale
        return cells_at(*self._floor, *metres)

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        if isinstance(shape, Disc):
            parameters, at = figure.parameters, self.pose
            name = text_parameter(self.vocabulary.primitives[figure.symbol])
            self._disc(
                shape.heading,
                _MIN_RADIUS * self._pixel,
                at.x,
                at.y,
                at.angle,
                resolve(shape.radius, parameters),
                color_of(shape.color, parameters),
                str(parameters[name]) if name else "",
            )
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

    def many(self, columns: Columns) -> bool:
        """Draw discs in columns without an object for each."""
        *around, inner = columns.levels()
        primitive = self.vocabulary.primitives.get(inner.symbol)
        if primitive is None or not isinstance(disc := primitive.shape, Disc):
            return False
        name, n = text_parameter(primitive), columns.count
        rows = (
            *[values.tolist() for values in self.poses(around, n)],
            resolve_all(disc.radius, inner).tolist(),
            colors_of(disc.color, inner),
            inner.column(name) if name and disc.heading else repeat(""),
        )
        # In a crowd, gaps are seen only if discs have their own size.
        least = (_MIN_RADIUS if n <= _CROWD else 0.5) * self._pixel
        for row in zip(*rows, strict=False):
            self._disc(disc.heading, least, *row)
        return True

    def _disc(
        self, heading: bool, least: float, x: float, y: float, angle: float, radius: float,
        color: str, name: str,
    ) -> None:  # fmt: skip
        # On the map of a city a robot would be smaller than a pixel and vanish.
        radius = max(radius, least)
        outline = min(1.6 * self._pixel, radius / 3)
        self._discs += 1
        if self._discs <= MAX_PLACED:
            (right, down), size = self._page.pixel(x, y), radius * self._page.scale
            self._covered.append((right - size, down - size, right + size, down + size))
        self._things.append(
            f'<circle cx="{self._m(x)}" cy="{self._m(y)}" r="{self._m(radius)}"'
            f' fill="{paint(color)}" stroke-width="{self._m(outline)}"/>'
        )
        if not heading:
            return
        at = Pose(x, y, angle)
        corners = [
            at.then(0.0, 0.0, direction, distance * radius) for distance, direction in HEADING_MARK
        ]
        points = " ".join(f"{self._m(corner.x)},{self._m(corner.y)}" for corner in corners)
        self._things.append(
            f'<polygon points="{points}" fill="#fff" fill-opacity=".95" stroke="none"/>'
        )
        if name and len(self._names) <= MAX_NAMES:
            right, down = self._page.pixel(x, y)
            away = down - radius * self._page.scale - 0.25 * self._page.font_size
            self._names.setdefault(name, _Placed(name, color, right, away))

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
            f' stroke-opacity="1" stroke-width="{self._m(width)}" stroke-linejoin="round"'
            ' stroke-linecap="round"'
            f"{dashes if line.dashed else ''}/>"
        )

    def _raster(self, raster: Raster, figure: FigureNode) -> None:
        parameters = figure.parameters
        corner = raster_corner(raster, parameters, self.pose)
        cell = resolve(raster.cell, parameters)
        # The first matrix is the ground of everything else.
        self._floor = self._floor or (parameters[raster.cells], corner, cell)
        paths = self._tracer.paths(parameters[raster.cells], raster.colors)
        self._ground += [
            # Without anti-aliasing, so that no seams appear between neighbouring rectangles.
            f'<g transform="translate({exact(corner.x)} {exact(corner.y)})'
            f' rotate({exact(corner.angle)}) scale({exact(cell)})"'
            f' fill-opacity="{short(raster.opacity)}" shape-rendering="crispEdges">',
            *(f'<path fill="{paint(color)}" d="{data}"/>' for color, data in paths),
            "</g>",
        ]

    def _label(self, label: _Placed, places: LabelPlaces) -> str:
        marked = self._marked.get(label.text, "")
        scale = self._page.font_size / 20 * (_MARKED if marked else 1)
        at = places.choose(_places(label.text, scale, label.x, label.y)[:4], label.x, label.y)
        return (
            f'<g transform="translate({short(label.x)} {short(label.y)}) scale({short(scale)})">'
            f'<path d="{PIN}" fill="{paint(marked or label.color)}" stroke="#fff"'
            f' stroke-width="1.2"/><circle cy="-17" r="3" fill="#fff"/>'
            f'<text {_SIDES[at]} {_TEXT} fill="{paint(marked or INK)}" paint-order="stroke">'
            f"{line_of_text(label.text)}</text></g>"
        )

    def _name(self, name: _Placed) -> str:
        scale = self._page.font_size / 20 * 0.9
        return (
            f'<g transform="translate({short(name.x)} {short(name.y)}) scale({short(scale)})">'
            f'<text text-anchor="middle" {_TEXT} fill="{INK}" paint-order="stroke">'
            f"{line_of_text(name.text)}</text></g>"
        )

    def _m(self, metres: float) -> str:
        return short(metres, self._decimals)


_LETTER_WIDTH = 0.6
"""Width of a character in font sizes: the viewer chooses the font."""
_SIZE, _ROW, _GAP, _INNER = 0.8, 1.5, 1.4, 0.45
"""Sizes in letters of the page: letters, rows, and the spaces between and within entries."""


def legend_rows(legend: Legend, page: Page) -> list[list[int]]:
    """Numbers of the entries in each row of the page."""
    em = page.font_size * _SIZE
    widths = [_width(entry, em) for entry in legend]
    return flow(widths, page.width - 2 * page.padding, em * _GAP)


def legend_height(legend: Legend, page: Page) -> float:
    """Height of the legend in pixels."""
    rows = len(legend_rows(legend, page))
    return (rows + 0.3) * page.font_size * _ROW if rows else 0.0


def legend_markup(legend: Legend, page: Page, top: float) -> str:
    """The legend as SVG; `top` in pixels."""
    em, row = page.font_size * _SIZE, page.font_size * _ROW
    parts: list[str] = []
    for at, entries in enumerate(legend_rows(legend, page)):
        left, middle = page.padding, top + (at + 0.5) * row
        for number in entries:
            entry = legend[number]
            wide = _swatch_width(entry)
            parts.append(
                f'<g transform="translate({short(left)} {short(middle)}) scale({short(em)})">'
                f"{_swatch(entry)}</g>"
                f'<text x="{short(left + (wide + _INNER) * em)}" y="{short(middle + 0.36 * em)}">'
                f"{line_of_text(entry.text)}</text>"
            )
            left += _width(entry, em) + em * _GAP
    return f'<g class="legend" font-size="{short(em)}" fill="{INK}">{"".join(parts)}</g>'


def _width(entry: LegendEntry, em: float) -> float:
    return em * (_swatch_width(entry) + _INNER + _LETTER_WIDTH * len(entry.text))


def _swatch_width(entry: LegendEntry) -> float:
    if entry.swatch is Line:
        return 1.6
    return max(1.0, 0.5 * len(entry.colors))


def _swatch(entry: LegendEntry) -> str:
    """A swatch one letter high around y = 0, from x = 0."""
    color = paint(entry.colors[0])
    if entry.swatch is Disc:
        mark = ""
        if entry.heading:
            corners = [
                Pose(0.5, 0.0).then(0.0, 0.0, turn, 0.45 * far) for far, turn in HEADING_MARK
            ]
            points = " ".join(f"{short(at.x)},{short(at.y)}" for at in corners)
            mark = f'<polygon points="{points}" fill="#fff"/>'
        return (
            f'<circle cx=".5" r=".45" fill="{color}" stroke="{OUTLINE}" stroke-opacity=".55"'
            f' stroke-width=".06"/>{mark}'
        )
    if entry.swatch is Label:
        return (
            f'<path d="{PIN}" transform="translate(.5 .5) scale(.045)" fill="{color}"'
            f' stroke="{OUTLINE}" stroke-opacity=".55" stroke-width="1.3"/>'
        )
    if entry.swatch is Line:
        dashes = ' stroke-dasharray=".32"' if entry.dashed else ""
        ground = f'<rect y="-.4" width="1.6" height=".8" fill="{DARK}"/>' if entry.on_dark else ""
        return f'{ground}<path d="M0 0h1.6" stroke="{color}" stroke-width=".2"{dashes}/>'
    side = 1.0 if len(entry.colors) == 1 else 0.5
    whole = side * len(entry.colors)
    cells = "".join(
        f'<rect x="{short(at * side)}" y="-.5" width="{short(side)}" height="1"'
        f' fill="{paint(shade)}" fill-opacity="{short(entry.opacity)}"/>'
        for at, shade in enumerate(entry.colors)
    )
    box = f'y="-.5" width="{short(whole)}" height="1"'
    return (
        f'<rect {box} fill="{PANEL}"/>{cells}'
        f'<rect {box} fill="none" stroke="{OUTLINE}" stroke-opacity=".55" stroke-width=".06"/>'
    )


PIN = "M0 0L-6.6-12.4a8 8 0 1 1 13.2 0z"
"""Its tip is at the position itself, so that it does not hide what is there."""
LETTER_WIDTH = 0.7
"""Width of a character in font sizes, of a wide bold font: the viewer chooses the actual font."""
_LEAST_FONT = 12.5
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
        """Pixels; large pictures are readable at half their width, small ones as they are."""
        return max(self.width * 0.016, _LEAST_FONT)

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
    """Bounding box of a string's rasters or, without any, of everything it draws.

    Its primitives and their colours are added to `drawn`.
    """

    def __init__(self, vocabulary: Vocabulary, drawn: DrawnColors) -> None:
        super().__init__(vocabulary)
        self.has_raster = False
        self.largest_disc = 0.0
        self._drawn = drawn

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        self._drawn.figure(figure.symbol, shape, figure.parameters)
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

    def many(self, columns: Columns) -> bool:
        """Include discs in columns at once."""
        *around, inner = columns.levels()
        primitive = self.vocabulary.primitives.get(inner.symbol)
        if primitive is None or not isinstance(disc := primitive.shape, Disc):
            return False
        self._drawn.columns(inner.symbol, disc.color, inner)
        if not self.has_raster and columns.count:
            (x, y, _), radius = self.poses(around, columns.count), resolve_all(disc.radius, inner)
            least = [float((at - radius).min()) for at in (x, y)]
            drawn = Bounds(*least, *[float((at + radius).max()) for at in (x, y)])
            self.bounds = drawn if self.bounds is None else self.bounds.around(drawn)
            self.largest_disc = max(self.largest_disc, float(radius.max()))
        return True


def frame_of(
    scene: Scene,
    vocabulary: Vocabulary,
    before: Bounds | None = None,
    drawn: DrawnColors | None = None,
) -> Bounds:
    """The part of the world to show: a string's rasters or, without any, everything it draws.

    Without rasters the frame only grows from `before`, so that a series of pictures does not jump.
    What the string draws is added to `drawn`.
    """
    extent = _DrawnBounds(vocabulary, DrawnColors() if drawn is None else drawn)
    interpret(scene, extent)
    if extent.bounds is None:
        return before or Bounds(-1.0, -1.0, 1.0, 1.0)
    framed = _sized(extent.bounds)
    if extent.has_raster:
        return _within_aspect(framed)
    # Compared without the margin, so that the frame changes only when something leaves it.
    if before is not None and before.around(framed) == before:
        return before
    side = max(framed.right - framed.left, framed.top - framed.bottom)
    margin = max(_MARGIN * side, _DISC_MARGIN * extent.largest_disc)
    wider = _grown(framed, margin, margin)
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


_MAX_NUMBER = 1e9


def short(value: float, decimals: int = 3) -> str:
    """A number rounded to `decimals` and limited to 1e9, beyond which renderers fail.

    The default suits pixels; lengths that are multiplied by the picture's scale need more.
    """
    return f"{round(min(max(value, -_MAX_NUMBER), _MAX_NUMBER), decimals):.15g}"


def exact(value: float) -> str:
    """A number with all significant digits, for values multiplied by large numbers."""
    return f"{min(max(value, -_MAX_NUMBER), _MAX_NUMBER):.12g}"


def line_of_text(text: str, longest: int = 60) -> str:
    """A text on one line as XML character data: escaped, and shortened if too long."""
    # The first cut bounds the work for texts of any length.
    shown = " ".join(xml_characters(text[: 4 * longest]).split())
    return escape(shown if len(shown) <= longest else shown[: longest - 1] + "…")


Colors: TypeAlias = tuple[tuple[int, str], ...]
"""Lowest value and colour of each range, ascending, as in `Raster.colors`."""
Paths: TypeAlias = tuple[tuple[str, str], ...]
"""A colour and the path data of all its cells; cell [row, column] is the unit square at them."""
Numbers: TypeAlias = NDArray[np.int64]


class Tracer:
    """Traces matrices, and caches the paths of read-only ones while the matrix exists.

    A map is the same array in every picture, so only the first one costs time.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[int, Colors], tuple[weakref.ref[NDArray[Any]], Paths]] = {}

    def paths(self, cells: NDArray[Any], colors: Colors) -> Paths:
        """The paths of a matrix (rows, columns) in the colours of its values."""
        key = id(cells), colors
        known = self._known.get(key)
        if known is not None and known[0]() is cells:
            return known[1]
        paths = trace(cells, colors)
        # A writeable matrix may change in place, so its paths cannot be cached.
        if not cells.flags.writeable:
            forget = weakref.ref(cells, lambda _: self._known.pop(key, None))
            self._known[key] = forget, paths
        return paths


def trace(cells: NDArray[Any], colors: Colors) -> Paths:
    """The paths of a matrix (rows, columns), x along its rows and y along its columns.

    Each cell is in exactly one path, or in none if its value has no colour.
    """
    drawn = np.array([False, *(color != "" for _, color in colors)])
    tone, *columns = rectangles(color_ranges(cells, colors), drawn)
    tones = np.arange(1, len(colors) + 1)
    first = np.searchsorted(tone, tones, "left")
    last = np.searchsorted(tone, tones, "right")
    return tuple(
        (color, _path_data(*(numbers[first[at] : last[at]] for numbers in columns)))
        for at, (_, color) in enumerate(colors)
        if first[at] < last[at]
    )


def _path_data(row: Numbers, column: Numbers, rows: Numbers, columns: Numbers) -> str:
    """`M<row> <column>h<rows>v<columns>h-<rows>z` for each rectangle, all at once.

    Texts of equal width form a byte matrix; padding zero bytes are removed at the end.
    """
    height, width = _digits(rows), _digits(columns)
    pieces = ["M", _digits(row), " ", _digits(column), "h", height, "v", width, "h-", height, "z"]
    table = np.concatenate([_repeated(piece, row.size) for piece in pieces], axis=1)
    return table[table != 0].tobytes().decode("ascii")


def _repeated(piece: str | NDArray[np.uint8], times: int) -> NDArray[np.uint8]:
    if not isinstance(piece, str):
        return piece
    return np.tile(np.frombuffer(piece.encode("ascii"), np.uint8), (times, 1))


def _digits(numbers: Numbers) -> NDArray[np.uint8]:
    """Decimal digits of non-negative numbers (n,) as ASCII (n, width), padded with zero bytes."""
    powers = 10 ** np.arange(len(str(numbers.max())) - 1, -1, -1)
    digits = (numbers[:, None] // powers % 10 + ord("0")).astype(np.uint8)
    # Leading zeros; the last digit stays, so 0 remains "0".
    digits[:, :-1][numbers[:, None] < powers[:-1]] = 0
    return digits
