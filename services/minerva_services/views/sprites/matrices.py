"""Matrices as images: coloured once, averaged where cells are smaller than pixels, and cached."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pygame
from numpy.typing import NDArray

from minerva_bus.grammar.appearance import Raster
from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Tiles
from minerva_services.views.sprites.camera import MapCamera

Image: TypeAlias = NDArray[np.uint32]
"""Pixels (rows, columns) in SDL's packing: alpha, red, green, blue, premultiplied."""
_MARGIN = 0.25
"""Margin drawn around the screen, as a fraction of it, so that dragging needs no redraw."""


@dataclass(slots=True)
class _CachedMatrix:
    """A coloured matrix, and its most recently drawn part."""

    cells: weakref.ref[NDArray[Any]]
    form: Raster
    coarse: int
    image: Image
    place: _Place | None = None
    surface: pygame.Surface | None = None


@dataclass(frozen=True, slots=True)
class _Place:
    """The drawn part of a matrix: camera, pose, and rectangle on the screen."""

    camera: MapCamera
    tiles: tuple[float, float, float, float]
    left: int
    top: int
    right: int
    bottom: int


class MatrixLayer:
    """Draws matrices; those not drawn during a whole picture are evicted."""

    def __init__(self) -> None:
        self._cache: dict[tuple[int, int], _CachedMatrix] = {}
        self._used: set[tuple[int, int]] = set()

    def forget_unused(self) -> None:
        """Evict unused matrices; call after each picture."""
        self._cache = {key: entry for key, entry in self._cache.items() if key in self._used}
        self._used = set()

    def draw(self, canvas: pygame.Surface, tiles: Tiles, camera: MapCamera) -> None:
        """Draw the visible part of a matrix."""
        if not tiles.cells.size or tiles.cell <= 0:
            return
        wanted = _seen(tiles, camera, 0.0)
        if wanted is None:
            return
        cached = self._colored(tiles, camera)
        offset = _offset(cached, camera, wanted)
        if offset is None:
            place = _seen(tiles, camera, _MARGIN)
            assert place is not None
            cached.surface, cached.place = _surface(cached, tiles, place), place
            offset = place.left, place.top
        assert cached.surface is not None
        canvas.blit(cached.surface, offset, special_flags=pygame.BLEND_PREMULTIPLIED)

    def _colored(self, tiles: Tiles, camera: MapCamera) -> _CachedMatrix:
        # Cells smaller than 0.8 pixels are averaged; without that, thin walls would flicker.
        coarse = max(1, math.ceil(1 / (tiles.cell * camera.scale) - 0.25))
        coarse = min(coarse, *tiles.cells.shape)
        key = id(tiles.cells), id(tiles.form)
        cached = self._cache.get(key)
        self._used.add(key)
        # An id may be reused after its matrix was freed, so compare the object as well.
        if cached is None or cached.cells() is not tiles.cells or cached.coarse != coarse:
            image = averaged(colored(tiles.cells, tiles.form), coarse)
            cached = _CachedMatrix(weakref.ref(tiles.cells), tiles.form, coarse, image)
            self._cache[key] = cached
        return cached


def colored(cells: NDArray[Any], form: Raster) -> NDArray[np.uint8]:
    """A matrix (rows, columns) as blue, green, red and alpha, premultiplied, (.., .., 4)."""
    shades = np.zeros((len(form.colors) + 1, 4), np.uint8)
    for at, (_, color) in enumerate(form.colors, start=1):
        if color:
            red, green, blue = rgb(color)
            shades[at] = [round(channel * form.opacity) for channel in (blue, green, red, 255)]
    least = np.array([entry for entry, _ in form.colors])
    return shades[np.searchsorted(least, cells, side="right")]


