"""Matrices on the page: those with a height as floors with walls, others as flat images."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from viser import ImageHandle, MeshHandle, SceneApi

from minerva_bus.semantics.colors import rgb
from minerva_bus.semantics.picture import Tiles
from minerva_services.views.web.batch import upright
from minerva_services.views.web.solids import flat, walls

_Nodes: TypeAlias = "list[MeshHandle | ImageHandle]"
# Approximate size in pixels to which small images are scaled up.
_MIN_PIXELS = 400
# Distance of images that lie on each other in metres.
_LAYER_HEIGHT = 0.004


class FloorNodes:
    """Nodes of all matrices, rebuilt only when a matrix changes."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._shown: dict[str, tuple[Tiles, _Nodes]] = {}

    def show(self, matrices: list[Tiles]) -> None:
        """Show exactly these."""
        names: dict[str, Tiles] = {}
        counts: dict[str, int] = {}
        for tiles in matrices:
            folder = f"/knowledge/{tiles.owner}" if tiles.owner else "/floor"
            counts[folder] = counts.get(folder, 0) + 1
            names[f"{folder}/{counts[folder]}"] = tiles
        for name in [name for name in self._shown if name not in names]:
            for node in self._shown.pop(name)[1]:
                node.remove()
        for layer, (name, tiles) in enumerate(names.items(), start=1):
            # Images at the same height would flicker.
            self._show(name, tiles, layer * _LAYER_HEIGHT)

    def _show(self, name: str, tiles: Tiles, height: float) -> None:
        before, nodes = self._shown.get(name, (None, []))
        if before is not None and _same(before, tiles):
            return
        # Only an image can be replaced in place; meshes are built again. A floor without coloured
        # cells has no node at all.
        node = nodes[0] if nodes and before is not None and _same_place(before, tiles) else None
        if isinstance(node, ImageHandle):
            node.image = image(tiles)
        else:
            for node in nodes:
                node.remove()
            nodes = (
                self._built(name, tiles) if tiles.form.height else self._laid(name, tiles, height)
            )
        self._shown[name] = tiles, nodes

    def _built(self, name: str, tiles: Tiles) -> _Nodes:
        """A floor with walls where cells are above 0, one mesh per colour."""
        pose, form = tiles.pose, tiles.form
        nodes: _Nodes = []
        for number, color in enumerate(_ranges(tiles)):
            # A mesh has one colour, and walls and ground are of different height.
            for stands in (False, True):
                mask = color[1] & ((tiles.cells > 0) == stands)
                if not mask.any():
                    continue
                make, top = (walls, form.height) if stands else (flat, 0.0)
                solid = make(mask, tiles.cell, top)
                nodes.append(
                    self._scene.add_mesh_simple(
                        f"{name}/{number}/{'walls' if stands else 'ground'}",
                        solid.vertices,
                        solid.faces,
                        color=color[0],
                        opacity=form.opacity if form.opacity < 1 else None,
                        flat_shading=True,
                        cast_shadow=stands,
                        position=(pose.x, pose.y, 0.0),
                        wxyz=upright(pose.angle),
                    )
                )
        return nodes

    def _laid(self, name: str, tiles: Tiles, height: float) -> _Nodes:
        """An image that lies on the ground."""
        width, depth = tiles.size
        middle = tiles.pose.then(width / 2, depth / 2)
        laid = self._scene.add_image(
            name,
            image(tiles),
            width,
            depth,
            # JPEG has no transparency.
            format="png",
            cast_shadow=False,
            receive_shadow=False,
            position=(middle.x, middle.y, height),
            wxyz=upright(tiles.pose.angle),
        )
        return [laid]


def image(tiles: Tiles) -> NDArray[np.uint8]:
    """Pixels (columns of the matrix, its rows, 4), scaled up so that cells have sharp edges."""
    pixels = np.zeros((*tiles.cells.shape, 4), np.uint8)
    opaque = round(255 * min(max(tiles.form.opacity, 0.0), 1.0))
    for color, mask in _ranges(tiles):
        pixels[mask] = (*color, opaque)
    times = max(1, min(8, _MIN_PIXELS // max(tiles.cells.shape)))
    return np.ascontiguousarray(
        pixels.transpose(1, 0, 2).repeat(times, axis=0).repeat(times, axis=1)
    )


def _ranges(tiles: Tiles) -> list[tuple[tuple[int, int, int], NDArray[np.bool_]]]:
    """Colours and the masks of their cells."""
    colors = tiles.form.colors
    ends = [*(least for least, _ in colors[1:]), math.inf]
    cells: NDArray[Any] = tiles.cells
    return [
        (rgb(color), (cells >= least) & (cells < end))
        for (least, color), end in zip(colors, ends, strict=True)
        if color
    ]


def _same(first: Tiles, second: Tiles) -> bool:
    return first is second or (first.cells is second.cells and _same_place(first, second))


def _same_place(first: Tiles, second: Tiles) -> bool:
    return _placement(first) == _placement(second)


def _placement(tiles: Tiles) -> tuple[object, ...]:
    return tiles.pose, tiles.cell, tiles.form, tiles.cells.shape
