"""The view `solids`: pictures of solids in space, in SVG and PNG, seen obliquely from above.

Bodies are drawn from far to near, each face in the shade of its direction; maps whose form has a
height are walls. It has the options of the view `svg`.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.assets import connect
from minerva_bodies.painting import Face, Whole, face_of, painted
from minerva_bodies.pictures import SpacePictures
from minerva_bodies.shapes import unit_solid
from minerva_bus.grammar.appearance import Disc, Raster
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import WorldInfo
from minerva_services.geometry.colors import Legend, LegendEntry
from minerva_services.geometry.picture import Copies, Discs, Floats, Lists, Solid, Tiles
from minerva_services.views.solids import cylinder, floor_meshes
from minerva_services.views.svg import Svg

Polygons: TypeAlias = list[tuple[int, ...]]

_AZIMUTH, _ELEVATION = math.radians(-60.0), math.radians(38.0)
_MARGIN, _FOOT, _ROW = 0.04, 64, 28
_BALLS = unit_solid("ball", 0.0, True), unit_solid("ball", 0.0, False)
_LIGHT = np.array([0.35, -0.55, 0.76])


def _axes() -> Floats:
    """Rows: right, up and towards the eye, in the axes of the world."""
    sin, cos = math.sin(_AZIMUTH), math.cos(_AZIMUTH)
    high, flat = math.sin(_ELEVATION), math.cos(_ELEVATION)
    return np.array(
        [[-sin, cos, 0.0], [-cos * high, -sin * high, flat], [cos * flat, sin * flat, high]]
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """A copy of a solid: its vertices in the world, its colour, and its factor of size."""

    solid: Solid
    points: Floats
    color: NDArray[Any]
    size: float

    @property
    def reach(self) -> float:
        """Half of its greatest extent along an axis."""
        return float(np.ptp(self.points, axis=0).max()) / 2


_LARGE, _MAX_FACES = 3.0, 1000
"""A solid so many times as large as most is drawn by its faces, if it has no more than these."""


class SolidPictures:
    """A series of pictures of one world, which show the same part of it, or more.

    Args:
        world: its name.
        vocabulary: with the forms of its primitives.
        width: in pixels.

    """

    def __init__(self, world: str, vocabulary: Vocabulary, width: int) -> None:
        self._world, self._width = world, width
        self._lists = Lists(vocabulary, SpacePictures(WorldInfo(world, vocabulary, 0, 0.0)))
        self._axes = _axes()
        rasters = [each.shape for each in vocabulary.primitives.values()]
        self._upright = {
            color
            for form in rasters
            if isinstance(form, Raster) and (form.height or form.spatial)
            for _, color in form.colors
        }
        self._maps: dict[tuple[int, Pose], tuple[Tiles, list[_Drawn]]] = {}
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    def draw(self, scene: Scene, frame: int) -> str:
        """The SVG document of a view, a string of L(E), in a frame."""
        picture = self._lists.picture(scene, {})
        solids = [
            _Drawn(copies.solid, points, copies.color[row], float(copies.sizes[row, 0]))
            for copies in picture.of(Copies)
            for row, points in enumerate(copies.points())
        ]
        maps = [tiles for tiles in picture.of(Tiles) if tiles.form.height]
        # A map that has not changed is the same matrix.
        known = [self._maps.get((id(tiles.cells), tiles.pose)) for tiles in maps]
        self._maps = {
            (id(tiles.cells), tiles.pose): before or (tiles, [*_walls(tiles)])
            for tiles, before in zip(maps, known, strict=True)
        }
        solids += [wall for _, walls in self._maps.values() for wall in walls]
        solids += [disc for discs in picture.of(Discs) for disc in _upright(discs)]
        flat = [solid.points @ self._axes[:2].T for solid in solids] or [np.zeros((1, 2))]
        together = np.concatenate(flat)
        self._low = np.minimum(self._low, together.min(axis=0))
        self._high = np.maximum(self._high, together.max(axis=0))
        size = np.maximum(self._high - self._low, 1e-3)
        scale = self._width * (1 - 2 * _MARGIN) / size[0]
        height = round(size[1] * scale + 2 * _MARGIN * self._width)
        shapes = self._shapes(solids, scale, height)
        rows = max((row for _, row, _ in self._placed(picture.legend)), default=0)
        whole = height + _FOOT + rows * _ROW
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" width="{self._width}"'
                f' height="{whole}" viewBox="0 0 {self._width} {whole}">',
                '<rect width="100%" height="100%" fill="#f5f0e6"/>',
                *shapes,
                *self._foot(picture.legend, frame, height),
                "</svg>",
            ]
        )

    def _shapes(self, solids: list[_Drawn], scale: float, height: int) -> Iterator[str]:
        large = _LARGE * float(np.median([each.reach for each in solids])) if solids else 0.0
        faces, wholes = list[Face](), list[Whole]()
        for each in solids:
            is_ball = each.solid in _BALLS
            own = [] if is_ball else self._seen(each)
            if each.reach > large and not is_ball and len(own) <= _MAX_FACES:
                faces += own
                continue
            shapes = [self._polygon(face, scale, height) for face in own]
            shapes += self._ball(each, scale, height) if is_ball else ()
            below = bool(each.points[:, 2].max() <= 1e-6)  # Under all that stands on the ground.
            rank = not below, float((each.points @ self._axes[2]).mean())
            wholes.append(Whole(each.points.mean(axis=0), rank, tuple(shapes)))
        for part in painted(faces, wholes, 0.5 / scale):
            if isinstance(part, Whole):
                yield from part.shapes
            else:
                yield self._polygon(part, scale, height)

    def _flat(self, points: Floats, scale: float, height: int) -> Floats:
        """Places in the picture, pixels."""
        flat = (points @ self._axes[:2].T - self._low) * scale + _MARGIN * self._width
        flat[:, 1] = height - flat[:, 1]
        return flat

    def _ball(self, drawn: _Drawn, scale: float, height: int) -> Iterator[str]:
        x, y = self._flat(drawn.points, scale, height).mean(axis=0).tolist()
        radius = drawn.size * scale
        # Three discs take much less than all its triangles.
        for dx, size, light in ((0.0, 1.0, 0.72), (0.16, 0.78, 0.9), (0.34, 0.36, 1.15)):
            yield (
                f'<circle cx="{x - dx * radius:.1f}" cy="{y - dx * radius:.1f}"'
                f' r="{size * radius:.1f}" fill="{_shade(drawn.color, light)}"/>'
            )

    def _seen(self, drawn: _Drawn) -> list[Face]:
        """The faces of a solid towards the eye, from far to near."""
        faces, points = _polygons(drawn.solid), drawn.points
        a, b, c = points[[face[:3] for face in faces]].swapaxes(0, 1)
        normals = np.cross(b - a, c - b)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        nearness = points @ self._axes[2]
        lights = 0.62 + 0.42 * np.maximum(0.0, normals @ _LIGHT)
        seen = np.flatnonzero(normals @ self._axes[2] > 0).tolist()
        # A surface that is not convex hides parts of itself.
        seen.sort(key=lambda row: float(nearness[[*faces[row]]].mean()))
        return [
            face_of(points[[*faces[row]]], normals[row], _shade(drawn.color, lights[row]))
            for row in seen
        ]

    def _polygon(self, face: Face, scale: float, height: int) -> str:
        places = self._flat(face.corners, scale, height).tolist()
        corners = " ".join([f"{x:.1f},{y:.1f}" for x, y in places])
        return (
            f'<polygon points="{corners}" fill="{face.fill}" stroke="{face.fill}"'
            ' stroke-width="0.6"/>'
        )

    def _foot(self, entries: Legend, frame: int, height: int) -> Iterator[str]:
        style = 'font-family="DejaVu Sans, Verdana, sans-serif" font-size="16" fill="#3b3a36"'
        first, line = _MARGIN * self._width, height + 16
        yield (
            f'<text x="{first:.0f}" y="{line}" {style}><tspan font-weight="bold">'
            f"{html.escape(self._world)}</tspan>  frame {frame}</text>"
        )
        for left, row, entry in self._placed(entries):
            base = line + 32 + row * _ROW
            yield f'<circle cx="{left + 7:.0f}" cy="{base - 5}" r="7" fill="{entry.colors[0]}"/>'
            text = html.escape(entry.text)
            yield f'<text x="{left + 20:.0f}" y="{base}" {style}>{text}</text>'

    def _placed(self, entries: Legend) -> Iterator[tuple[float, int, LegendEntry]]:
        """The left ends and rows of what is drawn: lines, labels and flat maps are not."""
        first = left = _MARGIN * self._width
        row = 0
        for entry in entries:
            if entry.shape is Disc or entry.colors[0] in self._upright:
                wide = 44 + 9 * len(entry.text)
                if left > first and left + wide > self._width:
                    left, row = first, row + 1
                yield left, row, entry
                left += wide


class Solids(Svg, draws=("ePicture",)):
    """Draws worlds with solids in space as SVG and PNG, with the options of `svg`."""

    def joined(self, world: WorldInfo) -> None:
        connect(world)
        super().joined(world)

    @staticmethod
    def pictures(world: str, vocabulary: Vocabulary, width: int) -> Any:
        return SolidPictures(world, vocabulary, width)


def _upright(discs: Discs) -> Iterator[_Drawn]:
    """Discs of the plane as cylinders of their height."""
    solid = cylinder(20)
    sizes = np.column_stack((discs.radius, discs.radius, discs.height))
    places = np.column_stack((discs.x, discs.y, np.zeros(len(discs))))
    for size, place, color in zip(sizes, places, discs.color, strict=True):
        yield _Drawn(solid, solid.vertices * size + place, color, float(size[0]))


def _walls(tiles: Tiles) -> Iterator[_Drawn]:
    """A map whose form has a height as a floor with walls."""
    cos, sin = math.cos(math.radians(tiles.pose.angle)), math.sin(math.radians(tiles.pose.angle))
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    for mesh in floor_meshes(tiles):
        points = mesh.solid.vertices.astype(np.float64) @ turn
        points[:, :2] += tiles.pose.x, tiles.pose.y
        yield _Drawn(mesh.solid, points, np.array(mesh.color), 1.0)


def _shade(color: NDArray[Any], light: float) -> str:
    red, green, blue = np.clip(color * light, 0, 255).astype(int).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"


@lru_cache(maxsize=256)
def _polygons(solid: Solid) -> Polygons:
    """The faces of a solid, where neighbouring triangles of one plane are a polygon."""
    inverse = np.unique(solid.vertices.round(6), axis=0, return_inverse=True)[1]
    same = inverse.ravel().tolist()
    polygons, before, plane = list[tuple[int, ...]](), list[tuple[int, int, int]](), [0.0] * 4
    a, b, c = solid.vertices.astype(np.float64)[solid.faces].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    # Some have no area, such as two points of a ring at a pole.
    rows = np.flatnonzero(lengths >= 1e-9)
    normals = normals[rows] / lengths[rows, None]
    planes = np.column_stack((normals, (normals * a[rows]).sum(axis=1))).tolist()

    def close() -> None:
        polygons.extend(_outline(before, same))
        before.clear()

    for face, here in zip(solid.faces[rows].tolist(), planes, strict=True):
        if any(abs(p - q) > 1e-4 + 1e-5 * abs(q) for p, q in zip(here, plane, strict=True)):
            close()
            plane = here
        before.append((face[0], face[1], face[2]))
    close()
    return polygons


def _outline(triangles: list[tuple[int, int, int]], same: list[int]) -> Polygons:
    """The outline of neighbouring triangles, or they themselves if it is not a single one."""
    if len(triangles) < 2:
        return list(triangles)
    edges = {same[a]: (same[b], a) for a, b in _free_edges(triangles, same)}
    first = place = next(iter(edges), -1)
    outline = list[int]()
    while place in edges:
        place, vertex = edges.pop(place)
        outline.append(vertex)
    whole = place == first and not edges and len(outline) == len(triangles) + 2
    return [tuple(outline)] if whole else list(triangles)


def _free_edges(
    triangles: list[tuple[int, int, int]], same: list[int]
) -> Iterator[tuple[int, int]]:
    """Edges of triangles that no other one has in the opposite direction."""
    edges = [pair for a, b, c in triangles for pair in ((a, b), (b, c), (c, a))]
    known = {(same[a], same[b]) for a, b in edges}
    return (pair for pair in edges if (same[pair[1]], same[pair[0]]) not in known)
