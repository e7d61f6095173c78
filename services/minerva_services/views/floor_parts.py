"""Matrices of a picture for 3D views: their names, layers, images, and meshes of walls."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.colors import Color, rgb
from minerva_bus.semantics.picture import Tiles
from minerva_services.views.solids import Solid, flat, walls

_MIN_PIXELS = 400
"""Approximate size in pixels to which small images are scaled up."""
_LAYER_HEIGHT = 0.004
"""Distance of images that lie on each other in metres; at the same height they would flicker."""


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """A matrix with the height of its layer in metres."""

    tiles: Tiles
    height: float

    def is_at(self, other: Floor) -> bool:
        """Whether both have the same form, size and place."""
        first, second = self.tiles, other.tiles
        return (first.pose, first.cell, first.form, first.cells.shape) == (
            second.pose,
            second.cell,
            second.form,
            second.cells.shape,
        )

    def is_same(self, other: Floor) -> bool:
        """Whether both look the same, and a view need not draw the other one."""
        same_cells = self.tiles.cells is other.tiles.cells
        return self.tiles is other.tiles or (same_cells and self.is_at(other))


@dataclass(frozen=True, slots=True, eq=False)
class ColoredMesh:
    """The cells of one colour, either as `walls` or as a part of the ground."""

    name: str
    solid: Solid
    color: Color
    walls: bool


def named_floors(matrices: Sequence[Tiles]) -> dict[str, Floor]:
    """The matrices by path: `/floor/1` for the world's, `/knowledge/NAME/1` for an agent's."""
    floors: dict[str, Floor] = {}
    counts: dict[str, int] = {}
    for layer, tiles in enumerate(matrices, start=1):
        folder = f"/knowledge/{tiles.owner}" if tiles.owner else "/floor"
        counts[folder] = counts.get(folder, 0) + 1
        floors[f"{folder}/{counts[folder]}"] = Floor(tiles, layer * _LAYER_HEIGHT)
    return floors


def floor_meshes(tiles: Tiles) -> Iterator[ColoredMesh]:
    """A floor whose form has a height as meshes: cells above 0 are walls of that height."""
    for number, (color, cells) in enumerate(color_ranges(tiles)):
        # A mesh has one colour, and walls and ground are of different height.
        for stands in (False, True):
            mask = cells & ((tiles.cells > 0) == stands)
            if not mask.any():
                continue
            make, top = (walls, tiles.form.height) if stands else (flat, 0.0)
            name = f"{number}/{'walls' if stands else 'ground'}"
            yield ColoredMesh(name, make(mask, tiles.cell, top), color, stands)


def pixels(tiles: Tiles) -> NDArray[np.uint8]:
    """Pixels (columns of the matrix, its rows, 4), red to alpha, one for each cell."""
    colored = np.zeros((*tiles.cells.shape, 4), np.uint8)
    opaque = round(255 * min(max(tiles.form.opacity, 0.0), 1.0))
    for color, mask in color_ranges(tiles):
        colored[mask] = (*color, opaque)
    return np.ascontiguousarray(colored.transpose(1, 0, 2))


def image(tiles: Tiles) -> NDArray[np.uint8]:
    """As `pixels`, scaled up so that cells have sharp edges."""
    times = max(1, min(8, _MIN_PIXELS // max(tiles.cells.shape)))
    return pixels(tiles).repeat(times, axis=0).repeat(times, axis=1)


def color_ranges(tiles: Tiles) -> list[tuple[Color, NDArray[np.bool_]]]:
    """Colours and the masks of their cells."""
    colors = tiles.form.colors
    ends = [*(least for least, _ in colors[1:]), math.inf]
    cells: NDArray[Any] = tiles.cells
    return [
        (rgb(color), (cells >= least) & (cells < end))
        for (least, color), end in zip(colors, ends, strict=True)
        if color
    ]
