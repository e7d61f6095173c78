"""The legend of a picture in SVG: swatches with texts, in rows below the caption."""

from __future__ import annotations

from minerva_bus.grammar.appearance import Disc, Label, Line
from minerva_bus.semantics.colors import Legend, LegendEntry
from minerva_bus.semantics.poses import Pose
from minerva_services.views.layout import flow
from minerva_services.views.palette import BORDER, DARK, HEADING_MARK, INK, PANEL
from minerva_services.views.svg.markup import line_of_text, paint, short
from minerva_services.views.svg.page import PIN, Page

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
    if entry.shape is Line:
        return 1.6
    return max(1.0, 0.5 * len(entry.colors))


def _swatch(entry: LegendEntry) -> str:
    """A swatch one letter high around y = 0, from x = 0."""
    color = paint(entry.colors[0])
    if entry.shape is Disc:
        mark = ""
        if entry.heading:
            corners = [
                Pose(0.5, 0.0).then(0.0, 0.0, turn, 0.45 * far) for far, turn in HEADING_MARK
            ]
            points = " ".join(f"{short(at.x)},{short(at.y)}" for at in corners)
            mark = f'<polygon points="{points}" fill="#fff"/>'
        return (
            f'<circle cx=".5" r=".45" fill="{color}" stroke="#1d232b" stroke-opacity=".55"'
            f' stroke-width=".06"/>{mark}'
        )
    if entry.shape is Label:
        return f'<path d="{PIN}" transform="translate(.5 .5) scale(.045)" fill="{color}"/>'
    if entry.shape is Line:
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
        f'<rect {box} fill="none" stroke="{BORDER}" stroke-width=".06"/>'
    )
