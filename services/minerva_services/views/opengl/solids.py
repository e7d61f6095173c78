"""Meshes of solids as plain arrays: walls, slabs, drums and pins."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.poses import Pose
from minerva_services.geometry.volumes import mask_rectangles
from minerva_services.views.solids import Cells, sides

Single = NDArray[np.float32]
Indices = NDArray[np.int32]

_FACING = np.array([(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)])
_QUAD = np.array([0, 1, 2, 0, 2, 3])


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Vertices (n, k) and triangles (m, 3) of vertex indices."""

    vertices: Single
    triangles: Indices


def tops(mask: Cells, cell: float, pose: Pose, height: float) -> Mesh:
    """Top faces of blocks on cells; a vertex is a position x, y, z and a normal x, y, z."""
    row, column, rows, columns = mask_rectangles(mask).T
    x = np.stack([row, row + rows, row + rows, row], axis=1) * cell
    y = np.stack([column, column, column + columns, column + columns], axis=1) * cell
    level, upright = np.full(x.shape, height), np.zeros(x.shape)
    x, y = placed(x, y, pose)
    return _quads(np.stack([x, y, level, upright, upright, upright + 1.0], axis=2))


def upright(mask: Cells, cell: float, pose: Pose, low: float, high: float) -> Mesh:
    """Sides of blocks on cells between two heights; vertices as in `tops`."""
    row, column, end_row, end_column, way = sides(mask).T
    x = np.stack([row, end_row, end_row, row], axis=1) * cell
    y = np.stack([column, end_column, end_column, column], axis=1) * cell
    x, y = placed(x, y, pose)
    z = np.broadcast_to([low, low, high, high], x.shape)
    facing = _FACING[way]
    u, v = placed(facing[:, 0], facing[:, 1], Pose(angle=pose.angle))
    normal = [np.broadcast_to(part[:, None], x.shape) for part in (u, v, np.zeros(len(u)))]
    return _quads(np.stack([x, y, z, *normal], axis=2))


def placed(
    x: NDArray[np.float64], y: NDArray[np.float64], pose: Pose
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points in a pose's own axes, transformed to the world."""
    turn = np.radians(pose.angle)
    cos, sin = np.cos(turn), np.sin(turn)
    return pose.x + x * cos - y * sin, pose.y + x * sin + y * cos


def _quads(corners: NDArray[np.float64]) -> Mesh:
    count = len(corners)
    triangles = (np.arange(count)[:, None] * 4 + _QUAD).reshape(-1, 3)
    return Mesh(
        corners.reshape(count * 4, corners.shape[2]).astype(np.float32), triangles.astype(np.int32)
    )


@lru_cache(maxsize=8)
def drum(segments: int, rounded: bool) -> Mesh:
    """A drum of radius and height 1 without a bottom.

    A vertex has the direction from the axis (2), offsets inwards and downwards from the edge, its
    height (0 or 1), and its normal outwards and upwards; the shader scales the edge.
    """
    turn = np.arange(segments) * (2 * np.pi / segments)
    out = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    foot, wall = (0.0, 0.0, 0.0, 1.0, 0.0), (0.0, 1.0, 1.0, 1.0, 0.0)
    lid = (1.0, 0.0, 1.0, 0.0, 1.0) if rounded else (0.0, 0.0, 1.0, 0.0, 1.0)
    # Only a rounded drum has a bevel between wall and lid; the others save its triangles.
    profile = [foot, wall, lid] if rounded else [foot, (0.0, 0.0, 1.0, 1.0, 0.0), lid]
    rings = [np.hstack([out, np.tile(ring, (segments, 1))]) for ring in profile]
    here, there = np.arange(segments), (np.arange(segments) + 1) % segments
    bands = [0, 1] if rounded else [0]
    triangles = [_band(here + ring * segments, there + ring * segments) for ring in bands]
    top, rest = 2 * segments, np.arange(1, segments - 1)
    triangles.append(np.stack([np.full(len(rest), top), rest + top, rest + top + 1], axis=1))
    return Mesh(np.vstack(rings).astype(np.float32), np.vstack(triangles).astype(np.int32))


def _band(here: NDArray[np.int64], there: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles between a ring and the next one."""
    above = len(here)
    lower = np.stack([here, there, there + above], axis=1)
    return np.vstack([lower, np.stack([here, there + above, here + above], axis=1)])


@lru_cache(maxsize=1)
def pin() -> Mesh:
    """A pin of height 1 with a ball of radius 1: x, y in radii, height, offset, normal."""
    around, along = 16, 9
    # The ball: rings of points from its lowest to its highest.
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    tilt = np.linspace(-np.pi / 2, np.pi / 2, along)
    flat, up = np.cos(tilt)[:, None], np.sin(tilt)[:, None]
    x, y = flat * np.cos(turn), flat * np.sin(turn)
    z = np.broadcast_to(up, x.shape)
    ones = np.ones(x.shape)
    ball = np.stack([x, y, ones, z, x, y, z], axis=2).reshape(-1, 7)
    # The stick: a ring at its foot and one in the ball.
    u, v = 0.16 * np.cos(turn), 0.16 * np.sin(turn)
    stick = np.concatenate(
        [
            np.stack([u, v, np.full(around, h), 0 * u, np.cos(turn), np.sin(turn), 0 * u], axis=1)
            for h in (0.0, 1.0)
        ]
    )
    here, there = np.arange(around), (np.arange(around) + 1) % around
    first = len(ball)
    triangles = [_band(here + k * around, there + k * around) for k in range(along - 1)]
    triangles.append(_band(here + first, there + first))
    return Mesh(np.vstack([ball, stick]).astype(np.float32), np.vstack(triangles).astype(np.int32))
