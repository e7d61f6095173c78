"""The last orders of people in windows: names in their colours, orders and fates."""

from __future__ import annotations

from functools import lru_cache

import pygame

from minerva_services.views.fates import OrderEntry
from minerva_services.views.palette import BORDER, FAINT, INK, PANEL
from minerva_services.views.sprites.text import one_line, written

_FONT_SIZE = 18
_PAD, _GAP, _ROW = 9, 9, 21
_BAD, _GOOD = "#a3341f", "#22702f"
_STATES = {"done": _GOOD, "rejected": _BAD, "dropped": _BAD, "failed": _BAD, "replaced": _BAD}


@lru_cache(maxsize=8)
def order_strip(orders: tuple[OrderEntry, ...], ui: float) -> pygame.Surface:
    """A plate with one row for each order, the last one first; `ui` scales letters."""
    size = round(_FONT_SIZE * ui)
    rows = [
        (
            written(one_line(order.person), size, order.colour),
            written(one_line(order.short[0]), size, INK),
            written(one_line(order.short[1]), size, _STATES.get(order.state, FAINT)),
        )
        for order in reversed(orders)
    ]
    pad, gap, row = round(_PAD * ui), round(_GAP * ui), round(_ROW * ui)
    dot = round(5 * ui)
    left = pad + 2 * dot + round(0.8 * gap)
    columns = [max(texts[at].get_width() for texts in rows) for at in range(3)]
    width = left + sum(columns) + 2 * gap + pad
    strip = pygame.Surface((width, len(rows) * row + pad), pygame.SRCALPHA, 32)
    panel, line = pygame.Color(PANEL), pygame.Color(BORDER)
    pygame.draw.rect(strip, (*panel[:3], 235), strip.get_rect(), border_radius=pad // 2)
    pygame.draw.rect(strip, line, strip.get_rect(), max(1, round(ui)), border_radius=pad // 2)
    for number, (order, texts) in enumerate(zip(reversed(orders), rows, strict=True)):
        middle = pad / 2 + (number + 0.5) * row
        pygame.draw.aacircle(strip, order.colour, (pad + dot, round(middle)), dot)
        at = left
        for text, column in zip(texts, columns, strict=True):
            strip.blit(text, (at, round(middle - text.get_height() / 2)))
            at += column + gap
    return strip
