"""Texts in the picture: a pin with a ball, and the text next to the ball."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import moderngl
import numpy as np

from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Texts
from minerva_services.views.names import AgentName
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
        self._program = program(gl, shaders.PIN_VERTEX, shaders.TINTED_FRAGMENT)
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
        self._marked: Mapping[str, str] = {}
        self._count = 0
        self.sizes = PinSizes(0.1, 1.0)

    def take(
        self,
        texts: Sequence[Texts],
        sizes: PinSizes,
        marked: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Set the texts of a picture; `marked` gives some of them other colours."""
        self._shown, self._marked, self.sizes = texts, marked, sizes
        self._count = sum(len(batch.x) for batch in texts)
        for by in (self._program, self._dark):
            by["size"] = sizes.radius, sizes.height
        if self._count:
            self._feet.write(np.concatenate([_feet(batch, marked) for batch in texts]))

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
            sheet = signs.sheet(names[row], self._marked.get(names[row], ""))
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


def _feet(texts: Texts, marked: Mapping[str, str]) -> np.ndarray:
    colors = [rgb(marked.get(text, texts.form.color)) for text in texts.texts]
    paint = np.array(colors, np.float64).reshape(-1, 3) / 255
    return np.column_stack([texts.x, texts.y, paint]).astype(np.float32)


def write_names(
    names: Sequence[AgentName], signs: TextPlates, camera: OrbitCamera, size: tuple[int, int]
) -> list[Box]:
    """Draw agents' names above their discs; returns their boxes."""
    boxes: list[Box] = []
    for name in names:
        top = np.array([[name.x, name.y, name.height], [name.x, name.y, 0.0]])
        at = camera.project(top, *size)
        if np.isnan(at).any():
            continue
        sheet = signs.sheet(name.text)
        # Above the far edge of the disc, which the camera sees behind its middle.
        away = float(_pixels(camera, top[:1], name.radius, size)[0]) + 6
        left, high = float(at[0, 0]) - sheet.width / 2, float(at[0, 1]) - away - sheet.height
        signs.put(sheet, left, high)
        edges = left, high, left + sheet.width, high + sheet.height
        boxes.append(Box(name.text, *edges, names_agent=True))
    return boxes


def _pixels(camera: OrbitCamera, points: Floats, metres: float, size: tuple[int, int]) -> Floats:
    return metres * camera.metre(size[1]) / camera.depths(points)
