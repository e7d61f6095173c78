"""Text plates: one texture each, drawn over the finished picture."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import moderngl

from minerva_services.geometry.colors import Legend, rgb
from minerva_services.views.fates import OrderEntry
from minerva_services.views.opengl import shaders
from minerva_services.views.opengl.gpu import LETTERS, program

PADDING = 14
_INK, _PALE = (38, 45, 54), (92, 102, 114)
_PLATE, _TABLE = (255, 255, 255, 222), (255, 255, 255, 246)
_MAX_CACHED = 512
_MAX_CHARACTERS = 160


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A plate with text, with its size in pixels."""

    texture: moderngl.Texture
    width: int
    height: int


class TextPlates:
    """Draws plates with texts; recently used ones are cached."""

    def __init__(self, gl: moderngl.Context) -> None:
        import pygame.font

        pygame.font.init()
        self._gl = gl
        self._program = program(gl, shaders.SIGN_VERTEX, shaders.SIGN_FRAGMENT)
        self._array = gl.vertex_array(self._program, [])
        self._sheets: dict[Hashable, Plate] = {}
        self.scale = 1.0

    def sheet(self, text: str, color: str = "") -> Plate:
        """A plate with one line, in white letters on a colour if there is one."""
        return self._cached((text, color), lambda: self._made(((text, ""),), color))

    def table(self, rows: Sequence[tuple[str, str]]) -> Plate:
        """A plate with lines, each in one or two columns."""
        key = tuple(rows)
        return self._cached(key, lambda: self._made(key))

    def legend(self, legend: Legend, width: int) -> Plate:
        """A legend, `width` pixels wide."""
        from minerva_services.views.window.legend_strip import legend_strip

        return self._cached(
            (legend, width), lambda: self._uploaded(legend_strip(legend, width, self.scale))
        )

    def orders(self, orders: tuple[OrderEntry, ...]) -> Plate:
        """The last orders of people."""
        from minerva_services.views.window.order_strip import order_strip

        return self._cached(orders, lambda: self._uploaded(order_strip(orders, self.scale)))

    def _cached(self, key: Hashable, make: Callable[[], Plate]) -> Plate:
        # Added at the end again: the first entry is the one that has not been used for longest.
        plate = self._sheets.pop(key, None) or make()
        self._sheets[key] = plate
        while len(self._sheets) > _MAX_CACHED:
            self._sheets.pop(next(iter(self._sheets))).texture.release()
        return plate

    def begin(self) -> None:
        """Start drawing plates over the picture."""
        self._gl.enable_only(moderngl.BLEND)

    def put(self, sheet: Plate, left: float, top: float) -> None:
        """Draw a plate with its corner at integer pixels."""
        self._program["sheet"] = round(left), round(top), sheet.width, sheet.height
        sheet.texture.use(LETTERS)
        self._array.render(moderngl.TRIANGLE_STRIP, vertices=4)

    def resized(self, height: int) -> None:
        """Adapt to the picture's height: letters are a fortieth of it, within limits."""
        scale = min(max(height / 800, 0.8), 2.5)
        if scale != self.scale:
            self.scale = scale
            for plate in self._sheets.values():
                plate.texture.release()
            self._sheets.clear()

    def _made(self, rows: tuple[tuple[str, str], ...], color: str = "") -> Plate:
        import pygame

        # pygame's own font looks the same on all machines.
        font = pygame.font.Font(None, round(22 * self.scale))
        columns = [
            [font.render(_shown(row[at]), True, ink) for row in rows]
            for at, ink in ((0, (255, 255, 255) if color else _INK), (1, _PALE))
        ]
        first, second = (max(line.get_width() for line in column) for column in columns)
        gap = round(16 * self.scale) if second > 1 and any(row[1] for row in rows) else 0
        inset, line = round(7 * self.scale), round(1.2 * font.get_linesize())
        size = first + (gap + second if gap else 0) + 2 * inset, len(rows) * line + inset
        plate = pygame.Surface(size, pygame.SRCALPHA)
        paper = rgb(color) if color else _TABLE if len(rows) > 1 else _PLATE
        pygame.draw.rect(plate, paper, plate.get_rect(), border_radius=inset)
        for at, column in enumerate(columns):
            for row, letters in enumerate(column):
                left = inset + (first + gap) * at
                plate.blit(letters, (left, inset // 2 + row * line + line // 8))
        return self._uploaded(plate)

    def _uploaded(self, plate: Any) -> Plate:
        import pygame

        size, data = plate.get_size(), pygame.image.tobytes(plate, "RGBA")
        texture = self._gl.texture(size, 4, data)
        # Plates lie on whole pixels, so filtering would only blur them.
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return Plate(texture, *size)


def _shown(text: str) -> str:
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line if len(line) <= _MAX_CHARACTERS else line[: _MAX_CHARACTERS - 1] + "…"
