"""The geometric system of the 3D view: draws in an OpenGL window."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import moderngl
import numpy as np

from minerva_services.views.opengl.camera import MARGIN, Floats, OrbitCamera
from minerva_services.views.opengl.canvas import (
    RenderTarget,
    ask_for_opengl,
    in_window,
    without_window,
)
from minerva_services.views.opengl.extent import SceneBox, extent_of
from minerva_services.views.opengl.gl_scene import GLScene
from minerva_services.views.opengl.pins import write_names
from minerva_services.views.opengl.text_plates import PADDING, TextPlates
from minerva_services.views.window.painter import Box, Pixels, Sight
from minerva_services.views.window.picking import spot_of
from minerva_services.views.window.screen import close_window, open_window, quiet

_DEGREES_PER_PIXEL = 0.3
"""Camera rotation per pixel of mouse movement, in degrees."""
_ZOOM_PER_STEP = 1.15
_MOVE_HELP = "right or shift drag", "move along the floor"


class GLPainter:
    """Draws with OpenGL; must be called from the process's main thread.

    The camera shows the whole world until the user moves it.
    """

    def __init__(self, azimuth: float, elevation: float, zoom: float) -> None:
        self._initial_camera = OrbitCamera(azimuth=azimuth, elevation=elevation)
        self._zoom = zoom
        self.camera = self._initial_camera
        self._moved = False
        self._margin = MARGIN
        self._extent: SceneBox | None = None
        self._sight: Sight | None = None
        self._boxes: list[Box] = []
        self._window = False
        self._gl: moderngl.Context | None = None

    def open(self, title: str, size: tuple[int, int]) -> None:
        """Open a window of this size in pixels. Raises MisuseError."""
        quiet()
        import pygame

        surface = open_window("opengl", title, size, ask_for_opengl())
        self._window = True
        self._begin(in_window(), surface.get_size() or size)
        pygame.display.flip()

    def offscreen(self, size: tuple[int, int]) -> None:
        """Draw without a window. Raises MisuseError if there is no driver."""
        quiet()
        self._begin(without_window(), size)

    def _begin(self, gl: moderngl.Context, size: tuple[int, int]) -> None:
        self._gl = gl
        self._canvas = RenderTarget(gl, size)
        self._scene = GLScene(gl)
        self._signs = TextPlates(gl)
        self._signs.resized(size[1])

    def resized(self, size: tuple[int, int]) -> None:
        """Handle a changed window size."""
        if self._gl is not None and size != self._canvas.size:
            with self._used():
                self._canvas.resize(size)
                self._signs.resized(size[1])
            self._refit()

    def draw(self, sight: Sight) -> None:
        """Draw, and present it in the window if there is one."""
        with self._used():
            self._draw(sight)

    def pixels(self) -> Pixels:
        """The last picture: RGB of shape (height, width, 3)."""
        with self._used():
            return self._canvas.pixels()

    def project(self, x: Floats, y: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        """Pixels from left and top of positions (m), and pixels per metre there."""
        places = np.stack(np.broadcast_arrays(x, y, height), axis=-1).reshape(-1, 3)
        at = self.camera.project(places, *self._canvas.size)
        per_metre = self.camera.metre(self._canvas.size[1]) / self.camera.depths(places)
        return at[:, 0], at[:, 1], per_metre

    def labels(self) -> Sequence[Box]:
        """Boxes of the texts and their pins."""
        return self._boxes

    def drag(self, dx: float, dy: float, button: int) -> bool:
        """Rotate around the target with the left button, or move along the ground with another."""
        self._moved = True
        if button == 1 and not _shift_held():
            self.camera = self.camera.orbited(-_DEGREES_PER_PIXEL * dx, _DEGREES_PER_PIXEL * dy)
            # The target stays, so an agent is still followed.
            return False
        self.camera = self.camera.panned(dx, dy, self._canvas.size[1])
        return True

    def zoom(self, steps: float, at: tuple[float, float]) -> None:
        """Zoom in by steps; the point under the mouse stays in place."""
        self._moved = True
        before = self.camera.ground(*at, *self._canvas.size)
        self.camera = self.camera.zoomed(_ZOOM_PER_STEP**steps)
        after = self.camera.ground(*at, *self._canvas.size)
        if before is not None and after is not None:
            x, y, z = self.camera.target
            self.camera = self.camera.aimed(x + before[0] - after[0], y + before[1] - after[1], z)

    def fit(self) -> None:
        """Show the whole world again."""
        self._moved = False
        self._refit()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._gl is not None:
            self._gl.release()
            self._gl = None
        if self._window:
            self._window = False
            close_window()

    # --- drawing ---

    def _used(self) -> AbstractContextManager[Any]:
        """The context to draw in: without a window, the process may have several."""
        assert self._gl is not None
        return nullcontext() if self._window else self._gl

    def _draw(self, sight: Sight) -> None:
        # Only new pictures are uploaded; camera, selection and texts change more often.
        if self._sight is None or sight.picture is not self._sight.picture:
            self._take(sight)
        self._sight = sight
        self._leave_room(sight)
        spot = spot_of(sight.picture, sight.selected)
        if sight.follows and spot is not None:
            self.camera = self.camera.aimed(spot.x, spot.y)
        self._scene.mark(spot)
        self._scene.beam(sight.beams)
        self._canvas.begin(smooth=not (self._canvas.slow and self._scene.crowded))
        self._scene.draw(self.camera, self._canvas.size)
        self._canvas.finish()
        self._write(sight)
        if self._window:
            self._show()

    def _take(self, sight: Sight) -> None:
        extent = extent_of(sight.picture, self._extent)
        if extent != self._extent:
            self._extent = extent
            self._refit()
        self._scene.take(sight.picture, extent)
        # Shadows do not depend on the camera, so they are drawn once per picture.
        self._scene.shadows(self.camera, self._canvas.size)

    def _leave_room(self, sight: Sight) -> None:
        """Keep the world clear of the legend."""
        width, height = self._canvas.size
        strip = self._signs.legend(sight.legend, width).height if sight.legend else 0
        margin = max(MARGIN, strip / height + MARGIN / 4)
        if margin != self._margin:
            self._margin = margin
            self._refit()

    def _refit(self) -> None:
        if not self._moved and self._extent is not None:
            width, height = self._canvas.size
            fitted = self._initial_camera.fitted(self._extent.corners, width / height, self._margin)
            self.camera = fitted.zoomed(self._zoom)

    def _write(self, sight: Sight) -> None:
        signs, (width, height) = self._signs, self._canvas.size
        signs.begin()
        self._boxes = self._scene.pins.write(signs, self.camera, self._canvas.size)
        # Names of agents are on top of the texts of places, and are picked first.
        self._boxes += write_names(sight.names, signs, self.camera, self._canvas.size)
        if sight.legend:
            strip = signs.legend(sight.legend, width)
            height -= strip.height
            signs.put(strip, 0, height)
        top = float(PADDING)
        if sight.caption:
            rest = "  ·  ".join(text for text in (sight.subtitle, sight.hint) if text)
            plate = signs.table([(sight.caption, rest)])
            signs.put(plate, PADDING, top)
            top += plate.height + PADDING / 2
        if sight.orders:
            plate = signs.orders(sight.orders)
            # Below the caption, which may be long.
            signs.put(plate, width - PADDING - plate.width, top)
        if sight.help:
            signs.put(signs.table([*sight.help, _MOVE_HELP]), PADDING, top)
        if sight.notice:
            plate = signs.sheet(sight.notice)
            signs.put(plate, PADDING, height - PADDING - plate.height)

    def _show(self) -> None:
        import pygame

        assert self._gl is not None
        self._canvas.to(self._gl.screen)
        pygame.display.flip()


def _shift_held() -> bool:
    import pygame

    return bool(pygame.display.get_init() and pygame.key.get_mods() & pygame.KMOD_SHIFT)
