"""Narrow phase: contact, depth and normal of pairs of convex volumes, vectorised.

A volume is the set of points within a radius of its core: a point, a segment or a convex polygon.
Two volumes touch if their cores are no farther apart than the sum of the radii. Overlapping cores
are detected by the separating axis theorem, which also gives the shortest way out; all other pairs
by their nearest corners and edges, at least one of which is a corner.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.volumes import Volumes

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

TOLERANCE: Final = 1e-9
"""Gap in metres that still counts as touching: far above rounding, far below anything visible."""


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """n pairs of touching volumes.

    Attributes:
        first, second: (n,) rows of the volumes.
        point: (n, 2) metres, the middle of the overlap.
        normal: (n, 2), unit vectors: the shortest way for `first` out of `second`.
        depth: (n,) metres of that way; 0 where they just touch.

    """

    first: Rows
    second: Rows
    point: Floats
    normal: Floats
    depth: Floats

    def take(self, rows: Rows) -> Touches:
        """The pairs of these rows."""
        return Touches(
            self.first[rows],
            self.second[rows],
            self.point[rows],
            self.normal[rows],
            self.depth[rows],
        )

    def turned(self, where: NDArray[np.bool_]) -> Touches:
        """The pairs with both sides swapped where the mask is set."""
        first = np.where(where, self.second, self.first)
        second = np.where(where, self.first, self.second)
        # 0.0 - x instead of -x avoids negative zeros.
        normal = np.where(where[:, None], 0.0 - self.normal, self.normal)
        return Touches(first, second, self.point, normal, self.depth)


def touches(volumes: Volumes, first: Rows, second: Rows) -> Touches:
    """Those pairs of volumes that touch, in order."""
    point, normal = np.zeros((len(first), 2)), np.zeros((len(first), 2))
    depth = np.full(len(first), -1.0)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow: too far apart to touch
        for rows in _alike(volumes.sizes[first], volumes.sizes[second]):
            left, right = first[rows], second[rows]
            contact = _touch(
                volumes.cores(left),
                volumes.cores(right),
                volumes.radius[left],
                volumes.radius[right],
            )
            point[rows], normal[rows], depth[rows] = contact
    kept = np.flatnonzero(depth >= -TOLERANCE)
    # Adding 0.0 turns -0.0 into 0.0, so that both print the same.
    deep = np.maximum(depth[kept], 0.0) + 0.0
    return Touches(first[kept], second[kept], point[kept] + 0.0, normal[kept] + 0.0, deep)


def _alike(sizes: Rows, others: Rows) -> Iterator[Rows]:
    """The rows of each combination of sizes."""
    # Volumes with equal numbers of corners form rectangular arrays, which one vectorised call
    # takes.
    both = np.stack((sizes, others), axis=1)
    for size in np.unique(both, axis=0):
        yield np.flatnonzero((both == size).all(axis=1))


def _touch(
    ours: Floats, theirs: Floats, my_radius: Floats, their_radius: Floats
) -> tuple[Floats, Floats, Floats]:
    """Contact points, normals and depths of pairs of cores of shape (n, k, 2)."""
    apart, near, far = _nearest(ours, theirs)
    inside, way, deep = _overlap(ours, theirs)
    # Cores that overlap: their nearest corners and edges say nothing about the shortest way out.
    within = (inside > -np.inf) & (inside < 0)
    distance = np.where(within, inside, apart)
    # Where the outlines cross, the direction of the gap is undefined; the axis replaces it.
    safe = np.where(apart > 0, apart, 1.0)[:, None]
    straight = np.where((apart > 0)[:, None], (near - far) / safe, way)
    normal = np.where(within[:, None], way, straight)
    near = np.where(within[:, None], deep, near)
    far = np.where(within[:, None], deep - way * inside[:, None], far)
    surface = near - normal * my_radius[:, None]
    opposite = far + normal * their_radius[:, None]
    return (surface + opposite) / 2, normal, my_radius + their_radius - distance


def _nearest(ours: Floats, theirs: Floats) -> tuple[Floats, Floats, Floats]:
    """Distances between the outlines of cores, and the nearest points on both."""
    forth, corner, foot = _corner_to_edge(ours, theirs)
    back, far_corner, near_foot = _corner_to_edge(theirs, ours)
    mine_first = forth <= back
    chosen = mine_first[:, None]
    near, far = np.where(chosen, corner, near_foot), np.where(chosen, foot, far_corner)
    return np.sqrt(np.where(mine_first, forth, back)), near, far


def _corner_to_edge(corners: Floats, core: Floats) -> tuple[Floats, Floats, Floats]:
    """Squared distance from a core's edges to the nearest of the corners.

    That corner and its foot.
    """
    edge = (np.roll(core, -1, axis=1) - core)[:, None]
    way = corners[:, :, None] - core[:, None]
    # The only edge of a point has length 0. Dividing by 1 instead makes the point its own foot.
    square = _dot(edge, edge)
    part = np.clip(_dot(way, edge) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    away = way - part[..., None] * edge
    squared = _dot(away, away).reshape(len(core), -1)
    best = squared.argmin(axis=1)
    rows = np.arange(len(core))
    corner = corners[rows, best // core.shape[1]]
    return squared[rows, best], corner, corner - away.reshape(len(core), -1, 2)[rows, best]


def _overlap(ours: Floats, theirs: Floats) -> tuple[Floats, Floats, Floats]:
    """Signed distance of cores along the best separating axis; negative where they overlap.

    Also the direction out of the other core along that axis, and the deepest point of this core.
    Minus infinity and an arbitrary direction where no core has an edge.
    """
    by_mine, out_of_mine, their_corner = _separation(ours, theirs)
    by_theirs, out_of_theirs, my_corner = _separation(theirs, ours)
    # Of all axes the one with the largest signed distance counts: it separates the cores, or, where
    # they overlap, is the shortest way out.
    chosen = by_theirs >= by_mine
    inside = np.where(chosen, by_theirs, by_mine)
    way = np.where(chosen[:, None], out_of_theirs, 0.0 - out_of_mine)
    finite = np.where(inside > -np.inf, inside, 0.0)[:, None]
    deep = np.where(chosen[:, None], my_corner, their_corner + way * finite)
    return inside, way, deep


def _separation(core: Floats, other: Floats) -> tuple[Floats, Floats, Floats]:
    """The best axis of a core.

    Distance of the other core beyond it, the axis, the nearest corner.
    """
    edge = np.roll(core, -1, axis=1) - core
    length = np.sqrt(_dot(edge, edge))
    # Corners are counter-clockwise, so the outside lies to the right of an edge.
    outward = np.stack((edge[..., 1], 0.0 - edge[..., 0]), axis=-1)
    outward = outward / np.where(length > 0, length, 1.0)[..., None]
    outward = np.where((length > 0)[..., None], outward, np.array([1.0, 0.0]))
    beyond = _dot(outward[:, :, None], other[:, None] - core[:, :, None])
    corner = beyond.argmin(axis=2)
    rows = np.arange(len(core))
    least = beyond[rows[:, None], np.arange(core.shape[1]), corner]
    # A single point has an edge of length 0, which defines no axis.
    least = np.where(length > 0, least, -np.inf)
    axis = least.argmax(axis=1)
    away, way, first = least[rows, axis], outward[rows, axis], other[rows, corner[rows, axis]]
    face = np.stack((core[rows, axis], np.roll(core, -1, axis=1)[rows, axis]), axis=1)
    level = beyond[rows, axis] <= (away + TOLERANCE)[:, None]
    return away, way, first + _to_middle(first, way, face, other, level)


def _to_middle(
    first: Floats, way: Floats, face: Floats, other: Floats, level: NDArray[np.bool_]
) -> Floats:
    """Offset from the first of the corners that are `level` along a direction to their middle.

    Zero for a single corner. Two are level where an edge lies along the face; the first may then
    lie beyond the end of the face.
    """
    along = np.stack((0.0 - way[:, 1], way[:, 0]), axis=-1)[:, None]
    places = _dot(along, other - first[:, None])
    ends = _dot(along, face - first[:, None])
    low = np.maximum(np.where(level, places, np.inf).min(axis=1), ends.min(axis=1))
    high = np.minimum(np.where(level, places, -np.inf).max(axis=1), ends.max(axis=1))
    several = (level.sum(axis=1) > 1) & (low <= high)
    return np.where(several, (low + high) / 2, 0.0)[:, None] * along[:, 0]


def _dot(first: Floats, second: Floats) -> Floats:
    """Dot products along the last axis, summed in the same order on every machine."""
    return first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]
