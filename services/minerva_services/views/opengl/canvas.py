"""Render targets: pygame's window or memory, through OpenGL."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_services.views.window.painter import Pixels
from minerva_services.views.window.screen import begin

_PACKAGES = "libegl1, libgl1 and libgl1-mesa-dri"
# Samples per pixel for smooth edges.
_SAMPLES = 4
# OpenGL 3.3, as the shaders require.
_VERSION = 330
_SOFTWARE = "llvmpipe", "softpipe", "swrast"


def without_window() -> moderngl.Context:
    """An OpenGL context without a screen. Raises MisuseError if there is no driver."""
    why = ""
    # EGL needs no display server, the default may.
    backends: tuple[dict[str, Any], ...] = {"backend": "egl"}, {}
    for options in backends:
        try:
            return moderngl.create_context(standalone=True, require=_VERSION, **options)
        except Exception as error:
            why = why or _line(error)
    raise _no_driver(why)


def in_window() -> moderngl.Context:
    """An OpenGL context in pygame's window. Raises MisuseError."""
    try:
        return moderngl.create_context(require=_VERSION)
    except Exception as error:
        raise _no_driver(_line(error)) from None


def ask_for_opengl() -> int:
    """Request OpenGL 3.3 from pygame; returns the display flags."""
    import pygame

    begin("opengl")
    for what, value in (
        (pygame.GL_CONTEXT_MAJOR_VERSION, 3),
        (pygame.GL_CONTEXT_MINOR_VERSION, 3),
        (pygame.GL_CONTEXT_PROFILE_MASK, pygame.GL_CONTEXT_PROFILE_CORE),
    ):
        pygame.display.gl_set_attribute(what, value)
    return pygame.OPENGL | pygame.DOUBLEBUF


class RenderTarget:
    """A picture in the graphics card's memory."""

    def __init__(self, gl: moderngl.Context, size: tuple[int, int]) -> None:
        self._gl = gl
        self._made: list[Any] = []
        self.slow = any(name in gl.info["GL_RENDERER"].lower() for name in _SOFTWARE)
        self.resize(size)

    def resize(self, size: tuple[int, int]) -> None:
        """Reallocate with another size in pixels."""
        self.release()
        self.size = size
        colors = self._owned(self._gl.renderbuffer(size, 4))
        self._finished = self._owned(self._gl.framebuffer(colors))
        # The same colours as `_finished`: without smoothing, nothing has to be copied.
        self._plain = self._owned(self._gl.framebuffer(colors, self._depth(0)))
        samples = min(_SAMPLES, self._gl.max_samples)
        several = self._owned(self._gl.renderbuffer(size, 4, samples=samples))
        self._fine = self._owned(self._gl.framebuffer(several, self._depth(samples)))
        self._drawn = self._plain

    def begin(self, *, smooth: bool) -> None:
        """Start drawing; smooth edges take four times the work."""
        self._drawn = self._fine if smooth else self._plain
        self._drawn.use()
        self._drawn.clear(depth=1.0)

    def finish(self) -> None:
        """Resolve smooth edges; later drawing is not smoothed."""
        if self._drawn is self._fine:
            self._gl.copy_framebuffer(self._finished, self._fine)
        self._finished.use()

    def to(self, screen: moderngl.Framebuffer) -> None:
        """Copy the picture to a window."""
        self._gl.copy_framebuffer(screen, self._finished)

    def _depth(self, samples: int) -> moderngl.Renderbuffer:
        return self._owned(self._gl.depth_renderbuffer(self.size, samples=samples))

    def _owned(self, resource: Any) -> Any:
        self._made.append(resource)
        return resource

    def pixels(self) -> Pixels:
        """RGB pixels of shape (height, width, 3), top row first."""
        width, height = self.size
        data = np.frombuffer(self._finished.read(components=3, alignment=1), np.uint8)
        # OpenGL's first row is the bottom one.
        return np.ascontiguousarray(data.reshape(height, width, 3)[::-1])

    def depths(self) -> NDArray[np.float32]:
        """The depth buffer of the last picture without smooth edges, 0 to 1: (height, width)."""
        width, height = self.size
        data = self._plain.read(components=1, attachment=-1, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(height, width)[::-1]

    def release(self) -> None:
        """Free the memory."""
        # Framebuffers before the buffers attached to them.
        for resource in reversed(self._made):
            resource.release()
        self._made = []


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _no_driver(why: str) -> MisuseError:
    return MisuseError(
        f"opengl: no driver for OpenGL 3.3 ({why}); on Debian: apt install {_PACKAGES}"
    )
