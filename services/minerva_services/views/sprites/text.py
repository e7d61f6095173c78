"""Text in pygame's own font, identical on all machines, and labels on pins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import pygame

from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Picture, Texts, Tiles
from minerva_services.views.layout import MAX_PLACED, Floats, Ground, LabelPlaces, cells_at
from minerva_services.views.names import AgentName
from minerva_services.views.palette import INK
from minerva_services.views.sprites.camera import MapCamera
from minerva_services.views.window.painter import Box

_MAX_CHARACTERS = 60
_LABEL_SIZE = 17
"""Font size of labels in pixels."""
_MARKED = 1.3
"""Relative size of a marked label."""
_SCALE = 4


def font(size: int) -> pygame.font.Font:
    """pygame's font at a size in pixels."""
    if not pygame.font.get_init():
        pygame.font.init()
        # Fonts from before the module was shut down are no longer valid.
        _font.cache_clear()
    return _font(size)


@lru_cache(maxsize=64)
def _font(size: int) -> pygame.font.Font:
    return pygame.font.Font(None, size)


def one_line(text: str, longest: int = _MAX_CHARACTERS) -> str:
    """Printable text on one line, shortened if too long."""
    # The first cut bounds the work for texts of any length.
    shown = " ".join("".join(c if c.isprintable() else " " for c in text[: 4 * longest]).split())
    return shown if len(shown) <= longest else shown[: longest - 1] + "…"


@lru_cache(maxsize=512)
def written(text: str, size: int, color: str) -> pygame.Surface:
    """Rendered text in a colour."""
    return font(size).render(text, True, color)


@lru_cache(maxsize=512)
def with_halo(text: str, size: int, color: str, halo: int) -> pygame.Surface:
    """Text with a white outline in pixels, legible on any background."""
    letters, white = written(text, size, color), written(text, size, "#ffffff")
    width, height = letters.get_size()
    surface = pygame.Surface((width + 2 * halo, height + 2 * halo), pygame.SRCALPHA, 32)
    for turn in np.linspace(0, 2 * np.pi, 16, endpoint=False):
        place = halo + round(halo * np.cos(turn)), halo + round(halo * np.sin(turn))
        surface.blit(white, place)
    surface.blit(letters, (halo, halo))
    return surface


@lru_cache(maxsize=64)
def pin(color: tuple[int, int, int], size: float) -> pygame.Surface:
    """A pin whose tip is at the middle of the lower edge; premultiplied colours."""
    unit = size * _SCALE
    width, height = 20 * unit, 28 * unit
    fine = pygame.Surface((round(width), round(height)), pygame.SRCALPHA, 32)
    middle, tip = (width / 2, height - 17 * unit), (width / 2, height - 0.5 * unit)
    # First in white and larger, as an outline.
    for paint, edge in (((255, 255, 255), 1.3), (color, 0.0)):
        reach = (8 + edge) * unit
        pygame.draw.circle(fine, paint, middle, reach)
        side, down = 0.83 * reach, 0.56 * reach
        pygame.draw.polygon(
            fine,
            paint,
            [
                (middle[0] - side, middle[1] + down),
                (middle[0] + side, middle[1] + down),
                (tip[0], tip[1] - (0 if edge else 2.4 * unit)),
            ],
        )
    pygame.draw.circle(fine, "#ffffff", middle, 3 * unit)
    return pygame.transform.smoothscale(fine, (round(20 * size), round(28 * size)))


def draw_labels(
    canvas: pygame.Surface, picture: Picture, camera: MapCamera, ui: float, names: Sequence[Box]
) -> list[Box]:
    """Draw a picture's labels on pins at their positions; returns their boxes on the screen.

    Marked labels are larger and have another colour. They leave `names` free.
    """
    pins = [pin for texts in picture.of(Texts) for pin in _pins(texts, camera, ui)]
    taken = [(x - 8 * ui, y - 28 * ui, x + 8 * ui, y) for _, _, x, y in pins[:MAX_PLACED]]
    # Names are above their agents, which labels should not cover, either.
    taken += [(name.left, name.top, name.right, name.bottom + 28 * ui) for name in names]
    width, height = camera.size
    places = LabelPlaces((0.0, 0.0, width - 4 * ui, float(height)), taken, _ground(picture, camera))
    marked = picture.marked()
    boxes: list[Box] = []
    for text, color, *place in pins:
        sign = marked.get(text, "")
        shown = (sign, sign, _MARKED * ui) if sign else (color, INK, ui)
        boxes.append(_draw_label(canvas, text, *shown, (place[0], place[1]), places))
    return boxes


def _pins(texts: Texts, camera: MapCamera, ui: float) -> Iterator[tuple[str, str, float, float]]:
    """Text, colour and pixel of each label that may be on the screen."""
    x, y = camera.to_screen(texts.x, texts.y)
    width, height = camera.size
    for text, right, down in zip(texts.texts, x.tolist(), y.tolist(), strict=True):
        if -width < right < 2 * width and -50 * ui < down < height + 50 * ui:
            yield str(text), texts.form.color, right, down


def _ground(picture: Picture, camera: MapCamera) -> Ground | None:
    """What the floor of a picture, its first matrix, has at a pixel."""
    floors = picture.of(Tiles)[:1]
    if not floors:
        return None
    cells, pose, cell = floors[0].cells, floors[0].pose, floors[0].cell
    width, height = camera.size

    def ground(right: Floats, down: Floats) -> Floats:
        x = camera.x + (right - width / 2) / camera.scale
        return cells_at(cells, pose, cell, x, camera.y - (down - height / 2) / camera.scale)

    return ground


def draw_names(
    canvas: pygame.Surface, names: Sequence[AgentName], camera: MapCamera, ui: float
) -> list[Box]:
    """Draw agents' names above their discs; returns their boxes on the screen."""
    boxes: list[Box] = []
    for name in names:
        x, y = camera.to_screen(name.x, name.y)
        letters = with_halo(one_line(name.text), round(1.15 * _LABEL_SIZE * ui), INK, round(2 * ui))
        width, height = letters.get_size()
        # A selected agent has a ring around its disc.
        away = max(name.radius * camera.scale, 3 * ui) + 7 * ui
        left, top = round(x - width / 2), round(y - away - height)
        canvas.blit(letters, (left, top))
        boxes.append(Box(name.text, left, top, left + width, top + height, names_agent=True))
    return boxes


def _draw_label(
    canvas: pygame.Surface,
    text: str,
    color: str,
    ink: str,
    ui: float,
    place: tuple[float, float],
    places: LabelPlaces,
) -> Box:
    sign, x, y = pin(rgb(color), ui), place[0], place[1]
    letters = with_halo(one_line(text), round(1.3 * _LABEL_SIZE * ui), ink, max(1, round(2 * ui)))
    left, top = x - sign.get_width() / 2, y - sign.get_height()
    canvas.blit(sign, (round(left), round(top)), special_flags=pygame.BLEND_PREMULTIPLIED)
    wide, tall = letters.get_size()
    beside = y - 17 * ui - tall / 2
    corners = [
        (x + 10 * ui, beside),
        (x - 10 * ui - wide, beside),
        (x - wide / 2, top - tall),
        (x - wide / 2, y + 2 * ui),
    ]
    boxes = [(left, top, left + wide, top + tall) for left, top in corners]
    begin, line = corners[places.choose(boxes, x, y)]
    canvas.blit(letters, (round(begin), round(line)))
    return Box(
        text,
        min(left, begin),
        min(top, line),
        max(left + sign.get_width(), begin + wide),
        max(y, line + tall),
    )
