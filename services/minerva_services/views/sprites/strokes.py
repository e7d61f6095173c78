"""Lines, dashed or solid, and laser beams."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pygame

from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Polyline
from minerva_services.views.palette import BEAM
from minerva_services.views.sprites.camera import MapCamera
from minerva_services.views.window.painter import Beams, Floats

_MIN_WIDTH = 1.6
_DASH = 2.5
"""Length of a dash in line widths."""
_MAX_DASHES = 4000
_MAX_COORDINATE = 1e6
"""Coordinates in pixels are clamped to this."""


def draw_line(canvas: pygame.Surface, line: Polyline, camera: MapCamera, ui: float) -> None:
    """Draw a line through its points."""
    if len(line.points) < 2:
        return
    x, y = camera.to_screen(line.points[:, 0], line.points[:, 1])
    # pygame converts coordinates to C integers, which larger ones would overflow.
    points = np.clip(np.stack([x, y], axis=1), -_MAX_COORDINATE, _MAX_COORDINATE)
    width = max(line.form.width * camera.scale, _MIN_WIDTH * ui)
    parts = dashes(points, _DASH * width) if line.form.dashed else [points]
    color, seen = (
        pygame.Color(*rgb(line.form.color)),
        canvas.get_rect().inflate(4 * width, 4 * width),
    )
    for part in parts:
        low, high = part.min(axis=0), part.max(axis=0)
        if seen.colliderect((*low, *(high - low + 1))):
            _draw_part(canvas, part, color, width)


def _draw_part(canvas: pygame.Surface, points: Floats, color: pygame.Color, width: float) -> None:
    thick = max(1, round(width))
    corners = [(float(x), float(y)) for x, y in points]
    for start, end in pairwise(corners):
        pygame.draw.aaline(canvas, color, start, end, thick)
    if thick > 2:  # round joints only: round ends would make dashes look like bones
        for corner in corners[1:-1]:
            pygame.draw.aacircle(canvas, color, corner, (thick - 1) / 2)


def dashes(points: Floats, length: float) -> list[Floats]:
    """The dashes of a line through points (n, 2), separated by gaps of equal length."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    total = float(along[-1])
    if total <= 0 or length <= 0 or total / length > _MAX_DASHES:
        return [points]
    parts: list[Floats] = []
    for start in np.arange(0.0, total, 2 * length):
        end = min(start + length, total)
        # A dash bends at the corners that lie within it.
        inner = points[(along > start) & (along < end)]
        ends = [
            np.array([np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1])])
            for at in (start, end)
        ]
        parts.append(np.stack([ends[0], *inner, ends[1]]))
    return parts


def draw_beams(
    canvas: pygame.Surface, beams: Sequence[Beams], camera: MapCamera, ui: float
) -> None:
    """Draw laser beams as one transparent layer, so that overlaps do not darken."""
    if not beams:
        return
    layer = pygame.Surface(canvas.get_size(), pygame.SRCALPHA, 32)
    color = pygame.Color(BEAM)
    layer.fill((color.r, color.g, color.b, 0))
    for fan in beams:
        _draw_fan(layer, fan, camera, color, ui)
    canvas.blit(layer, (0, 0))


def _draw_fan(
    layer: pygame.Surface, beams: Beams, camera: MapCamera, color: pygame.Color, ui: float
) -> None:
    x, y = (
        np.clip(axis, -_MAX_COORDINATE, _MAX_COORDINATE)
        for axis in camera.to_screen(beams.ends[:, 0], beams.ends[:, 1])
    )
    start = camera.to_screen(beams.x, beams.y)
    ends = list(zip(x.tolist(), y.tolist(), strict=True))
    if len(ends) > 2:
        pygame.draw.polygon(layer, (color.r, color.g, color.b, 26), [start, *ends])
    for end in ends:
        pygame.draw.aaline(layer, (color.r, color.g, color.b, 105), start, end)
    for end, hit in zip(ends, beams.hits, strict=True):
        if hit:
            pygame.draw.circle(layer, (color.r, color.g, color.b, 230), end, 2.2 * ui)
