"""Do two convex volumes touch, where, and how deep? Many pairs at once.

A volume is all within a radius of its core: a point, a segment or a convex polygon. Two touch where
their cores are no farther apart than both radii. Cores that overlap are told by the separating axis
theorem, which also gives the shortest way apart; all others by the nearest of their corners and
edges, of which one is a corner.
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

SLACK: Final = 1e-9
"""Metres apart that count as touching: far above rounding, far below anything visible."""


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """n pairs of volumes that touch.

    Attributes:
        one, other: (n,) rows of the volumes.
        point: (n, 2) metres, in the middle of where they overlap.
        normal: (n, 2) of length 1: the shortest way for `one` out of `other`.
        depth: (n,) metres of that way; 0 where they just touch.

    """

    one: Rows
    other: Rows
    point: Floats
    normal: Floats
    depth: Floats

    def take(self, rows: Rows) -> Touches:
        """Some of them."""
        return Touches(
            self.one[rows], self.other[rows], self.point[rows], self.normal[rows], self.depth[rows]
        )

    def turned(self, where: NDArray[np.bool_]) -> Touches:
        """The same, seen from the other side where the mask says so."""
        one, other = np.where(where, self.other, self.one), np.where(where, self.one, self.other)
        normal = np.where(where[:, None], 0.0 - self.normal, self.normal)
        return Touches(one, other, self.point, normal, self.depth)


def touches(volumes: Volumes, one: Rows, other: Rows) -> Touches:
    """Those of some pairs of volumes that touch, in their order."""
    point, normal = np.zeros((len(one), 2)), np.zeros((len(one), 2))
    depth = np.full(len(one), -1.0)
    with np.errstate(over="ignore", invalid="ignore"):  # too far apart to be squared: no touch
        for rows in _alike(volumes.sizes[one], volumes.sizes[other]):
            mine, theirs = one[rows], other[rows]
            found = _touch(
                volumes.cores(mine),
                volumes.cores(theirs),
                volumes.radius[mine],
                volumes.radius[theirs],
            )
            point[rows], normal[rows], depth[rows] = found
    kept = np.flatnonzero(depth >= -SLACK)
    # Adding 0 makes one zero of both, so that they print the same.
    deep = np.maximum(depth[kept], 0.0) + 0.0
    return Touches(one[kept], other[kept], point[kept] + 0.0, normal[kept] + 0.0, deep)


def _alike(sizes: Rows, others: Rows) -> Iterator[Rows]:
    """The rows of each combination of sizes."""
    both = np.stack((sizes, others), axis=1)
    for size in np.unique(both, axis=0):
        yield np.flatnonzero((both == size).all(axis=1))


def _touch(
    mine: Floats, theirs: Floats, my_radius: Floats, their_radius: Floats
) -> tuple[Floats, Floats, Floats]:
    """Contact points, normals from them to me and depths of pairs of cores of shape (n, k, 2)."""
    apart, near, far = _nearest(mine, theirs)
    inside, way, deep = _overlap(mine, theirs)
    within = (inside > -np.inf) & (inside < 0)
    distance = np.where(within, inside, apart)
    safe = np.where(apart > 0, apart, 1.0)[:, None]
    straight = np.where((apart > 0)[:, None], (near - far) / safe, way)
    normal = np.where(within[:, None], way, straight)
    near = np.where(within[:, None], deep, near)
    far = np.where(within[:, None], deep - way * inside[:, None], far)
    surface = near - normal * my_radius[:, None]
    opposite = far + normal * their_radius[:, None]
    return (surface + opposite) / 2, normal, my_radius + their_radius - distance


def _nearest(mine: Floats, theirs: Floats) -> tuple[Floats, Floats, Floats]:
    """Distances of the outlines of cores, and the nearest points, mine and theirs."""
    forth, corner, foot = _corner_to_edge(mine, theirs)
    back, far_corner, near_foot = _corner_to_edge(theirs, mine)
    mine_first = forth <= back
    chosen = mine_first[:, None]
    near, far = np.where(chosen, corner, near_foot), np.where(chosen, foot, far_corner)
    return np.sqrt(np.where(mine_first, forth, back)), near, far


def _corner_to_edge(corners: Floats, core: Floats) -> tuple[Floats, Floats, Floats]:
    """The least squared distance of some corners from a core's edges; that corner, its foot."""
    edge = (np.roll(core, -1, axis=1) - core)[:, None]
    way = corners[:, :, None] - core[:, None]
    square = _dot(edge, edge)
    part = np.clip(_dot(way, edge) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    away = way - part[..., None] * edge
    squared = _dot(away, away).reshape(len(core), -1)
    best = squared.argmin(axis=1)
    rows = np.arange(len(core))
    corner = corners[rows, best // core.shape[1]]
    return squared[rows, best], corner, corner - away.reshape(len(core), -1, 2)[rows, best]


def _overlap(mine: Floats, theirs: Floats) -> tuple[Floats, Floats, Floats]:
    """How far cores are apart along the axis that separates them best; below 0 they overlap.

    Also the way of mine out of theirs along it, and the point of mine that is deepest in theirs.
    Minus infinity and any way where no core has an edge.
    """
    by_mine, out_of_mine, their_corner = _separation(mine, theirs)
    by_theirs, out_of_theirs, my_corner = _separation(theirs, mine)
    chosen = by_theirs >= by_mine
    inside = np.where(chosen, by_theirs, by_mine)
    way = np.where(chosen[:, None], out_of_theirs, 0.0 - out_of_mine)
    finite = np.where(inside > -np.inf, inside, 0.0)[:, None]
    deep = np.where(chosen[:, None], my_corner, their_corner + way * finite)
    return inside, way, deep


def _separation(core: Floats, other: Floats) -> tuple[Floats, Floats, Floats]:
    """The best of a core's axes: how far the other one is beyond, that axis, the nearest corner."""
    edge = np.roll(core, -1, axis=1) - core
    length = np.sqrt(_dot(edge, edge))
    outward = np.stack((edge[..., 1], 0.0 - edge[..., 0]), axis=-1)
    outward = outward / np.where(length > 0, length, 1.0)[..., None]
    outward = np.where((length > 0)[..., None], outward, np.array([1.0, 0.0]))
    beyond = _dot(outward[:, :, None], other[:, None] - core[:, :, None])
    corner = beyond.argmin(axis=2)
    rows = np.arange(len(core))
    least = beyond[rows[:, None], np.arange(core.shape[1]), corner]
    least = np.where(length > 0, least, -np.inf)
    axis = least.argmax(axis=1)
    away, way, first = least[rows, axis], outward[rows, axis], other[rows, corner[rows, axis]]
    face = np.stack((core[rows, axis], np.roll(core, -1, axis=1)[rows, axis]), axis=1)
    level = beyond[rows, axis] <= (away + SLACK)[:, None]
    return away, way, first + _to_middle(first, way, face, other, level)


def _to_middle(
    first: Floats, way: Floats, face: Floats, other: Floats, level: NDArray[np.bool_]
) -> Floats:
    """From the first of some corners, which are `level` along a way, to their middle on a face.

    Nothing where there is one: two are level where an edge lies along the face, and then the first
    may be beyond its end.
    """
    along = np.stack((0.0 - way[:, 1], way[:, 0]), axis=-1)[:, None]
    places = _dot(along, other - first[:, None])
    ends = _dot(along, face - first[:, None])
    low = np.maximum(np.where(level, places, np.inf).min(axis=1), ends.min(axis=1))
    high = np.minimum(np.where(level, places, -np.inf).max(axis=1), ends.max(axis=1))
    several = (level.sum(axis=1) > 1) & (low <= high)
    return np.where(several, (low + high) / 2, 0.0)[:, None] * along[:, 0]


def _dot(one: Floats, other: Floats) -> Floats:
    """Products of vectors along the last axis, added in one order on every machine."""
    return one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1]
