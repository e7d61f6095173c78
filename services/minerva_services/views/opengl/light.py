"""Sunlight and its shadow map."""

from __future__ import annotations

import moderngl
import numpy as np

from minerva_services.views.opengl.camera import Floats

TO_SUN = np.array([-0.46, -0.36, 0.81]) / np.linalg.norm([-0.46, -0.36, 0.81])
STRENGTH = 0.9
_SIDE = 2048
_ROOM = 1.03


def sun_matrix(corners: Floats) -> Floats:
    """From (x, y, z, 1) to the shadow map of all corners (n, 3), 0 to 1, as (4, 4)."""
    right = np.cross([0.0, 0.0, 1.0], TO_SUN)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(TO_SUN, right), -TO_SUN])
    seen = corners @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    size = np.maximum(high - low, 1e-6) * _ROOM
    made = np.eye(4)
    made[:3, :3] = axes / size[:, None]
    made[:3, 3] = 0.5 - (low + high) / 2 / size
    return made


class Shade:
    """The shadow map: depth of the scene as seen from the sun."""

    def __init__(self, gl: moderngl.Context) -> None:
        self.depth = gl.depth_texture((_SIDE, _SIDE))
        self.depth.compare_func = "<="
        self.depth.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.depth.repeat_x = self.depth.repeat_y = False
        self._target = gl.framebuffer(depth_attachment=self.depth)

    def begin(self) -> None:
        """Start drawing shadow casters."""
        self._target.scissor = None  # pyright: ignore[reportAttributeAccessIssue]
        self._target.use()
        self._target.clear(depth=1.0)
        # Keep the outermost pixels empty, so that everything beyond the map is lit.
        self._target.scissor = 1, 1, _SIDE - 2, _SIDE - 2
