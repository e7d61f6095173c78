"""The overlay: status line, notices, orders and help."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pygame

from minerva_services.geometry.colors import Legend
from minerva_services.views.layout import round_step
from minerva_services.views.palette import BORDER, FAINT, INK, PANEL, PAPER
from minerva_services.views.sprites.camera import MapCamera
from minerva_services.views.sprites.text import one_line, written
from minerva_services.views.window.legend_strip import legend_strip
from minerva_services.views.window.order_strip import order_strip
from minerva_services.views.window.painter import Sight

_LINE_HEIGHT = 34
_FONT_SIZE = 21


def bar_height(ui: float) -> int:
    """Height of the status line in pixels."""
    return round(_LINE_HEIGHT * ui)


def overlay_height(legend: Legend, width: int, ui: float) -> int:
    """Height of the status line and of the legend above it, in pixels."""
    strip = legend_strip(legend, width, ui).get_height() if legend else 0
    return bar_height(ui) + strip


def grid_step(camera: MapCamera) -> float:
    """Grid spacing in metres: 1, 2 or 5 times a power of ten, about 20 lines per screen."""
    wanted = camera.size[0] / camera.scale / 20
    return round_step(wanted * (1 - 1e-9))  # tolerate rounding of the scale


def draw_grid(canvas: pygame.Surface, camera: MapCamera) -> None:
    """Faint lines at multiples of the grid spacing."""
    width, height = camera.size
    step, shade = grid_step(camera), pygame.Color(INK)
    left, top = camera.to_world(0, 0)
    right, bottom = camera.to_world(width, height)
    # As surfaces, because pygame draws lines without transparency.
    upright = pygame.Surface((1, height), pygame.SRCALPHA, 32)
    level = pygame.Surface((width, 1), pygame.SRCALPHA, 32)
    for line in (upright, level):
        line.fill((shade.r, shade.g, shade.b, 17))
    xs = range(math.ceil(left / step), math.floor(right / step) + 1)
    ys = range(math.ceil(bottom / step), math.floor(top / step) + 1)
    canvas.fblits([(upright, (round(camera.to_screen(n * step, 0.0)[0]), 0)) for n in xs])
    canvas.fblits([(level, (0, round(camera.to_screen(0.0, n * step)[1]))) for n in ys])


def draw_overlay(canvas: pygame.Surface, sight: Sight, camera: MapCamera, ui: float) -> None:
    """Draw the whole overlay."""
    width, height = canvas.get_size()
    below = overlay_height(sight.legend, width, ui)
    if sight.legend:
        canvas.blit(legend_strip(sight.legend, width, ui), (0, height - below))
    _draw_bar(canvas, sight, camera, ui)
    if sight.orders:
        strip, pad = order_strip(sight.orders, ui), round(12 * ui)
        canvas.blit(strip, (width - strip.get_width() - pad, pad))
    if sight.notice:
        _draw_notice(canvas, sight.notice, below, ui)
    if sight.help:
        _draw_help(canvas, sight.help, below, ui)


def _draw_bar(canvas: pygame.Surface, sight: Sight, camera: MapCamera, ui: float) -> None:
    width, height = canvas.get_size()
    bar, size, pad = bar_height(ui), round(_FONT_SIZE * ui), round(14 * ui)
    canvas.fill(PAPER, (0, height - bar, width, bar))
    canvas.fill(BORDER, (0, height - bar, width, max(1, round(ui))))
    title = written(one_line(sight.caption), size, INK)
    rest = written(one_line(sight.subtitle, 160), size, FAINT)
    line = height - bar / 2
    _put(canvas, title, pad, line)
    step = grid_step(camera)
    long = step * camera.scale
    name = written(f"{step:g} m", size, FAINT)
    begin = width - pad - long
    hint = written(sight.hint, size, INK)
    room = begin - 2 * pad - name.get_width()
    if sight.hint:
        room -= hint.get_width() + pad
        _put(canvas, hint, room + pad / 2, line)
    start = pad + title.get_width() + pad
    # A long subtitle must not run into the scale.
    canvas.set_clip((0, height - bar, max(0, round(room)), bar))
    _put(canvas, rest, start, line)
    canvas.set_clip(None)
    _put(canvas, name, begin - pad / 2 - name.get_width(), line)
    thick, tick = max(1, round(1.2 * ui)), round(4 * ui)
    canvas.fill(FAINT, (round(begin), round(line), round(long), thick))
    for end in (begin, width - pad - thick):
        canvas.fill(FAINT, (round(end), round(line - tick), thick, 2 * tick + thick))


def _put(canvas: pygame.Surface, text: pygame.Surface, left: float, middle: float) -> None:
    canvas.blit(text, (round(left), round(middle - text.get_height() / 2)))


def _draw_notice(canvas: pygame.Surface, notice: str, below: int, ui: float) -> None:
    size, pad = round(_FONT_SIZE * ui), round(12 * ui)
    text = written(one_line(notice, 120), size, "#ffffff")
    width, height = text.get_width() + 2 * pad, text.get_height() + pad
    box = pygame.Surface((width, height), pygame.SRCALPHA, 32)
    shade = pygame.Color(INK)
    pygame.draw.rect(box, (shade.r, shade.g, shade.b, 225), box.get_rect(), border_radius=pad // 2)
    box.blit(text, (pad, pad // 2))
    canvas.blit(box, (pad, canvas.get_height() - below - height - pad))


def _draw_help(
    canvas: pygame.Surface, lines: Sequence[tuple[str, str]], below: int, ui: float
) -> None:
    size, pad = round(_FONT_SIZE * ui), round(22 * ui)
    keys = [written(key, size, INK) for key, _ in lines]
    meanings = [written(one_line(meaning), size, FAINT) for _, meaning in lines]
    column = max(text.get_width() for text in keys) + pad
    row = round(1.45 * size)
    width = column + max(text.get_width() for text in meanings) + 2 * pad
    height = row * len(lines) + 2 * pad
    box = pygame.Surface((width, height), pygame.SRCALPHA, 32)
    panel, line = pygame.Color(PANEL), pygame.Color(BORDER)
    pygame.draw.rect(box, (panel.r, panel.g, panel.b, 252), box.get_rect(), border_radius=pad // 2)
    pygame.draw.rect(box, line, box.get_rect(), max(1, round(ui)), border_radius=pad // 2)
    for at, (key, meaning) in enumerate(zip(keys, meanings, strict=True)):
        middle = pad + (at + 0.5) * row
        _put(box, key, pad, middle)
        _put(box, meaning, pad + column, middle)
    room = canvas.get_height() - below
    canvas.blit(box, ((canvas.get_width() - width) // 2, max(0, (room - height) // 2)))
