"""Any number of copies of a solid, as one node of the page."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import BatchedMeshHandle, SceneApi

from minerva_services.views.solids import Solid

Array = NDArray[Any]
MANY_COPIES = 1000
"""Number of copies from which each needs fewer sides and casts no shadow."""


class Batch:
    """Copies of a solid; unchanged data are not sent again."""

    def __init__(self, scene: SceneApi, name: str, *, flat: bool = False) -> None:
        self._scene = scene
        self._name = name
        self._flat = flat
        self._solid: Solid | None = None
        self._node: BatchedMeshHandle | None = None

    def show(
        self, solid: Solid, positions: Array, turns: Array, scales: Array, colors: Array
    ) -> None:
        """Show copies: positions (n, 3), rotations (n, 4), scales (n, 3), colours (n, 3)."""
        if self._node is not None and (solid is not self._solid or not len(positions)):
            self._node.remove()
            self._node = None
        if not len(positions):
            return
        self._solid = solid
        if self._node is None:
            self._node = self._added(solid, positions, turns, scales, colors)
            return
        self._node.batched_positions = positions.astype(np.float32)
        self._node.batched_wxyzs = turns.astype(np.float32)
        self._node.batched_scales = scales.astype(np.float32)
        self._node.batched_colors = _linear(colors)

    def _added(
        self, solid: Solid, positions: Array, turns: Array, scales: Array, colors: Array
    ) -> BatchedMeshHandle:
        return self._scene.add_batched_meshes_simple(
            self._name,
            solid.vertices,
            solid.faces,
            turns.astype(np.float32),
            positions.astype(np.float32),
            batched_scales=scales.astype(np.float32),
            batched_colors=_linear(colors),
            lod="off",
            flat_shading=False,
            side="double" if self._flat else "front",
            cast_shadow=not self._flat and len(positions) < MANY_COPIES,
            receive_shadow=False,
        )


def _linear(colors: Array) -> NDArray[np.uint8]:
    """Linear light of sRGB colours: browsers expect that for instances, but sRGB for meshes."""
    shares = colors / 255.0
    light = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return np.round(255 * light).astype(np.uint8)
