"""The geometric system of sprites: draws display lists on pygame surfaces."""

from __future__ import annotations

import numpy as np
import pygame

from minerva_bus.semantics.plane import Bounds
from minerva_services.geometry.colors import Legend
from minerva_services.geometry.picture import Discs, Picture, Polyline, Tiles
from minerva_services.views.palette import CHOSEN, PAPER
from minerva_services.views.sprites.camera import MapCamera, extent
from minerva_services.views.sprites.matrices import MatrixLayer
from minerva_services.views.sprites.overlay import draw_grid, draw_overlay, overlay_height
from minerva_services.views.sprites.stamps import Stamps
from minerva_services.views.sprites.strokes import draw_beams, draw_line
from minerva_services.views.sprites.text import draw_labels, draw_names
from minerva_services.views.window.painter import Box, Floats, Pixels, Sight
from minerva_services.views.window.picking import spot_of
from minerva_services.views.window.screen import close_window, open_window

_PADDING = 22
# Pixels of a window in which the overlay has its nominal size.
_REFERENCE_SIZE = 1200, 800
_MAX_ZOOM_OUT, _MAX_ZOOM_IN = 50.0, 200.0
"""Zoom limits relative to showing the whole world."""


class SpritePainter:
    """A `Painter` that shows the world from above."""

    def __init__(self) -> None:
        self.camera = MapCamera()
        self._canvas = pygame.Surface((1, 1), 0, 32)
        self._windowed = False
        self._bounds: Bounds | None = None
        self._aimed = False
        """The user has moved the camera; it no longer follows the world's bounds."""
        self._ground = MatrixLayer()
        self._stamps = Stamps()
        self._boxes: list[Box] = []
        self._ui = 1.0
        self._fitted = self.camera.scale

    def open(self, title: str, size: tuple[int, int]) -> None:
        self._canvas = open_window("sprites", title, size)
        self._windowed = True
        self.resized(self._canvas.get_size())

    def offscreen(self, size: tuple[int, int]) -> None:
        self._canvas = pygame.Surface(size, 0, 32)
        self.resized(size)

    def resized(self, size: tuple[int, int]) -> None:
        if self._windowed:
            self._canvas = pygame.display.get_surface() or self._canvas
        ui = min(max(min(size[0] / _REFERENCE_SIZE[0], size[1] / _REFERENCE_SIZE[1]), 0.8), 3.0)
        # Cached sprites have outlines of the old size.
        if ui != self._ui:
            self._ui, self._stamps = ui, Stamps()
        self._make_room(())

    def _make_room(self, legend: Legend) -> None:
        """Leave the lower edge to the overlay, which has a legend at times."""
        width, height = self._canvas.get_size()
        room = max(height - overlay_height(legend, width, self._ui), 1)
        if self.camera.size != (width, room):
            self.camera = self.camera.resized((width, room))

    def draw(self, sight: Sight) -> None:
        self._make_room(sight.legend)
        self._aim(sight)
        canvas, picture = self._canvas, sight.picture
        # A surface of its own, so that no item can cover the status line.
        self._world = canvas.subsurface((0, 0, *self.camera.size))
        canvas.fill(PAPER)
        for tiles in picture.of(Tiles):  # matrices are the ground for everything else
            self._ground.draw(self._world, tiles, self.camera)
        self._ground.forget_unused()
        draw_grid(self._world, self.camera)
        draw_beams(self._world, sight.beams, self.camera, self._ui)
        self._draw_items(picture)
        self._draw_chosen(picture, sight.selected)
        self._boxes = draw_names(self._world, sight.names, self.camera, self._ui)
        self._boxes += draw_labels(self._world, picture, self.camera, self._ui, self._boxes)
        draw_overlay(canvas, sight, self.camera, self._ui)
        if self._windowed:
            pygame.display.flip()

    def pixels(self) -> Pixels:
        return np.ascontiguousarray(pygame.surfarray.array3d(self._canvas).swapaxes(0, 1))

    def project(self, x: Floats, y: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        right, down = self.camera.to_screen(x, y)
        return right, down, np.full(len(x), self.camera.scale)

    def labels(self) -> list[Box]:
        return self._boxes

    def drag(self, dx: float, dy: float, button: int) -> bool:
        self._aimed = True
        self.camera = self.camera.dragged(dx, dy)
        return True

    def zoom(self, steps: float, at: tuple[float, float]) -> None:
        self._aimed = True
        limits = self._fitted / _MAX_ZOOM_OUT, self._fitted * _MAX_ZOOM_IN
        self.camera = self.camera.zoomed(steps, at, limits)

    def fit(self) -> None:
        self._aimed = False

    def close(self) -> None:
        if self._windowed:
            close_window()

    def _aim(self, sight: Sight) -> None:
        """Point the camera at the whole world, the followed agent, or where the user moved it."""
        if not self._aimed:
            self._bounds = extent(sight.picture, self._bounds)
            if self._bounds is not None:
                self.camera = self.camera.fitted(self._bounds, _PADDING * self._ui)
                self._fitted = self.camera.scale
        if sight.follows and (spot := spot_of(sight.picture, sight.selected)) is not None:
            self.camera = self.camera.centred(spot.x, spot.y)

    def _draw_items(self, picture: Picture) -> None:
        for item in picture.items:
            if isinstance(item, Discs):
                self._stamps.draw(self._world, item, self.camera, self._ui)
            elif isinstance(item, Polyline):
                draw_line(self._world, item, self.camera, self._ui)

    def _draw_chosen(self, picture: Picture, agent: str) -> None:
        """A ring around the selected agent."""
        spot = spot_of(picture, agent)
        if spot is not None:
            middle = self.camera.to_screen(spot.x, spot.y)
            radius = max(spot.radius * self.camera.scale, 3 * self._ui) + 5 * self._ui
            width = max(2, round(2.4 * self._ui))
            pygame.draw.aacircle(self._world, CHOSEN, middle, radius, width)