def averaged(colors: NDArray[np.uint8], coarse: int) -> Image:
    """Packed colours of (rows, columns, 4), with `coarse` x `coarse` cells averaged."""
    if coarse > 1:
        rows, columns = (-(-entry // coarse) for entry in colors.shape[:2])
        padding = rows * coarse - colors.shape[0], columns * coarse - colors.shape[1]
        padded = np.pad(colors, ((0, padding[0]), (0, padding[1]), (0, 0)), mode="edge")
        blocks = padded.reshape(rows, coarse, columns, coarse, 4)
        colors = np.rint(blocks.mean(axis=(1, 3), dtype=np.float32)).astype(np.uint8)
    # Blue, green, red and alpha in memory are one little-endian integer in SDL's packing.
    return np.ascontiguousarray(colors).view("<u4")[..., 0]


def _seen(tiles: Tiles, camera: MapCamera, margin: float) -> _Place | None:
    """The part of the screen, plus a margin, that a matrix covers."""
    across, along = tiles.size
    steps = (0.0, 0.0), (across, 0.0), (0.0, along), (across, along)
    corners = [tiles.pose.point(x, y) for x, y in steps]
    places = [camera.to_screen(x, y) for x, y in corners]
    width, height = camera.size
    left, right = (pick(x for x, _ in places) for pick in (min, max))
    top, bottom = (pick(y for _, y in places) for pick in (min, max))
    box = (
        math.floor(max(left, -margin * width)),
        math.floor(max(top, -margin * height)),
        math.ceil(min(right, (1 + margin) * width)),
        math.ceil(min(bottom, (1 + margin) * height)),
    )
    if box[0] >= box[2] or box[1] >= box[3]:
        return None
    pose = tiles.pose
    return _Place(camera, (pose.x, pose.y, pose.angle, tiles.cell), *box)


def _offset(cached: _CachedMatrix, camera: MapCamera, wanted: _Place) -> tuple[int, int] | None:
    """Where to place the cached part; None if it must be redrawn."""
    place = cached.place
    if place is None or place.tiles != wanted.tiles:
        return None
    if (place.camera.scale, place.camera.size) != (camera.scale, camera.size):
        return None
    x, y = camera.to_screen(place.camera.x, place.camera.y)
    width, height = camera.size
    dx, dy = round(x - width / 2), round(y - height / 2)
    covers = (
        # Rounding may shift an edge by a pixel.
        place.left + dx <= wanted.left + 1
        and place.top + dy <= wanted.top + 1
        and place.right + dx >= wanted.right - 1
        and place.bottom + dy >= wanted.bottom - 1
    )
    return (place.left + dx, place.top + dy) if covers else None


def _surface(cached: _CachedMatrix, tiles: Tiles, place: _Place) -> pygame.Surface:
    """The part of a matrix within a screen rectangle; each pixel has the colour at its centre."""
    right, down = np.arange(place.left, place.right), np.arange(place.top, place.bottom)
    camera, cell = place.camera, tiles.cell * cached.coarse
    width, height = camera.size
    x = camera.x + (right + 0.5 - width / 2) / camera.scale - tiles.pose.x
    y = camera.y - (down + 0.5 - height / 2) / camera.scale - tiles.pose.y
    rows, columns = cached.image.shape
    turn = math.radians(tiles.pose.angle)
    # Unrotated, rows and columns are independent: index them separately, which is much faster.
    if tiles.pose.angle % 360 == 0:
        row, column = _index(x / cell, rows)[:, None], _index(y / cell, columns)[None, :]
        pixels = cached.image[row, column]
    else:
        cos, sin = math.cos(turn) / cell, math.sin(turn) / cell
        across = x[:, None] * cos + y[None, :] * sin
        along = y[None, :] * cos - x[:, None] * sin
        pixels = cached.image[_index(across, rows), _index(along, columns)]
        size = tiles.cells.shape[0] / cached.coarse, tiles.cells.shape[1] / cached.coarse
        inside = (across >= 0) & (across < size[0]) & (along >= 0) & (along < size[1])
        pixels = np.where(inside, pixels, np.uint32(0))
    surface = pygame.Surface((len(right), len(down)), pygame.SRCALPHA, 32)
    pygame.surfarray.blit_array(surface, pixels)
    return surface


def _index(places: NDArray[np.floating[Any]], count: int) -> NDArray[np.intp]:
    return np.clip(np.floor(places).astype(np.intp), 0, count - 1)
