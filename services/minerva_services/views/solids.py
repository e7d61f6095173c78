"""Solids of 3D views: vertices and triangles in metres, z up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minerva_bus.semantics.volumes import mask_rectangles
from minerva_services.views.blocks import sides

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Vertices (n, 3) and triangles (m, 3) of indices, counter-clockwise from outside."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


@cache
def cylinder(sides: int) -> Solid:
    """A cylinder of radius and height 1 on the ground, without a bottom."""
    return _around(((1.0, 0.0), (1.0, 1.0), (0.0, 1.0)), sides)


@cache
def pin(sides: int = 20) -> Solid:
    """A pin of height 1 with its tip at the origin and a round head."""
    head = [
        (0.16 * math.sin(turn), 0.84 - 0.16 * math.cos(turn))
        for turn in np.linspace(0.5, math.pi, 9)
    ]
    return _around(((0.0, 0.0), *head), sides)


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


def upright(angles: ArrayLike) -> NDArray[np.float64]:
    """Quaternions (w, x, y, z) of shape (..., 4) for angles in degrees of shape (...)."""
    half = np.radians(np.asarray(angles, np.float64)) / 2
    nothing = np.zeros_like(half)
    return np.stack([np.cos(half), nothing, nothing, np.sin(half)], axis=-1)


def _around(profile: tuple[tuple[float, float], ...], sides: int) -> Solid:
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
