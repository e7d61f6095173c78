"""The legend of windows and their pictures: swatches with texts, in rows."""

from __future__ import annotations

from functools import lru_cache

import pygame

from minerva_bus.grammar.appearance import Disc, Label, Line
from minerva_services.geometry.colors import Legend, LegendEntry, rgb
from minerva_services.views.layout import flow
from minerva_services.views.palette import BORDER, DARK, INK, OUTLINE, PANEL, PAPER
from minerva_services.views.sprites.text import one_line, pin, written

_FONT_SIZE = 19
_SWATCH, _SHADE = 16, 8
"""Side of a swatch, and width of each of several shades, in pixels."""
_PAD, _GAP, _ROW = 14, 20, 24


@lru_cache(maxsize=8)
def legend_strip(legend: Legend, width: int, ui: float) -> pygame.Surface:
    """The legend on paper, `width` pixels wide; `ui` scales letters and swatches."""
    texts = [written(one_line(entry.text), round(_FONT_SIZE * ui), INK) for entry in legend]
    swatches = [_swatch(entry, ui) for entry in legend]
    inner, gap, row = round(6 * ui), round(_GAP * ui), round(_ROW * ui)
    widths = [
        swatch.get_width() + inner + text.get_width()
        for swatch, text in zip(swatches, texts, strict=True)
    ]
    rows = flow(widths, width - 2 * round(_PAD * ui), gap)
    strip = pygame.Surface((width, len(rows) * row + round(8 * ui)), pygame.SRCALPHA, 32)
    strip.fill(PAPER)
    strip.fill(BORDER, (0, 0, width, max(1, round(ui))))
    for at, entries in enumerate(rows):
        left, middle = round(_PAD * ui), round(5 * ui) + (at + 0.5) * row
        for number in entries:
            for surface, shift in (
                (swatches[number], 0),
                (texts[number], swatches[number].get_width() + inner),
            ):
                strip.blit(surface, (left + shift, round(middle - surface.get_height() / 2)))
            left += round(widths[number]) + gap
    return strip


def _swatch(entry: LegendEntry, ui: float) -> pygame.Surface:
    if entry.swatch is Label:
        return pin(rgb(entry.colors[0]), 0.7 * ui)
    side, color = round(_SWATCH * ui), entry.colors[0]
    if len(entry.colors) > 1:
        shade = max(1, round(_SHADE * ui))
        surface = _blank((shade * len(entry.colors), side))
        for at, shown in enumerate(entry.colors):
            surface.fill(_over(shown, entry.opacity), (at * shade, 0, shade, side))
        return surface
    surface = _blank((round(1.6 * side) if entry.swatch is Line else side, side))
    if entry.swatch is Line:
        if entry.on_dark:
            surface.fill(DARK)
        _draw_line(surface, color, entry.dashed, max(2, round(3 * ui)))
    elif entry.swatch is Disc:
        _draw_disc(surface, color, entry.heading)
    else:
        surface.fill(_over(color, entry.opacity))
        pygame.draw.rect(surface, BORDER, surface.get_rect(), 1)
    return surface


def _blank(size: tuple[int, int]) -> pygame.Surface:
    return pygame.Surface(size, pygame.SRCALPHA, 32)


def _draw_line(surface: pygame.Surface, color: str, dashed: bool, thick: int) -> None:
    width, height = surface.get_size()
    top, dash = (height - thick) // 2, max(1, width // 5) if dashed else width
    for left in range(0, width, 2 * dash):
        surface.fill(rgb(color), (left, top, dash, thick))


def _draw_disc(surface: pygame.Surface, color: str, heading: bool) -> None:
    side = surface.get_height()
    middle, radius = (side / 2, side / 2), side / 2 - 1
    pygame.draw.aacircle(surface, OUTLINE, middle, radius)
    pygame.draw.aacircle(surface, rgb(color), middle, radius - 1)
    if heading:
        corners = [(0.85, 0.5), (0.25, 0.75), (0.38, 0.5), (0.25, 0.25)]
        pygame.draw.polygon(surface, "white", [(side * x, side * y) for x, y in corners])


def _over(color: str, opacity: float) -> tuple[int, ...]:
    """A transparent colour as it appears on a light floor."""
    pairs = zip(rgb(color), rgb(PANEL), strict=True)
    return tuple(round(opacity * over + (1 - opacity) * under) for over, under in pairs)
