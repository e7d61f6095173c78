"""Copies of solids in space: one draw call for each solid."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from minerva_services.geometry.picture import Copies, Solid
from minerva_services.views.opengl import shaders
from minerva_services.views.opengl.gpu import GpuCache, GrowingBuffer, fitting, program
from minerva_services.views.solids import normals

_SHAPE = "3f 3f", ("corner", "facing")
_COPY = "3f 4f 3f 4f1 /i", ("stand", "turn", "size", "paint")
_RECORD = np.dtype([("stand", "f4", 3), ("turn", "f4", 4), ("size", "f4", 3), ("paint", "u1", 4)])


class CopyMeshes:
    """All copies of solids in a picture."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._bright = program(gl, shaders.COPY_VERTEX, shaders.TINTED_FRAGMENT)
        self._dark = program(gl, shaders.COPY_SHADOW, shaders.NOTHING)
        self._solids: GpuCache[Solid, Solid, _Instanced] = GpuCache(
            lambda solid: _Instanced(gl, solid), _Instanced.release
        )
        self._shown: list[_Instanced] = []
        self.lowest = 0.0
        """Height in metres of the lowest point below the ground, or 0."""

    def take(self, groups: Sequence[Copies]) -> None:
        """Set the copies of a picture, each group of another solid."""
        self._shown = self._solids.of((copies.solid, copies.solid) for copies in groups)
        for shown, copies in zip(self._shown, groups, strict=True):
            shown.write(copies)
        self.lowest = min((float(each.extents()[0][:, 2].min()) for each in groups), default=0.0)

    @property
    def count(self) -> int:
        """Number of copies."""
        return sum(each.count for each in self._shown)

    def cast(self) -> None:
        """Draw shadow casters."""
        for each in self._shown:
            each.draw(self._dark)

    def draw(self) -> None:
        """Draw all copies."""
        for each in self._shown:
            each.draw(self._bright)


class _Instanced:
    """A solid on the graphics card, with its copies."""

    def __init__(self, gl: moderngl.Context, solid: Solid) -> None:
        self._gl = gl
        mesh = np.column_stack((solid.vertices, normals(solid))).astype(np.float32)
        self._vertices, self._triangles = gl.buffer(mesh), gl.buffer(solid.faces.astype("i4"))
        self._copies = GrowingBuffer(gl)
        self._arrays: dict[int, moderngl.VertexArray] = {}
        self.count = 0

    def write(self, copies: Copies) -> None:
        records = np.zeros(len(copies), _RECORD)
        records["stand"], records["turn"] = copies.places, copies.turns
        records["size"], records["paint"][:, :3] = copies.sizes, copies.color
        self._copies.write(records)
        self.count = len(copies)

    def draw(self, by: moderngl.Program) -> None:
        array = self._arrays.get(by.glo)
        if array is None:
            content = [
                (self._vertices, *fitting(by, *_SHAPE)),
                (self._copies.buffer, *fitting(by, *_COPY)),
            ]
            array = self._gl.vertex_array(by, content, index_buffer=self._triangles)
            self._arrays[by.glo] = array
        array.render(moderngl.TRIANGLES, instances=self.count)

    def release(self) -> None:
        """Free the memory."""
        buffers = self._vertices, self._triangles, self._copies.buffer
        for resource in (*self._arrays.values(), *buffers):
            resource.release()
