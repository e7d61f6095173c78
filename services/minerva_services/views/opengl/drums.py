"""Discs as instanced drums: one draw call for all of them."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.picture import Discs
from minerva_services.views.opengl import shaders
from minerva_services.views.opengl.gpu import GrowingBuffer, fitting, program
from minerva_services.views.opengl.solids import Single, drum

_SHAPE = "2f 3f 2f", ("way", "edge", "facing")
_COPY = "4f 2f 4f1 /i", ("stand", "size", "paint")
_RECORD = np.dtype([("stand", "f4", 4), ("size", "f4", 2), ("paint", "u1", 4)])
_DETAILS = ((300, (40, True)), (3000, (16, True)), (1 << 62, (6, False)))
"""Level of detail: maximum number of discs, segments per disc, and whether edges are rounded."""
_OVERLAP_HEIGHT = 0.04
"""Extra height of a disc that overlaps another, as a fraction of its height."""
_MAX_OVERLAPS = 12
# Number of discs up to which all pairs are compared.
_MAX_COMPARED = 400


class Drums:
    """All discs of a picture."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._copies = GrowingBuffer(gl)
        self._bright = program(gl, shaders.DRUM_VERTEX, shaders.DRUM_FRAGMENT)
        self._dark = program(gl, shaders.DRUM_SHADOW, shaders.NOTHING)
        self._arrays: dict[tuple[int, bool, int, int], moderngl.VertexArray] = {}
        self._shape = _DETAILS[0][1]
        self.count = 0

    def take(self, batches: Sequence[Discs]) -> None:
        """Set the discs of a picture."""
        self.count = sum(map(len, batches))
        self._shape = next(shape for most, shape in _DETAILS if self.count <= most)
        self._copies.write(instances(batches))

    def cast(self) -> None:
        """Draw shadow casters; of the simplest drums, only the lids."""
        segments, rounded = self._shape
        # Sides of drums too small to be rounded hardly change their shadow.
        sides = 0 if rounded else 2 * segments
        self._draw(self._dark, sides)

    def draw(self) -> None:
        """Draw all discs."""
        self._draw(self._bright, 0)

    def _draw(self, by: moderngl.Program, first: int) -> None:
        if self.count:
            array = self._array(by)
            rest = array.vertices - 3 * first
            array.render(moderngl.TRIANGLES, rest, first=3 * first, instances=self.count)

    def _array(self, by: moderngl.Program) -> moderngl.VertexArray:
        key = (*self._shape, by.glo, self._copies.buffer.glo)
        if key not in self._arrays:
            mesh = drum(*self._shape)
            content = [
                (self._gl.buffer(mesh.vertices), *fitting(by, *_SHAPE)),
                (self._copies.buffer, *fitting(by, *_COPY)),
            ]
            triangles = self._gl.buffer(mesh.triangles)
            self._arrays[key] = self._gl.vertex_array(by, content, index_buffer=triangles)
        return self._arrays[key]


def instances(batches: Sequence[Discs]) -> NDArray[np.void]:
    """One record per disc: position, size, colour, and whether it has a heading mark.

    Discs later in the string lie over earlier ones, so they are slightly taller.
    """
    records = np.zeros(sum(map(len, batches)), _RECORD)
    start = 0
    for discs in batches:
        rows = records[start : start + len(discs)]
        stand, size, paint = rows["stand"], rows["size"], rows["paint"]
        stand[:, 0], stand[:, 1], stand[:, 3] = discs.x, discs.y, discs.angle
        size[:, 0], size[:, 1] = discs.radius, discs.height
        paint[:, :3], paint[:, 3] = discs.color, 255 * discs.heading
        start += len(discs)
    x, y, radius = records["stand"][:, 0], records["stand"][:, 1], records["size"][:, 0]
    records["size"][:, 1] *= 1 + _OVERLAP_HEIGHT * _layers(x, y, radius)
    return records


def _layers(x: Single, y: Single, radius: Single) -> NDArray[np.float64]:
    """How many discs each one overlaps, up to a limit; for crowds, only the order counts."""
    order = np.arange(len(x))
    # The comparison of all pairs below takes quadratic time and memory.
    if len(x) > _MAX_COMPARED:
        return _MAX_OVERLAPS * order / len(x)
    over = np.hypot(x[:, None] - x, y[:, None] - y) < radius[:, None] + radius
    return np.minimum(np.tril(over, -1).sum(axis=1), _MAX_OVERLAPS).astype(np.float64)
