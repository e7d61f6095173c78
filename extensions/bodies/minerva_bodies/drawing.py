"""The view `solids`: pictures of solids in space, in SVG and PNG, seen obliquely from above.

Bodies are drawn from far to near, each face in the shade of its direction; scenery below the ground
comes first. It has the options of the view `svg`.
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
from minerva_bodies.pictures import SpacePictures
from minerva_bodies.shapes import unit_solid
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.services import WorldInfo
from minerva_services.geometry.colors import Legend
from minerva_services.geometry.picture import Copies, Floats, Lists, Solid
from minerva_services.views.svg import Svg

Polygons: TypeAlias = list[tuple[int, ...]]

_AZIMUTH, _ELEVATION = math.radians(-60.0), math.radians(38.0)
_MARGIN, _FOOT = 0.04, 64
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
    color: NDArray[np.uint8]
    size: float


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
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    def draw(self, scene: Scene, frame: int) -> str:
        """The SVG document of a view, a string of L(E), in a frame."""
        picture = self._lists.picture(scene, {})
        solids = [
            _Drawn(copies.solid, points, copies.color[row], float(copies.sizes[row, 0]))
            for copies in picture.of(Copies)
            for row, points in enumerate(copies.points())
        ]
        flat = [solid.points @ self._axes[:2].T for solid in solids] or [np.zeros((1, 2))]
        together = np.concatenate(flat)
        self._low = np.minimum(self._low, together.min(axis=0))
        self._high = np.maximum(self._high, together.max(axis=0))
        size = np.maximum(self._high - self._low, 1e-3)
        scale = self._width * (1 - 2 * _MARGIN) / size[0]
        height = round(size[1] * scale + 2 * _MARGIN * self._width)
        # Straight above the ground, far things first.
        ordered = sorted(
            solids, key=lambda each: (not _below(each.points), self._nearness(each.points))
        )
        shapes = [text for each in ordered for text in self._shape(each, scale, height)]
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" width="{self._width}"'
                f' height="{height + _FOOT}" viewBox="0 0 {self._width} {height + _FOOT}">',
                '<rect width="100%" height="100%" fill="#f5f0e6"/>',
                *shapes,
                *self._foot(picture.legend, frame, height),
                "</svg>",
            ]
        )

    def _nearness(self, points: Floats) -> float:
        return float((points @ self._axes[2]).mean())

    def _shape(self, drawn: _Drawn, scale: float, height: int) -> Iterator[str]:
        points, color = drawn.points, drawn.color
        flat = (points @ self._axes[:2].T - self._low) * scale + _MARGIN * self._width
        flat[:, 1] = height - flat[:, 1]
        if drawn.solid in _BALLS:
            # Three discs take much less than all its triangles.
            (x, y), radius = flat.mean(axis=0), drawn.size * scale
            for dx, size, light in ((0.0, 1.0, 0.72), (0.16, 0.78, 0.9), (0.34, 0.36, 1.15)):
                yield (
                    f'<circle cx="{x - dx * radius:.1f}" cy="{y - dx * radius:.1f}"'
                    f' r="{size * radius:.1f}" fill="{_shade(color, light)}"/>'
                )
            return
        faces = _polygons(drawn.solid)
        a, b, c = points[[face[:3] for face in faces]].swapaxes(0, 1)
        normals = np.cross(b - a, c - b)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        nearness = points @ self._axes[2]
        lights = 0.62 + 0.42 * np.maximum(0.0, normals @ _LIGHT)
        seen = np.flatnonzero(normals @ self._axes[2] > 0).tolist()
        # A surface that is not convex hides parts of itself.
        for row in sorted(seen, key=lambda row: float(nearness[list(faces[row])].mean())):
            corners = " ".join([f"{x:.1f},{y:.1f}" for x, y in flat[list(faces[row])].tolist()])
            fill = _shade(color, lights[row])
            yield f'<polygon points="{corners}" fill="{fill}" stroke="{fill}" stroke-width="0.6"/>'

    def _foot(self, entries: Legend, frame: int, height: int) -> Iterator[str]:
        style = 'font-family="DejaVu Sans, Verdana, sans-serif" font-size="16" fill="#3b3a36"'
        left, line = _MARGIN * self._width, height + 16
        yield (
            f'<text x="{left:.0f}" y="{line}" {style}><tspan font-weight="bold">'
            f"{html.escape(self._world)}</tspan>  frame {frame}</text>"
        )
        for entry in entries:
            yield f'<circle cx="{left + 7:.0f}" cy="{line + 27}" r="7" fill="{entry.colors[0]}"/>'
            text = html.escape(entry.text)
            yield f'<text x="{left + 20:.0f}" y="{line + 32}" {style}>{text}</text>'
            left += 44 + 9 * len(entry.text)


class Solids(Svg, draws=("ePicture",)):
    """Draws worlds with solids in space as SVG and PNG, with the options of `svg`."""

    def joined(self, world: WorldInfo) -> None:
        connect(world)
        super().joined(world)

    @staticmethod
    def pictures(world: str, vocabulary: Vocabulary, width: int) -> Any:
        return SolidPictures(world, vocabulary, width)


def _below(points: Floats) -> bool:
    """Whether a solid lies below the ground, and under everything that stands on it."""
    return bool(points[:, 2].max() <= 1e-6)


def _shade(color: NDArray[Any], light: float) -> str:
    red, green, blue = np.clip(color * light, 0, 255).astype(int).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"


@lru_cache(maxsize=256)
def _polygons(solid: Solid) -> Polygons:
    """The faces of a solid, where neighbouring triangles of one plane are a polygon."""
    _, same = np.unique(solid.vertices.round(6), axis=0, return_inverse=True)
    polygons, before, plane = list[tuple[int, ...]](), list[tuple[int, int, int]](), np.zeros(4)

    def close() -> None:
        polygons.extend(_outline(before, same.ravel().tolist()))
        before.clear()

    for face in solid.faces.tolist():
        a, b, c = solid.vertices[face].astype(np.float64)
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            continue  # Such as two points of a ring at a pole.
        normal = normal / length
        here = np.array([*normal, normal @ a])
        if not np.allclose(here, plane, atol=1e-4):
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
