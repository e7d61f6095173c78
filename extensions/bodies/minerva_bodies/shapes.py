"""Solids of forms in space, of size 1, as meshes for views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.meshes import load_mesh
from minerva_services.geometry.picture import Floats, Solid
from minerva_services.views.solids import around

_SIDES, _FEW_SIDES = 20, 8
"""Sides of round solids, and of those of which there are thousands."""


@lru_cache(maxsize=256)
def unit_solid(form: str, detail: float | str, fine: bool) -> Solid:
    """The solid of a form whose sizes are 1.

    Args:
        form: its name.
        detail: of a capsule, its half length in radii; of a mesh, its file.
        fine: whether round solids have many sides.

    """
    sides = _SIDES if fine else _FEW_SIDES
    if form == "mesh":
        return solid_of(*load_mesh(str(detail)))
    if form == "box":
        return _box()
    if form == "cylinder":
        return around(((0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)), sides)
    if form == "cone":
        return around(((0.0, -1.0), (1.0, -1.0), (0.0, 1.0)), sides)
    tilts = np.linspace(-math.pi / 2, math.pi / 2, sides // 2 | 1)
    half = float(detail) if form == "capsule" else 0.0
    rings = [(math.cos(t), math.sin(t) - half) for t in tilts if t < 1e-9]
    rings += [(math.cos(t), math.sin(t) + half) for t in tilts if t > (-1e-9 if half else 1e-9)]
    return _smooth(rings, sides)


def solid_of(points: Floats, triangles: NDArray[np.uint32]) -> Solid:
    """A surface with edges between all of its triangles."""
    corners = np.asarray(points, np.float32)[triangles].reshape(-1, 3)
    return Solid(corners, np.arange(len(corners), dtype=np.uint32).reshape(-1, 3))


def _box() -> Solid:
    corners, faces = list[list[float]](), list[tuple[int, int, int]]()
    for axis in range(3):
        for sign in (-1.0, 1.0):
            first = len(corners)
            for a, b in ((-sign, -1.0), (sign, -1.0), (sign, 1.0), (-sign, 1.0)):
                corner = [0.0, 0.0, 0.0]
                corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3] = sign, a, b
                corners.append(corner)
            faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return Solid(np.array(corners, np.float32), np.array(faces, np.uint32))


def _smooth(rings: Sequence[tuple[float, float]], sides: int) -> Solid:
    """Rings of (radius, height) from bottom to top around the z axis, as one smooth surface."""
    angles = np.arange(sides) * (2 * math.pi / sides)
    vertices = [(r * math.cos(a), r * math.sin(a), z) for r, z in rings for a in angles]
    faces = list[tuple[int, int, int]]()
    for ring in range(len(rings) - 1):
        for side in range(sides):
            here, there = ring * sides + side, ring * sides + (side + 1) % sides
            faces += [(here, there, there + sides), (here, there + sides, here + sides)]
    return Solid(np.array(vertices, np.float32), np.array(faces, np.uint32))
