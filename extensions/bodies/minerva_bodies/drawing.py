"""The view `solids`: pictures of solids in space, in SVG and PNG, seen obliquely from above.

Bodies are drawn from far to near, each face in the shade of its direction; scenery below the ground
comes first. It has the options of the view `svg`.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.forms import FIXED, MATERIAL
from minerva_bodies.geometry import SpaceGeometry
from minerva_bodies.rigid import Rigid
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_services.geometry.colors import legend, rgb
from minerva_services.views.svg import Svg

Floats = NDArray[np.float64]
Faces = tuple[tuple[int, ...], ...]

_AZIMUTH, _ELEVATION = math.radians(-60.0), math.radians(38.0)
_SIDES = 14
"""Sides of the prisms as which round forms are drawn."""
_MARGIN, _FOOT = 0.04, 64
_LIGHT = np.array([0.35, -0.55, 0.76])


def _axes() -> Floats:
    """Rows: right, up and towards the eye, in the axes of the world."""
    sin, cos = math.sin(_AZIMUTH), math.cos(_AZIMUTH)
    high, flat = math.sin(_ELEVATION), math.cos(_ELEVATION)
    return np.array(
        [[-sin, cos, 0.0], [-cos * high, -sin * high, flat], [cos * flat, sin * flat, high]]
    )


@dataclass(frozen=True, slots=True)
class _Thing:
    """A solid of a view."""

    symbol: str
    form: str
    sizes: tuple[Any, ...]
    fixed: bool
    pose: Rigid


class _Things(SpaceGeometry):
    """All solids of a string, in its order."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.things: list[_Thing] = []

    def solid(self, form: str, owner: str, figure: FigureNode, values: list[Any]) -> None:
        sizes, fixed = tuple(values[MATERIAL:]), not owner or values[3] == FIXED
        self.things.append(_Thing(figure.symbol, form, sizes, fixed, self.pose))


class SolidPictures:
    """A series of pictures of one world, which show the same part of it, or more.

    Args:
        world: its name.
        vocabulary: with the forms of its primitives.
        width: in pixels.

    """

    def __init__(self, world: str, vocabulary: Vocabulary, width: int) -> None:
        self._world, self._vocabulary, self._width = world, vocabulary, width
        self._axes = _axes()
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)
        self._drawn: set[str] = set()

    def draw(self, scene: Scene, frame: int) -> str:
        """The SVG document of a view, a string of L(E), in a frame."""
        seen = _Things(self._vocabulary)
        interpret(scene, seen)
        solids = [(thing, *_placed(thing)) for thing in seen.things]
        self._drawn |= {thing.symbol for thing in seen.things}
        flat = [points @ self._axes[:2].T for _, points, _ in solids] or [np.zeros((1, 2))]
        together = np.concatenate(flat)
        self._low = np.minimum(self._low, together.min(axis=0))
        self._high = np.maximum(self._high, together.max(axis=0))
        size = np.maximum(self._high - self._low, 1e-3)
        scale = self._width * (1 - 2 * _MARGIN) / size[0]
        height = round(size[1] * scale + 2 * _MARGIN * self._width)
        # Straight above the ground, far things first.
        ordered = sorted(solids, key=lambda each: (not _below(each[1]), self._nearness(each[1])))
        shapes = [text for each in ordered for text in self._shape(*each, scale, height)]
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" width="{self._width}"'
                f' height="{height + _FOOT}" viewBox="0 0 {self._width} {height + _FOOT}">',
                '<rect width="100%" height="100%" fill="#f5f0e6"/>',
                *shapes,
                *self._foot(frame, height),
                "</svg>",
            ]
        )

    def _nearness(self, points: Floats) -> float:
        return float((points @ self._axes[2]).mean())

    def _shape(
        self, thing: _Thing, points: Floats, faces: Faces, scale: float, height: int
    ) -> Iterator[str]:
        primitive = self._vocabulary.primitives[thing.symbol]
        color = np.array(rgb(getattr(primitive.shape, "color", "#b5a98c")))
        flat = (points @ self._axes[:2].T - self._low) * scale + _MARGIN * self._width
        flat[:, 1] = height - flat[:, 1]
        if thing.form == "ball":
            (x, y), radius = flat[0], thing.sizes[0] * scale
            for dx, size, light in ((0.0, 1.0, 0.72), (0.16, 0.78, 0.9), (0.34, 0.36, 1.15)):
                yield (
                    f'<circle cx="{x - dx * radius:.1f}" cy="{y - dx * radius:.1f}"'
                    f' r="{size * radius:.1f}" fill="{_shade(color, light)}"/>'
                )
            return
        for face in faces:
            a, b, c = points[face[0]], points[face[1]], points[face[2]]
            normal = np.cross(b - a, c - b)
            normal = normal / max(float(np.linalg.norm(normal)), 1e-12)
            if normal @ self._axes[2] <= 0:
                continue
            corners = " ".join([f"{x:.1f},{y:.1f}" for x, y in flat[list(face)]])
            fill = _shade(color, 0.62 + 0.42 * max(0.0, float(normal @ _LIGHT)))
            yield f'<polygon points="{corners}" fill="{fill}" stroke="{fill}" stroke-width="0.6"/>'

    def _foot(self, frame: int, height: int) -> Iterator[str]:
        style = 'font-family="DejaVu Sans, Verdana, sans-serif" font-size="16" fill="#3b3a36"'
        left, line = _MARGIN * self._width, height + 16
        yield (
            f'<text x="{left:.0f}" y="{line}" {style}><tspan font-weight="bold">'
            f"{html.escape(self._world)}</tspan>  frame {frame}</text>"
        )
        for entry in legend(self._vocabulary, self._drawn):
            yield f'<circle cx="{left + 7:.0f}" cy="{line + 27}" r="7" fill="{entry.colors[0]}"/>'
            text = html.escape(entry.text)
            yield f'<text x="{left + 20:.0f}" y="{line + 32}" {style}>{text}</text>'
            left += 44 + 9 * len(entry.text)


