"""Texts in the picture: a pin with a ball, and the text next to the ball."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np

from minerva_bus.semantics.picture import Texts, rgb
from minerva_services.views.opengl import shaders
from minerva_services.views.opengl.camera import Floats, OrbitCamera
from minerva_services.views.opengl.gpu import GrowingBuffer, fitting, program
from minerva_services.views.opengl.solids import pin
from minerva_services.views.opengl.text_plates import PADDING, TextPlates
from minerva_services.views.window.painter import Box


@dataclass(frozen=True, slots=True)
class PinSizes:
    """Radius of a pin's ball and height of the pin, in metres."""

    radius: float
    height: float


class PinMeshes:
    """All pins of a picture."""

    def __init__(self, gl: moderngl.Context) -> None:
        mesh = pin()
        self._program = program(gl, shaders.PIN_VERTEX, shaders.PIN_FRAGMENT)
        self._dark = program(gl, shaders.PIN_SHADOW, shaders.NOTHING)
        self._feet = GrowingBuffer(gl)
        vertices, triangles = gl.buffer(mesh.vertices), gl.buffer(mesh.triangles)
        shape = "4f 3f", ("shape", "facing")
        self._arrays = [
            gl.vertex_array(
                by,
                [(vertices, *fitting(by, *shape)), (self._feet.buffer, "2f 3f /i", "foot", "paint")]
                if by is self._program
                # Shadows skip the colours.
                else [(vertices, *fitting(by, *shape)), (self._feet.buffer, "2f 12x /i", "foot")],
                index_buffer=triangles,
            )
            for by in (self._program, self._dark)
        ]
        self._shown: Sequence[Texts] = ()
        self._count = 0
        self.sizes = PinSizes(0.1, 1.0)

    def take(self, texts: Sequence[Texts], sizes: PinSizes) -> None:
        """Set the texts of a picture."""
        self._shown, self.sizes = texts, sizes
        self._count = sum(len(batch.x) for batch in texts)
        for by in (self._program, self._dark):
            by["size"] = sizes.radius, sizes.height
        if self._count:
            self._feet.write(np.concatenate([_feet(batch) for batch in texts]))

    def cast(self) -> None:
        """Draw shadow casters."""
        if self._count:
            self._arrays[1].render(moderngl.TRIANGLES, instances=self._count)

    def draw(self) -> None:
        """Draw the pins."""
        if self._count:
            self._arrays[0].render(moderngl.TRIANGLES, instances=self._count)

    def write(self, signs: TextPlates, camera: OrbitCamera, size: tuple[int, int]) -> list[Box]:
        """Draw the texts next to their pins, nearest last; returns boxes of texts and pins."""
        width, _ = size
        names = [text for batch in self._shown for text in batch.texts]
        if not names:
            return []
        x, y = (np.concatenate([getattr(batch, axis) for batch in self._shown]) for axis in "xy")
        balls = np.stack([x, y, np.full(len(x), self.sizes.height)], axis=1)
        at, foot = camera.project(balls, *size), camera.project(balls * [1, 1, 0], *size)
        ball = _pixels(camera, balls, self.sizes.radius, size)
        boxes: list[Box] = []
        for row in np.argsort(-camera.depths(balls), kind="stable"):
            if np.isnan(at[row]).any() or not names[row]:
                continue
            sheet = signs.sheet(names[row])
            gap = float(ball[row]) + 4
            left = float(at[row, 0]) + gap
            if left + sheet.width > width - PADDING:
                left = float(at[row, 0]) - gap - sheet.width
            top = float(at[row, 1]) - sheet.height / 2
            signs.put(sheet, left, top)
            edges = float(at[row, 0] - ball[row]), float(at[row, 0] + ball[row])
            # The foot may lie behind the camera while the ball is in front of it.
            bottom = float(np.nan_to_num(foot[row, 1], nan=top + sheet.height))
            boxes.append(Box(names[row], edges[0], top, edges[1], max(bottom, top + sheet.height)))
            boxes.append(Box(names[row], left, top, left + sheet.width, top + sheet.height))
        return boxes


def _feet(texts: Texts) -> np.ndarray:
    paint = np.tile(np.array(rgb(texts.form.color)) / 255, (len(texts.x), 1))
    return np.column_stack([texts.x, texts.y, paint]).astype(np.float32)


def _pixels(camera: OrbitCamera, points: Floats, metres: float, size: tuple[int, int]) -> Floats:
    return metres * camera.metre(size[1]) / camera.depths(points)
