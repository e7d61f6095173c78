"""Shared GPU code: programs, meshes, growing buffers and a cache."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Generic, TypeVar

import moderngl
import numpy as np

from minerva_services.views.opengl.shaders import complete
from minerva_services.views.opengl.solids import Mesh

Key = TypeVar("Key", bound=Hashable)
Thing = TypeVar("Thing")
Made = TypeVar("Made")

FRAME = 0
"""Binding of the uniform block that all programs read."""
SHADE, COLORS, OPENNESS, LETTERS = range(4)
"""Texture units."""
_UNITS = {"shade": SHADE, "colors": COLORS, "openness": OPENNESS, "letters": LETTERS}


def program(gl: moderngl.Context, vertex: str, fragment: str) -> moderngl.Program:
    """A program bound to the shared uniform block and texture units."""
    linked = gl.program(vertex_shader=complete(vertex), fragment_shader=complete(fragment))
    # The compiler removes uniforms that a program does not use.
    for name in linked:
        uniform = linked[name]
        if isinstance(uniform, moderngl.UniformBlock):
            uniform.binding = FRAME
        elif name in _UNITS:
            linked[name] = _UNITS[name]
    return linked


class Uploaded:
    """A mesh on the graphics card, drawn by several programs."""

    def __init__(self, gl: moderngl.Context, mesh: Mesh, layout: str, names: Iterable[str]) -> None:
        self._gl = gl
        self._names = tuple(names)
        self._layout = layout
        # OpenGL has no empty buffers.
        self.vertices = gl.buffer(mesh.vertices.tobytes() or b"\0" * 4)
        self.triangles = gl.buffer(mesh.triangles.tobytes() or b"\0" * 4)
        self.empty = not mesh.triangles.size
        self._arrays: dict[int, moderngl.VertexArray] = {}

    def draw(self, by: moderngl.Program) -> None:
        """Draw all its triangles."""
        if self.empty:
            return
        array = self._arrays.get(by.glo)
        if array is None:
            content = [(self.vertices, *fitting(by, self._layout, self._names))]
            array = self._gl.vertex_array(by, content, index_buffer=self.triangles)
            self._arrays[by.glo] = array
        array.render(moderngl.TRIANGLES)

    def release(self) -> None:
        """Free the memory."""
        for resource in (*self._arrays.values(), self.vertices, self.triangles):
            resource.release()


def fitting(by: moderngl.Program, layout: str, names: Iterable[str]) -> tuple[str, ...]:
    """A buffer's layout and names, with padding for attributes that the program does not use."""
    parts = layout.split()
    per, parts = (parts.pop(), parts) if parts[-1].startswith("/") else ("", parts)
    used = [name in by for name in names]
    sizes = {"f": 4, "f1": 1}
    padded = [
        part if is_used else f"{int(part[0]) * sizes[part[1:]]}x"
        for part, is_used in zip(parts, used, strict=True)
    ]
    read = [name for name, is_used in zip(names, used, strict=True) if is_used]
    return " ".join([*padded, *([per] if per else [])]), *read


class GrowingBuffer:
    """A buffer that is rewritten for every picture and grows as needed."""

    def __init__(self, gl: moderngl.Context) -> None:
        self.buffer = gl.buffer(reserve=4096, dynamic=True)

    def write(self, numbers: np.ndarray) -> None:
        """Write numbers from the start of the buffer."""
        data = np.ascontiguousarray(numbers)
        if data.nbytes > self.buffer.size:
            # Twice the size, so that a growing picture rarely reallocates.
            self.buffer.orphan(2 * data.nbytes)
        if data.nbytes:
            self.buffer.write(data)


class GpuCache(Generic[Key, Thing, Made]):
    """GPU resources of things, kept while each picture contains them."""

    def __init__(self, make: Callable[[Thing], Made], drop: Callable[[Made], None]) -> None:
        self._make, self._drop = make, drop
        self._known: dict[Key, Made] = {}

    def of(self, things: Iterable[tuple[Key, Thing]]) -> list[Made]:
        """The resources in order; those no longer needed are dropped."""
        before, self._known = self._known, {}
        for key, thing in things:
            if key not in self._known:
                known = before.pop(key, None)
                self._known[key] = self._make(thing) if known is None else known
        for unused in before.values():
            self._drop(unused)
        return list(self._known.values())
