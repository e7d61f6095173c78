"""Text plates: one texture each, drawn over the finished picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl

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
        self._sheets: dict[tuple[tuple[str, str], ...], Plate] = {}
        self.scale = 1.0

    def sheet(self, text: str) -> Plate:
        """A plate with one line."""
        return self.table([(text, "")])

    def table(self, rows: Sequence[tuple[str, str]]) -> Plate:
        """A plate with lines, each in one or two columns."""
        key = tuple(rows)
        # Added at the end again: the first entry is the one that has not been used for longest.
        plate = self._sheets.pop(key, None) or self._made(key)
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

    def _made(self, rows: tuple[tuple[str, str], ...]) -> Plate:
        import pygame

        # pygame's own font looks the same on all machines.
        font = pygame.font.Font(None, round(22 * self.scale))
        columns = [
            [font.render(_shown(row[at]), True, color) for row in rows]
            for at, color in ((0, _INK), (1, _PALE))
        ]
        first, second = (max(line.get_width() for line in column) for column in columns)
        gap = round(16 * self.scale) if second > 1 and any(row[1] for row in rows) else 0
        inset, line = round(7 * self.scale), round(1.2 * font.get_linesize())
        size = first + (gap + second if gap else 0) + 2 * inset, len(rows) * line + inset
        plate = pygame.Surface(size, pygame.SRCALPHA)
        pygame.draw.rect(
            plate, _TABLE if len(rows) > 1 else _PLATE, plate.get_rect(), border_radius=inset
        )
        for at, column in enumerate(columns):
            for row, letters in enumerate(column):
                left = inset + (first + gap) * at
                plate.blit(letters, (left, inset // 2 + row * line + line // 8))
        data = pygame.image.tobytes(plate, "RGBA")
        texture = self._gl.texture(size, 4, data)
        # Plates lie on whole pixels, so filtering would only blur them.
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return Plate(texture, *size)


def _shown(text: str) -> str:
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line if len(line) <= _MAX_CHARACTERS else line[: _MAX_CHARACTERS - 1] + "…"