class Solids(Svg, draws=("ePicture",)):
    """Draws worlds with solids in space as SVG and PNG, with the options of `svg`."""

    @staticmethod
    def pictures(world: str, vocabulary: Vocabulary, width: int) -> Any:
        return SolidPictures(world, vocabulary, width)


def _below(points: Floats) -> bool:
    """Whether a solid lies below the ground, and under everything that stands on it."""
    return bool(points[:, 2].max() <= 1e-6)


def _shade(color: NDArray[Any], light: float) -> str:
    red, green, blue = np.clip(color * light, 0, 255).astype(int).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"


def _placed(thing: _Thing) -> tuple[Floats, Faces]:
    """The points of a solid in the world, and its faces, counter-clockwise from outside."""
    points, faces = _polyhedron(thing.form, thing.sizes)
    turned = np.array([thing.pose.turned(*axis) for axis in np.eye(3).tolist()])
    x, y, z, *_ = thing.pose.numbers
    return points @ turned + (x, y, z), faces


@cache
def _polyhedron(form: str, sizes: Sequence[Any]) -> tuple[Floats, Faces]:
    if form == "box":
        x, y, z = sizes
        return _prism([(-x, -y), (x, -y), (x, y), (-x, y)], ((-z, 1.0), (z, 1.0)))
    if form == "ball":
        return np.zeros((1, 3)), ()
    if form == "terrain":
        return np.zeros((1, 3)), ()
    half, radius = (sizes[1], sizes[1]) if form == "mesh" else sizes
    rings: tuple[tuple[float, float], ...] = ((-half, 1.0), (half, 1.0))
    if form == "cone":
        rings = ((-half, 1.0), (half, 1e-3))
    elif form == "capsule":
        bend = [(math.sin(t) * radius, math.cos(t)) for t in (0.0, 0.5, 1.0, 1.5)]
        rings = (
            *[(-half - z, wide) for z, wide in reversed(bend)],
            *[(half + z, wide) for z, wide in bend],
        )
    angles = [2 * math.pi * side / _SIDES for side in range(_SIDES)]
    return _prism([(radius * math.cos(a), radius * math.sin(a)) for a in angles], rings)


def _prism(
    base: Sequence[tuple[float, float]], rings: Iterable[tuple[float, float]]
) -> tuple[Floats, Faces]:
    """The same outline at several heights, wider or narrower."""
    stacked = [(wide * x, wide * y, z) for z, wide in rings for x, y in base]
    n, levels = len(base), len(stacked) // len(base)
    sides = [
        (k * n + i, k * n + (i + 1) % n, (k + 1) * n + (i + 1) % n, (k + 1) * n + i)
        for k in range(levels - 1)
        for i in range(n)
    ]
    bottom, top = tuple(reversed(range(n))), tuple(range((levels - 1) * n, levels * n))
    return np.array(stacked), (bottom, *sides, top)
