"""Cell colours, and which cells are walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Tiles
from minerva_services.geometry.volumes import color_ranges
from minerva_services.views.solids import enclosed

_WALL_DISTANCE = 0.45
"""Distance in metres from a wall within which the floor is darkened."""


def painted(tiles: Tiles) -> NDArray[np.uint8]:
    """Cell colours with opacity, (columns, rows, 4): rows lie along a texture's x."""
    opaque = round(255 * tiles.form.opacity)
    palette = [(0, 0, 0, 0)]
    palette += [(*rgb(c), opaque) if c else (0, 0, 0, 0) for _, c in tiles.form.colors]
    colors = np.array(palette, np.uint8)[color_ranges(tiles.cells, tiles.form.colors)]
    return np.ascontiguousarray(colors.transpose(1, 0, 2))


def walled(tiles: Tiles) -> NDArray[np.bool_]:
    """Cells that stand up: those of the last colour, if the form has a height."""
    if tiles.form.height <= 0 or not tiles.form.colors[-1][1]:
        return np.zeros(tiles.cells.shape, np.bool_)
    return np.asarray(tiles.cells >= tiles.form.colors[-1][0])


def lidded(tiles: Tiles, wall: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells of the first colour enclosed by walls: on a map, the inside of solid objects."""
    if len(tiles.form.colors) < 3 or not wall.any():
        return np.zeros(wall.shape, np.bool_)
    return enclosed(color_ranges(tiles.cells, tiles.form.colors) <= 1, wall)


def open_floor(mask: NDArray[np.bool_], cell: float) -> NDArray[np.uint8]:
    """Ambient openness of each cell, 255 far from walls, (columns, rows) as a texture."""
    reach = max(1, round(_WALL_DISTANCE / cell / 3))
    near = mask.astype(np.float32)
    # Three means in a row approximate a Gaussian blur, at a cost that does not depend on its
    # radius.
    for _ in range(3):
        near = _blurred(_blurred(near, reach).T, reach).T
    return np.ascontiguousarray(np.round(255 * (1 - np.clip(near, 0, 1))).astype(np.uint8).T)


def _blurred(values: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Each row replaced by the mean of `reach` rows to both sides."""
    sums = np.cumsum(np.pad(values, ((reach + 1, reach), (0, 0)), "edge"), axis=0)
    means = (sums[2 * reach + 1 :] - sums[: -2 * reach - 1]) / (2 * reach + 1)
    return means.astype(np.float32)
