"""Matrices in the picture: floors, the walls on them, and transparent overlays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import moderngl
import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Tiles
from minerva_services.views.opengl import shaders
from minerva_services.views.opengl.gpu import COLORS, OPENNESS, GpuCache, Uploaded, program
from minerva_services.views.opengl.painting import lidded, open_floor, painted, walled
from minerva_services.views.opengl.solids import Mesh, tops, upright

_PLACES = "3f 3f", ("where", "facing")
_SIDES_LIGHTER = 0.78
_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)


@dataclass(slots=True, eq=False)
class FloorMesh:
    """A matrix on the graphics card; it references its cells, which keeps their identity valid."""

    tiles: Tiles
    opaque: bool
    """Whether it hides what is below."""
    colors: moderngl.Texture
    openness: moderngl.Texture
    tops: Uploaded
    lids: Uploaded
    sides: Uploaded
    slab: Uploaded

    def release(self) -> None:
        """Free the memory."""
        for resource in (self.colors, self.openness, self.tops, self.lids, self.sides, self.slab):
            resource.release()


class FloorMeshes:
    """All matrices of a picture, in order."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._cache: GpuCache[object, Tiles, FloorMesh] = GpuCache(self._make, FloorMesh.release)
        self._shown: list[FloorMesh] = []
        self._lit = program(gl, shaders.TILES_VERTEX, shaders.TILES_FRAGMENT)
        self._clear = program(gl, shaders.OVERLAY_VERTEX, shaders.OVERLAY_FRAGMENT)
        self._draped = program(gl, shaders.DRAPED_VERTEX, shaders.OVERLAY_FRAGMENT)
        self._standing = program(gl, shaders.WALL_VERTEX, shaders.WALL_FRAGMENT)
        self._dark = program(gl, shaders.WALL_SHADOW, shaders.NOTHING)
        mesh = Mesh(_CORNERS, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        self._sheet = Uploaded(gl, mesh, "2f", ("corner",))
        self.lift = 0.003
        self.depth = 0.1

    @property
    def lies_deep(self) -> bool:
        """True if a floor has sides that reach below level 0."""
        return any(floor.opaque for floor in self._shown)

    def take(self, tiles: list[Tiles], lift: float, depth: float) -> None:
        """Set the matrices of a picture, each `lift` metres above the previous one."""
        # The depth is part of the vertices, so all meshes have to be built again.
        if depth != self.depth:
            self._cache.of(())
        self.lift, self.depth = lift, depth
        self._shown = self._cache.of(
            (_identity(matrix), matrix) for matrix in tiles if matrix.cells.size
        )

    def cast(self) -> None:
        """Draw shadow casters."""
        for floor in self._shown:
            floor.tops.draw(self._dark)
            floor.lids.draw(self._dark)
            floor.sides.draw(self._dark)

    def draw(self) -> None:
        """Draw walls and floors, those that hide others first."""
        opaque = [(rank, floor) for rank, floor in enumerate(self._shown) if floor.opaque]
        for _, floor in opaque:
            self._wall(floor)
        # The topmost first, so that hidden pixels of the others are not shaded.
        for rank, floor in reversed(opaque):
            floor.openness.use(OPENNESS)
            self._lay(floor, rank * self.lift, self._lit)

    def overlay(self) -> None:
        """Draw transparent matrices on the floor and on top of walls."""
        for rank, floor in enumerate(self._shown):
            if floor.opaque:
                continue
            self._lay(floor, rank * self.lift, self._clear)
            _set(self._draped, "over", np.linalg.inv(_lying(floor.tiles)))
            self._draped["level"] = rank * self.lift
            for other in self._shown:
                if other is not floor:
                    other.tops.draw(self._draped)

    def _lay(self, floor: FloorMesh, level: float, by: moderngl.Program) -> None:
        _set(by, "lying", _lying(floor.tiles))
        by["level"] = level
        floor.colors.use(COLORS)
        self._sheet.draw(by)

    def _wall(self, floor: FloorMesh) -> None:
        form = floor.tiles.form
        last = form.colors[-1][1]
        base = next((color for _, color in form.colors if color), "#dddddd")
        if not floor.tops.empty:
            self._paint(last, _lighter(last), (0.0, form.height))
            floor.tops.draw(self._standing)
            floor.sides.draw(self._standing)
            self._paint(form.colors[0][1], _lighter(last), (0.0, form.height))
            floor.lids.draw(self._standing)
        self._paint(base, tuple(0.93 * channel for channel in _share(base)), (-self.depth, 0.0))
        floor.slab.draw(self._standing)

    def _paint(self, top: str, side: tuple[float, ...], rise: tuple[float, float]) -> None:
        self._standing["top_color"] = _share(top)
        self._standing["side_color"] = side
        self._standing["rise"] = rise

    def _make(self, tiles: Tiles) -> FloorMesh:
        wall = walled(tiles)
        lid = lidded(tiles, wall)
        where, height = (tiles.cell, tiles.pose), tiles.form.height
        colors = painted(tiles)
        opaque = bool((colors[..., 3] == 255).all())
        # Only an opaque matrix has a slab below it.
        ground = np.full(wall.shape, opaque)
        return FloorMesh(
            tiles,
            opaque,
            self._texture(colors, smooth=False),
            self._texture(open_floor(wall | lid, tiles.cell)[..., None], smooth=True),
            self._uploaded(tops(wall, *where, height)),
            self._uploaded(tops(lid, *where, height)),
            self._uploaded(upright(wall | lid, *where, 0.0, height)),
            self._uploaded(upright(ground, *where, -self.depth, 0.0)),
        )

    def _uploaded(self, mesh: Mesh) -> Uploaded:
        return Uploaded(self._gl, mesh, *_PLACES)

    def _texture(self, image: np.ndarray, *, smooth: bool) -> moderngl.Texture:
        height, width, channels = image.shape
        # By default OpenGL expects rows whose lengths are multiples of four bytes.
        texture = self._gl.texture((width, height), channels, image.tobytes(), alignment=1)
        texture.repeat_x = texture.repeat_y = False
        # Averages of cells that are smaller than pixels, which would flicker.
        texture.build_mipmaps()
        near = moderngl.LINEAR if smooth else moderngl.NEAREST
        texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, near)
        return texture


def _lying(tiles: Tiles) -> NDArray[np.float64]:
    """From corners 0 to 1 of a matrix to metres, (3, 3)."""
    turn, (along, across) = np.radians(tiles.pose.angle), tiles.size
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array(
        [
            [cos * along, -sin * across, tiles.pose.x],
            [sin * along, cos * across, tiles.pose.y],
            [0.0, 0.0, 1.0],
        ]
    )


def _set(by: moderngl.Program, name: str, matrix: NDArray[np.floating[Any]]) -> None:
    """Set a matrix in column-major order, as OpenGL expects."""
    cast("moderngl.Uniform", by[name]).write(matrix.T.astype(np.float32).tobytes())


def _identity(tiles: Tiles) -> object:
    return id(tiles.cells), tiles.form, tiles.pose, tiles.cell


def _share(color: str) -> tuple[float, ...]:
    return tuple(channel / 255 for channel in rgb(color))


def _lighter(color: str) -> tuple[float, ...]:
    return tuple(channel + (1 - channel) * _SIDES_LIGHTER for channel in _share(color))
