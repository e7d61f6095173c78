"""The scene on the graphics card: all parts of a picture, in sunlight with a shadow map."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from minerva_services.geometry.picture import Copies, Discs, Picture, Texts, Tiles
from minerva_services.views.layout import round_step
from minerva_services.views.opengl import shaders
from minerva_services.views.opengl.camera import Floats, SceneCamera
from minerva_services.views.opengl.copies import CopyMeshes
from minerva_services.views.opengl.drums import Drums
from minerva_services.views.opengl.extent import SceneBox
from minerva_services.views.opengl.floors import FloorMeshes
from minerva_services.views.opengl.gpu import FRAME, SHADE, Uploaded, program
from minerva_services.views.opengl.pins import PinMeshes, PinSizes
from minerva_services.views.opengl.ribbons import Fans, Ribbons, raised_lines, ring
from minerva_services.views.opengl.solids import Mesh
from minerva_services.views.window.painter import Beams
from minerva_services.views.window.picking import Spot

# High in the south-west, so that shadows fall to the upper right of a map.
TO_SUN = np.array([-0.46, -0.36, 0.81]) / np.linalg.norm([-0.46, -0.36, 0.81])
SHADOW_STRENGTH = 0.9
_SHADOW_PIXELS = 2048
_SHADOW_MARGIN = 1.03


def sun_matrix(corners: Floats) -> Floats:
    """From (x, y, z, 1) to the shadow map of all corners (n, 3), 0 to 1, as (4, 4)."""
    # An orthographic projection: the sun is infinitely far away.
    right = np.cross([0.0, 0.0, 1.0], TO_SUN)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(TO_SUN, right), -TO_SUN])
    seen = corners @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    size = np.maximum(high - low, 1e-6) * _SHADOW_MARGIN
    matrix = np.eye(4)
    matrix[:3, :3] = axes / size[:, None]
    matrix[:3, 3] = 0.5 - (low + high) / 2 / size
    return matrix


class Shade:
    """The shadow map: depth of the scene as seen from the sun."""

    def __init__(self, gl: moderngl.Context) -> None:
        self.depth = gl.depth_texture((_SHADOW_PIXELS, _SHADOW_PIXELS))
        self.depth.compare_func = "<="
        # With a comparison, linear filtering averages four tests, which softens edges.
        self.depth.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.depth.repeat_x = self.depth.repeat_y = False
        self._target = gl.framebuffer(depth_attachment=self.depth)

    def begin(self) -> None:
        """Start drawing shadow casters."""
        self._target.scissor = None  # pyright: ignore[reportAttributeAccessIssue]
        self._target.use()
        self._target.clear(depth=1.0)
        # Keep the outermost pixels empty, so that everything beyond the map is lit.
        self._target.scissor = 1, 1, _SHADOW_PIXELS - 2, _SHADOW_PIXELS - 2


_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
_IN_ITS_LIGHT = (
    *(moderngl.DST_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA),
    *(moderngl.ZERO, moderngl.ONE),
)
"""Blending: transparent surfaces take the brightness below them; colours are premultiplied."""
# Number of discs and solids above which a software renderer does without smooth edges.
_MANY_DISCS = 3000
_GROUND_EXTENT = 4.0
"""Extent of the ground as a multiple of half the picture's diagonal."""


