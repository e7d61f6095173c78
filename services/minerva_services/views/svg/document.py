"""A complete picture: paper, drawing of a string, grid, labels and caption."""

from __future__ import annotations

import math

from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.colors import legend
from minerva_bus.semantics.geometry import interpret
from minerva_services.views.palette import BORDER, FAINT, INK, PANEL, PAPER
from minerva_services.views.svg.drawing import Drawing
from minerva_services.views.svg.legend import legend_height, legend_markup
from minerva_services.views.svg.markup import exact, line_of_text, short
from minerva_services.views.svg.page import Page
from minerva_services.views.svg.tracing import Tracer

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
    drawn: set[str],
) -> str:
    """A string of L(E) as an SVG document, well-formed for any texts in the string.

    The legend explains this picture, and the primitives that `drawn` has from previous ones; those
    of this picture are added to it.
    """
    drawing = Drawing(vocabulary, page, tracer)
    interpret(scene, drawing)
    left, bottom = page.pixel(0.0, 0.0)
    scale = exact(page.scale)
    drawn |= drawing.drawn
    explained = legend(vocabulary, drawn)
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
        f"{page.grid_step:g} m</text></g>"
    )
