"""Parts of pictures for 3D views: solids, walls, discs, lines and floors as meshes and tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minerva_services.geometry.colors import Color, rgb
from minerva_services.geometry.picture import Discs, Polyline, Solid, Tiles
from minerva_services.geometry.volumes import mask_rectangles

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@cache
def cylinder(sides: int) -> Solid:
    """A cylinder of radius and height 1 on the ground, without a bottom."""
    return around(((1.0, 0.0), (1.0, 1.0), (0.0, 1.0)), sides)


@cache
def pin(sides: int = 20) -> Solid:
    """A pin of height 1 with its tip at the origin and a round head."""
    head = [
        (0.16 * math.sin(turn), 0.84 - 0.16 * math.cos(turn))
        for turn in np.linspace(0.5, math.pi, 9)
    ]
    return around(((0.0, 0.0), *head), sides)


@cache
def arrow() -> Solid:
    """The heading mark: flat, along x, within the unit circle."""
    corners = [(0.78, 0.0), (-0.54, 0.45), (-0.28, 0.0), (-0.54, -0.45)]
    return _solid([(x, y, 0.0) for x, y in corners], [(0, 1, 2), (0, 2, 3)])


@cache
def ring(sides: int = 48) -> Solid:
    """A flat ring from radius 1 to 1.35."""
    turns = np.arange(sides) * (2 * math.pi / sides)
    edges = [
        (reach * math.cos(turn), reach * math.sin(turn), 0.0)
        for reach in (1.0, 1.35)
        for turn in turns
    ]
    faces: list[tuple[int, int, int]] = []
    for start in range(sides):
        end = (start + 1) % sides
        faces += [(start, sides + start, sides + end), (start, sides + end, end)]
    return _solid(edges, faces)


def normals(solid: Solid) -> NDArray[np.float32]:
    """The direction outwards at each vertex, the mean over its triangles; shape (n, 3)."""
    a, b, c = solid.vertices[solid.faces].swapaxes(0, 1)
    # Their lengths are the areas, by which larger triangles count more.
    facing = np.cross(b - a, c - a)
    sums = np.zeros(solid.vertices.shape, np.float64)
    for corner in solid.faces.T:
        np.add.at(sums, corner, facing)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return (sums / np.maximum(lengths, 1e-12)).astype(np.float32)


def upright(angles: ArrayLike) -> NDArray[np.float64]:
    """Quaternions (w, x, y, z) of shape (..., 4) for angles in degrees of shape (...)."""
    half = np.radians(np.asarray(angles, np.float64)) / 2
    nothing = np.zeros_like(half)
    return np.stack([np.cos(half), nothing, nothing, np.sin(half)], axis=-1)


def around(profile: tuple[tuple[float, float], ...], sides: int) -> Solid:
    """A profile of (radius, height), from bottom to top, rotated around the z axis.

    Each segment has its own vertices, so that edges stay sharp.
    """
    turns = np.arange(sides) * (2 * math.pi / sides)
    vertices: list[tuple[float, float, float]] = []
    faces: list[tuple[int, int, int]] = []
    for (low, bottom), (high, top) in pairwise(profile):
        first = len(vertices)
        vertices += [(low * math.cos(t), low * math.sin(t), bottom) for t in turns]
        vertices += [(high * math.cos(t), high * math.sin(t), top) for t in turns]
        for start in range(sides):
            end = (start + 1) % sides
            here, there = first + start, first + end
            # At the axis, where the radius is 0, a quad is a single triangle.
            if low:
                faces.append((here, there, there + sides))
            if high:
                faces.append((here, there + sides, here + sides))
    return _solid(vertices, faces)


def _solid(vertices: list[tuple[float, float, float]], faces: list[tuple[int, int, int]]) -> Solid:
    return Solid(np.array(vertices, np.float32), np.array(faces, np.uint32))


def flat(mask: Mask, cell: float, height: float) -> Solid:
    """The cells of a mask as a surface at a height; rows along x, columns along y."""
    x, y, rows, columns = mask_rectangles(mask).T * cell
    level = np.full(len(x), height)
    corners = [(x, y), (x + rows, y), (x + rows, y + columns), (x, y + columns)]
    return _quads([(across, along, level) for across, along in corners])


def walls(mask: Mask, cell: float, height: float) -> Solid:
    """The cells of a mask as blocks of a height, without bottoms."""
    x, y, far_x, far_y, _ = sides(mask).T * cell
    low, high = np.zeros(len(x)), np.full(len(x), height)
    corners = [(x, y, low), (far_x, far_y, low), (far_x, far_y, high), (x, y, high)]
    top, side = flat(mask, cell, height), _quads(corners)
    faces = np.concatenate([top.faces, side.faces + np.uint32(len(top.vertices))])
    return Solid(np.concatenate([top.vertices, side.vertices]), faces)


def _quads(corners: list[tuple[Floats, Floats, Floats]]) -> Solid:
    """n rectangles from their four corners, each given for all n."""
    points = np.stack([np.stack(corner, axis=1) for corner in corners], axis=1)
    first = np.arange(len(points))[:, None, None] * 4
    faces = first + np.array([[0, 1, 2], [0, 2, 3]])
    return Solid(points.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.uint32))


Cells = NDArray[np.bool_]
Integers = NDArray[np.int64]


def sides(mask: Cells) -> Integers:
    """Sides (n, 5) between true and false cells: row, column, row, column, facing direction.

    The corners are ordered such that true cells lie to the left of the way from the first to the
    second. Directions: down the rows (0), up the rows (1), down the columns (2), up the columns
    (3).
    """
    # With padding, the border of the matrix is a side as well.
    padded = np.pad(mask, 1)
    down, up = padded[1:, :] & ~padded[:-1, :], padded[:-1, :] & ~padded[1:, :]
    left, right = padded[:, 1:] & ~padded[:, :-1], padded[:, :-1] & ~padded[:, 1:]
    edges = [
        _sides(down[:, 1:-1], 0),
        _sides(up[:, 1:-1], 1),
        _sides(left[1:-1, :].T, 2),
        _sides(right[1:-1, :].T, 3),
    ]
    return np.concatenate(edges)


def enclosed(hollow: Cells, wall: Cells) -> Cells:
    """Hollow cells that are enclosed by walls: no path over hollow cells leads outside."""
    beside = np.pad(~(hollow | wall), 1, constant_values=True)
    near = beside[2:, 1:-1] | beside[:-2, 1:-1] | beside[1:-1, 2:] | beside[1:-1, :-2]
    reachable, before = hollow & near, -1
    # Each pass fills whole runs in both directions, so few passes suffice.
    while (count := int(reachable.sum())) != before:
        before = count
        reachable = _spread(_spread(reachable, hollow).T, hollow.T).T
    return hollow & ~reachable


def _spread(reached: Cells, hollow: Cells) -> Cells:
    """Runs of hollow cells along the columns that contain a reached cell."""
    if not hollow.size:
        return hollow
    opens = np.ones(hollow.shape, np.bool_)
    # Each line begins a run, because runs must not continue from one line to the next.
    opens[:, 1:] = hollow[:, 1:] != hollow[:, :-1]
    starts = np.flatnonzero(opens)
    touched = np.logical_or.reduceat(reached.ravel(), starts)
    lengths = np.diff(starts, append=hollow.size)
    return np.repeat(touched, lengths).reshape(hollow.shape) & hollow


def _sides(edges: Cells, way: int) -> Integers:
    line, first, past = _runs(edges)
    start, end = (past, first) if way in (0, 3) else (first, past)
    corners = (line, start, line, end) if way < 2 else (start, line, end, line)
    return np.stack([*corners, np.full_like(line, way)], axis=1)


def _runs(mask: Cells) -> tuple[Integers, Integers, Integers]:
    """Row, first column and end column of all runs of true cells."""
    padded = np.pad(mask, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    row, first = np.nonzero(steps == 1)
    _, past = np.nonzero(steps == -1)
    return row, first, past


HEIGHT_STEP = 0.01
"""Relative growth of the height per disc."""
_MAX_HEIGHT = 0.5
"""Relative growth of the height over all discs, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class DiscTable:
    """All discs of a picture in columns: (n,) each, colours (n, 3).

    `height` grows slightly with each row, so that the later of two overlapping discs is visible.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    angle: NDArray[np.float64]
    radius: NDArray[np.float64]
    height: NDArray[np.float64]
    color: NDArray[np.uint8]
    heading: NDArray[np.bool_]
    parts: tuple[Discs, ...]

    def __len__(self) -> int:
        return len(self.x)

    def agent(self, row: int) -> str:
        """The agent of a disc; "" for scenery."""
        discs, row = self._locate(row)
        return discs.agent(row)

    def owner(self, row: int) -> str:
        """The fragment of a disc; "" for scenery."""
        discs, row = self._locate(row)
        return discs.owners[row]

    @property
    def mark_height(self) -> NDArray[np.float64]:
        """Heights of the heading marks in metres (n,), slightly above the discs."""
        return self.height * (1 + HEIGHT_STEP / 3)

    def _locate(self, row: int) -> tuple[Discs, int]:
        for discs in self.parts:
            if row < len(discs):
                return discs, row
            row -= len(discs)
        raise IndexError(row)


def disc_table(parts: list[Discs]) -> DiscTable:
    """The discs of a picture, in order."""

    def joined(name: str, empty: tuple[int, ...] = (0,)) -> NDArray[Any]:
        columns = [getattr(discs, name) for discs in parts]
        return np.concatenate(columns) if columns else np.zeros(empty)

    count = sum(map(len, parts))
    # The total growth is limited, or the last of many discs would be a tower.
    growth: NDArray[Any] = 1 + min(HEIGHT_STEP, _MAX_HEIGHT / max(1, count)) * np.arange(count)
    return DiscTable(
        joined("x"),
        joined("y"),
        joined("angle"),
        joined("radius"),
        joined("height") * growth,
        joined("color", (0, 3)).astype(np.uint8),
        joined("heading").astype(np.bool_),
        tuple(parts),
    )


# Metres above the floor; the length of a dash (_DASH) is in line widths.
_LEVEL = 0.06
_DASH = 3.0
_MAX_DASHES = 400


def segments(line: Polyline) -> NDArray[np.float32]:
    """The segments (n, 2, 3) of a line."""
    points = _dashes(line) if line.form.dashed else np.stack([line.points[:-1], line.points[1:]], 1)
    above = np.full((*points.shape[:-1], 1), _LEVEL)
    return np.concatenate([points, above], axis=-1).astype(np.float32)


def _dashes(line: Polyline) -> NDArray[np.float64]:
    """Dashes (n, 2, 2) along a line, separated by gaps of equal length; shorter in corners."""
    steps = np.hypot(*np.diff(line.points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    length = along[-1]
    # A long line gets longer dashes, which bounds what is sent to the browsers.
    dash = max(_DASH * line.form.width, length / _MAX_DASHES, 1e-6)
    begins = np.arange(0.0, max(length, dash), 2 * dash)
    ends = np.minimum(begins + dash, length)

    def at(distance: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(distance, along, line.points[:, axis]) for axis in (0, 1)], 1)

    return np.stack([at(begins), at(ends)], axis=1)


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
