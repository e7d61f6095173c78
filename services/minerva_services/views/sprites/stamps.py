"""Discs as sprites: drawn once at a larger scale, downscaled, and reused for equal discs."""

from __future__ import annotations

import math

import numpy as np
import pygame
from numpy.typing import NDArray

from minerva_services.geometry.picture import Discs
from minerva_services.views.palette import HEADING_MARK, OUTLINE
from minerva_services.views.sprites.camera import MapCamera

_SCALE = 4
"""Supersampling factor of sprites."""
_MAX_RADIUS = 160
"""Radius in pixels above which discs are drawn directly."""
_MAX_SMOOTH, _MAX_EDGE = 4000.0, 400_000.0
"""Radius in pixels up to which edges are smoothed, and up to which edges are drawn at all."""
# In pixels, so that discs stay visible on a map of a city.
_MIN_RADIUS = 3.0
_DIRECTIONS = 128
"""Number of directions for which sprites are drawn."""
_MAX_CACHED = 6000


class Stamps:
    """Draws discs in batches."""

    def __init__(self) -> None:
        self._sprites: dict[int, pygame.Surface] = {}

    def draw(self, canvas: pygame.Surface, discs: Discs, camera: MapCamera, ui: float) -> None:
        """Draw the visible discs in order; `ui` is the scale of the overlay."""
        x, y = camera.to_screen(discs.x, discs.y)
        radius = np.maximum(discs.radius * camera.scale, _MIN_RADIUS * ui)
        width, height = camera.size
        seen = (x + radius > 0) & (x - radius < width) & (y + radius > 0) & (y - radius < height)
        rows = np.flatnonzero(seen)
        large = np.flatnonzero(radius[rows] > _MAX_RADIUS)
        begin = 0
        for end in [*large, len(rows)]:  # large discs split the batch, to keep the order
            self._stamp(canvas, discs, rows[begin:end], (x, y, radius), ui)
            if end < len(rows):
                row = int(rows[end])
                place = float(x[row]), float(y[row]), float(radius[row])
                _draw_large(canvas, discs, row, place, ui)
            begin = end + 1

    def _stamp(
        self,
        canvas: pygame.Surface,
        discs: Discs,
        rows: NDArray[np.intp],
        places: tuple[NDArray[np.float64], ...],
        ui: float,
    ) -> None:
        x, y, radius = (column[rows] for column in places)
        keys = _keys(discs, rows, radius)
        # Many discs share few sprites: look up each sprite once.
        different, which = np.unique(keys, return_inverse=True)
        # Zooming creates new sizes all the time; the current ones are quickly drawn again.
        if len(self._sprites) > _MAX_CACHED:
            self._sprites.clear()
        sprites = [self._sprite(int(key), ui) for key in different]
        half = np.array([sprite.get_width() / 2 for sprite in sprites])[which]
        left = np.rint(x - half).astype(int).tolist()
        top = np.rint(y - half).astype(int).tolist()
        stamped = [sprites[index] for index in which.tolist()]
        canvas.fblits(
            list(zip(stamped, zip(left, top, strict=True), strict=True)),
            pygame.BLEND_PREMULTIPLIED,
        )

    def _sprite(self, key: int, ui: float) -> pygame.Surface:
        sprite = self._sprites.get(key)
        if sprite is None:
            sprite = self._sprites[key] = _drawn(key, ui)
        return sprite


def _keys(discs: Discs, rows: NDArray[np.intp], radius: NDArray[np.float64]) -> NDArray[np.int64]:
    """One integer per row for its colour, radius (in half pixels) and direction."""
    red, green, blue = discs.color[rows].astype(np.int64).T
    heading = discs.heading[rows]
    turn = np.rint(discs.angle[rows] * (_DIRECTIONS / 360)).astype(np.int64) % _DIRECTIONS
    color = (red << 16) | (green << 8) | blue
    # At most 16 bits, see _MAX_RADIUS, so the parts of a key do not overlap.
    halves = np.rint(radius * 2).astype(np.int64)
    return (color << 24) | (halves << 8) | np.where(heading, turn + 1, 0)


def _drawn(key: int, ui: float) -> pygame.Surface:
    """A sprite with premultiplied alpha."""
    color = pygame.Color((key >> 40) & 255, (key >> 32) & 255, (key >> 24) & 255)
    radius, turn = ((key >> 8) & 0xFFFF) / 2, key & 255
    side = 2 * math.ceil(radius + 1.5 * ui)
    fine = pygame.Surface((side * _SCALE, side * _SCALE), pygame.SRCALPHA, 32)
    _disc(
        fine,
        color,
        (side * _SCALE / 2, side * _SCALE / 2),
        radius * _SCALE,
        ui * _SCALE,
    )
    if turn:
        middle = side * _SCALE / 2, side * _SCALE / 2
        angle = (turn - 1) * 360 / _DIRECTIONS
        pygame.draw.polygon(fine, "white", _arrow(middle, radius * _SCALE, angle))
    return pygame.transform.smoothscale(fine, (side, side))


def _disc(
    surface: pygame.Surface,
    color: pygame.Color,
    middle: tuple[float, float],
    radius: float,
    ui: float,
) -> None:
    line, edge = min(1.6 * ui, radius / 3), pygame.Color(OUTLINE)
    # Premultiplied: 55 % opaque.
    rim = pygame.Color(*(round(0.55 * channel) for channel in (edge.r, edge.g, edge.b, 255)))
    pygame.draw.circle(surface, rim, middle, radius + line / 2)
    pygame.draw.circle(surface, color.lerp(edge, 0.55), middle, radius)
    pygame.draw.circle(surface, color, middle, radius - line / 2)


def _arrow(middle: tuple[float, float], radius: float, angle: float) -> list[tuple[float, float]]:
    points: list[tuple[float, float]] = []
    for distance, direction in HEADING_MARK:
        turn = math.radians(angle + direction)
        points.append(
            (
                middle[0] + distance * radius * math.cos(turn),
                middle[1] - distance * radius * math.sin(turn),
            )
        )
    return points


def _draw_large(
    canvas: pygame.Surface, discs: Discs, row: int, place: tuple[float, float, float], ui: float
) -> None:
    x, y, radius = place
    color = pygame.Color(*map(int, discs.color[row]))
    if radius > _MAX_EDGE:  # every edge is off screen, or practically straight
        width, height = canvas.get_size()
        if math.hypot(x - width / 2, y - height / 2) < radius:
            canvas.fill(color)
        return
    circle = pygame.draw.aacircle if radius < _MAX_SMOOTH else pygame.draw.circle
    circle(canvas, color.lerp(pygame.Color(OUTLINE), 0.55), (x, y), radius)
    circle(canvas, color, (x, y), radius - 1.6 * ui)
    if discs.heading[row]:
        pygame.draw.polygon(canvas, "white", _arrow((x, y), radius, float(discs.angle[row])))