class GLScene:
    """Draws pictures with a camera."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        # Two matrices and three vectors, see _FRAME in `shaders`.
        self._frame = gl.buffer(reserve=4 * (16 + 16 + 4 + 4 + 4))
        self._frame.bind_to_uniform_block(FRAME)
        self._shade = Shade(gl)
        self._floors, self._drums, self._pins = FloorMeshes(gl), Drums(gl), PinMeshes(gl)
        self._copies = CopyMeshes(gl)
        self._ribbons, self._ring, self._fans = Ribbons(gl), Ribbons(gl), Fans(gl)
        self._back = program(gl, shaders.BACKDROP_VERTEX, shaders.BACKDROP_FRAGMENT)
        self._backdrop = gl.vertex_array(self._back, [])
        self._ground = program(gl, shaders.GROUND_VERTEX, shaders.GROUND_FRAGMENT)
        mesh = Mesh(_SQUARE, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        self._square = Uploaded(gl, mesh, "2f", ("corner",))
        self._extent = SceneBox(-1.0, -1.0, 1.0, 1.0, 0.0)
        self._level = 0.0

    @property
    def pins(self) -> PinMeshes:
        """The pins with texts."""
        return self._pins

    @property
    def crowded(self) -> bool:
        """True if there is so much to draw that slow machines should reduce quality."""
        return self._drums.count + self._copies.count > _MANY_DISCS

    def take(self, picture: Picture, extent: SceneBox) -> None:
        """Set the picture; parts that did not change stay on the graphics card."""
        self._extent = extent
        # Surfaces closer than this flicker where the depth buffer cannot separate them.
        lift = max(0.003, 4e-4 * extent.span)
        tiles = picture.of(Tiles)
        self._floors.take(tiles, lift, depth=0.02 * extent.span)
        self._drums.take(picture.of(Discs))
        self._copies.take(picture.of(Copies))
        # Lines lie above all matrices.
        self._level = lift * (len(tiles) + 1)
        self._ribbons.take(raised_lines(picture, self._level))
        radius = 0.010 * extent.span
        # Pins rise above the walls.
        height = max(extent.height + 4 * radius, 0.09 * extent.span)
        self._pins.take(picture.of(Texts), PinSizes(radius, height), picture.marked())

    def beam(self, beams: Sequence[Beams]) -> None:
        """Set the current laser beams."""
        self._fans.take(beams)

    def mark(self, spot: Spot | None) -> None:
        """Draw a ring around a disc; None removes it."""
        self._ring.take([ring(spot, self._level)] if spot is not None else [])

    def draw(
        self, camera: SceneCamera, size: tuple[int, int], *, surroundings: bool = True
    ) -> None:
        """Draw to the current target; shadows are drawn separately before.

        Args:
            camera: what it is drawn through.
            size: of the picture, pixels.
            surroundings: whether there are a ground and a sky around the picture's things.

        """
        self._write(camera, size)
        gl = self._gl
        self._shade.depth.use(SHADE)
        # "Or equal" for the backdrop, whose depth is that of the cleared buffer.
        gl.depth_func = "<="
        gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        # What lies on top first, so that hidden pixels of the floors are not shaded.
        self._drums.draw()
        self._copies.draw()
        self._pins.draw()
        self._floors.draw()
        gl.enable_only(moderngl.DEPTH_TEST)
        self._ribbons.draw()
        self._ring.draw()
        if surroundings:
            # Large surfaces last, because most of them is already covered.
            self._lay_ground()
            self._backdrop.render(moderngl.TRIANGLES, vertices=3)
        self._shine_through()

    def _shine_through(self) -> None:
        gl = self._gl
        gl.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        gl.blend_func = _IN_ITS_LIGHT  # pyright: ignore[reportAttributeAccessIssue]
        # Transparent surfaces must not hide one another.
        gl.fbo.depth_mask = False
        self._floors.overlay()
        self._fans.draw()
        gl.fbo.depth_mask = True
        gl.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA

    def shadows(self, camera: SceneCamera, size: tuple[int, int]) -> None:
        """Draw the shadow map."""
        self._write(camera, size)
        self._shade.begin()
        self._gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        # Shift depths away from the sun, or surfaces would shade themselves in stripes.
        self._gl.polygon_offset = 1.5, 2.0
        self._floors.cast()
        self._drums.cast()
        self._copies.cast()
        self._pins.cast()
        self._gl.polygon_offset = 0.0, 0.0

    def _lay_ground(self) -> None:
        extent = self._extent
        # Without slabs, just below level 0: transparent floors lie there.
        below = -self._floors.depth if self._floors.lies_deep else -0.001
        below = min(below, self._copies.lowest)
        self._ground["span"] = *extent.middle, _GROUND_EXTENT * extent.span, below
        self._ground["step"] = round_step(extent.span / 8)
        self._square.draw(self._ground)

    def _write(self, camera: SceneCamera, size: tuple[int, int]) -> None:
        width, height = size
        corners = self._extent.corners
        # Pins and discs are taller than the extent; the shadow map must contain what casts shadows.
        tallest = self._extent.height + 0.15 * self._extent.span
        corners = np.concatenate([corners, corners + np.array([0.0, 0.0, tallest])])
        numbers = [
            camera.matrix(width / height).T.ravel(),
            sun_matrix(corners).T.ravel(),
            [*camera.eye, self._extent.span],
            [*TO_SUN, SHADOW_STRENGTH],
            [width, height, camera.metre(height), 0.0],
        ]
        self._frame.write(np.concatenate(numbers).astype(np.float32))
