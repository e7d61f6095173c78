"""Contacts between convex volumes: candidate pairs from a uniform grid, then exact tests.

Each box is entered into all cells that it overlaps; boxes that meet share a cell. Cells are about
the size of boxes, so that few boxes share one.

A volume is the set of points within a radius of its core: a point, a segment or a convex polygon.
Two volumes touch if their cores are no farther apart than the sum of the radii. Overlapping cores
are detected by the separating axis theorem, which also gives the shortest way out; all other pairs
by their nearest corners and edges, at least one of which is a corner.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_services.geometry.volumes import Volumes

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]
Pair = tuple[str, str]

ANYTHING: Final = "*"


def owners_of(volumes: Volumes) -> Rows:
    """Owner of each volume: its number in the order of the string, -1 for scenery."""
    owners: list[str] = volumes.owners.tolist()
    names = [owner for owner in dict.fromkeys(owners) if owner]
    numbers = {name: number for number, name in enumerate(names)} | {"": -1}
    return np.array([numbers[owner] for owner in owners], np.intp)


def contacts(volumes: Volumes, ignored: Iterable[Pair] = ()) -> Touches:
    """The contacts of each agent from its point of view, by agent, then by what it touches.

    Two touching agents have one contact each. Scenery precedes agents, which follow the order of
    the string.

    Args:
        volumes: all volumes of the view.
        ignored: pairs of agent kinds, primitives or `*` to skip.

    """
    owners = owners_of(volumes)
    first, other = _near(volumes, owners)
    kept = np.flatnonzero(_counts(volumes, first, other, ignored))
    hits = touches(volumes, first[kept], other[kept])
    scenery = owners[hits.second] < 0
    walls = _outermost(hits.take(np.flatnonzero(scenery)), owners)
    agents = _deepest(hits.take(np.flatnonzero(~scenery)), owners)
    # Contacts between agents are listed again from the other agent's point of view.
    mirrored = agents.turned(np.ones(len(agents.first), np.bool_))
    return _ordered(_joined(walls, agents, mirrored), owners)


def _near(volumes: Volumes, owner: Rows) -> tuple[Rows, Rows]:
    """Candidate pairs: an agent's volume, and that of a later agent or of scenery."""
    lower, upper = volumes.boxes()
    # Volumes count as touching across a gap of up to TOLERANCE, so their boxes must overlap there.
    boxes = Boxes(lower - TOLERANCE, upper + TOLERANCE)
    # Pairs within scenery are never built: scenery receives no events, and a map has many parts.
    moving, still = np.flatnonzero(owner >= 0), np.flatnonzero(owner < 0)
    first, other = pairs_among(boxes.take(moving))
    agent, thing = pairs_between(boxes.take(moving), boxes.take(still))
    first, other = moving[first], moving[other]
    # The volumes of one agent do not collide with each other. Of two agents, the earlier one in the
    # string comes first, so that all touches of a pair form one group in `_deepest`.
    apart = owner[first] != owner[other]
    first, other = first[apart], other[apart]
    in_order = owner[first] < owner[other]
    first, other = np.where(in_order, first, other), np.where(in_order, other, first)
    return np.concatenate((first, moving[agent])), np.concatenate((other, still[thing]))


def _counts(
    volumes: Volumes, first: Rows, other: Rows, ignored: Iterable[Pair]
) -> NDArray[np.bool_]:
    counts = np.ones(len(first), np.bool_)
    for here, there in ignored:
        # A pair to ignore is meant in both directions.
        forth = _called(volumes, first, here) & _called(volumes, other, there)
        back = _called(volumes, first, there) & _called(volumes, other, here)
        counts &= ~(forth | back)
    return counts


def _called(volumes: Volumes, rows: Rows, name: str) -> NDArray[np.bool_]:
    if name == ANYTHING:
        return np.ones(len(rows), np.bool_)
    named = (volumes.kinds == name) | (volumes.symbols == name)
    return np.asarray(named, np.bool_)[rows]


def _deepest(hits: Touches, owner: Rows) -> Touches:
    """The deepest touch of each pair of agents."""
    first, other = owner[hits.first], owner[hits.second]
    # lexsort sorts by its last key first: by pair, then the deepest, then the lowest rows.
    order = np.lexsort((hits.second, hits.first, -hits.depth, other, first))
    first, other = first[order], other[order]
    new = np.ones(len(order), np.bool_)
    new[1:] = (first[1:] != first[:-1]) | (other[1:] != other[:-1])
    return hits.take(order[new])


def _outermost(hits: Touches, owner: Rows) -> Touches:
    """Touches with scenery, without those that a deeper touch of the same agent explains."""
    agent = owner[hits.first]
    order = np.lexsort((hits.second, hits.first, -hits.depth, agent))
    hits, agent = hits.take(order), agent[order]
    kept: list[int] = []
    deeper_rows: list[int] = []
    for row in range(len(order)):
        if row and agent[row] != agent[row - 1]:
            deeper_rows = []
        # Rows are in descending depth within an agent, so every deeper touch has been decided
        # before.
        if not any(_behind(hits, row, deeper) for deeper in deeper_rows):
            deeper_rows.append(row)
            kept.append(row)
    return hits.take(np.array(kept, np.intp))


def _behind(hits: Touches, row: int, deeper: int) -> bool:
    """True if a surface, at its touch, does not lie above that of a deeper touch."""
    # A touch is recorded at the middle of its overlap, so the surface lies half the depth along the
    # normal.
    way = hits.normal[deeper]
    here = hits.point[row] + hits.normal[row] * (hits.depth[row] / 2)
    there = hits.point[deeper] + way * (hits.depth[deeper] / 2)
    step = here - there
    return bool(step[0] * way[0] + step[1] * way[1] <= TOLERANCE)


def _joined(*parts: Touches) -> Touches:
    names = [field.name for field in fields(Touches)]
    return Touches(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _ordered(hits: Touches, owner: Rows) -> Touches:
    return hits.take(np.lexsort((hits.second, owner[hits.second], owner[hits.first])))


_MAX_CELLS_PER_BOX: Final = 16
"""Maximum mean number of cells per box; above it, cells are enlarged."""
_MAX_CELL: Final = 2.0**30
"""Boxes beyond this many cells from the origin are put into the outermost cells."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """n axis-aligned boxes; corners of shape (n, 2) in metres."""

    lower: Floats
    upper: Floats

    def __len__(self) -> int:
        return len(self.lower)

    def take(self, rows: Rows) -> Boxes:
        """The boxes of these rows."""
        return Boxes(self.lower[rows], self.upper[rows])


def pairs_among(boxes: Boxes) -> tuple[Rows, Rows]:
    """All pairs of boxes that overlap or touch, each once, lower row first, in order."""
    first, second = pairs_between(boxes, boxes)
    unique = np.flatnonzero(first < second)
    return first[unique], second[unique]


def pairs_between(boxes: Boxes, others: Boxes) -> tuple[Rows, Rows]:
    """All pairs between two sets of boxes that overlap or touch, in order."""
    if not len(boxes) or not len(others):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    cell = _cell(boxes, others)
    here, there = _Entries.of(boxes, cell), _Entries.of(others, cell)
    first, second = _in_one_cell(here, there)
    # A pair that shares several cells counts in one of them only: the lowest that both overlap.
    corner = np.maximum(here.lowest[first], there.lowest[second])
    unique = corner == here.at[first]
    first, second = here.box[first], there.box[second]
    meet = (boxes.lower[first] <= others.upper[second]) & (
        others.lower[second] <= boxes.upper[first]
    )
    kept = np.flatnonzero(unique.all(axis=1) & meet.all(axis=1))
    first, second = first[kept], second[kept]
    order = np.lexsort((second, first))
    return first[order], second[order]


@dataclass(frozen=True, slots=True)
class _Entries:
    """Boxes by cell: the box, its cell (n, 2), and the lowest cell of the box (n, 2)."""

    box: Rows
    at: Rows
    lowest: Rows

    @staticmethod
    def of(boxes: Boxes, cell: float) -> _Entries:
        low, high = _cells(boxes, cell)
        wide = high - low + 1
        counts = wide[:, 0] * wide[:, 1]
        box = np.repeat(np.arange(len(boxes)), counts)
        # Number each row within its box, without a loop.
        nth = np.arange(len(box)) - np.repeat(np.cumsum(counts) - counts, counts)
        step = np.stack((nth // wide[box, 1], nth % wide[box, 1]), axis=1)
        return _Entries(box, low[box] + step, low[box])

    @property
    def keys(self) -> NDArray[np.int64]:
        """One integer per cell."""
        # Cell numbers fit in 32 bits because of _MAX_CELL, so keys are unique.
        return (self.at[:, 0].astype(np.int64) << 32) + self.at[:, 1]


def _cells(boxes: Boxes, cell: float) -> tuple[Rows, Rows]:
    low, high = (
        np.floor(np.clip(corner / cell, -_MAX_CELL, _MAX_CELL)).astype(np.intp)
        for corner in (boxes.lower, boxes.upper)
    )
    return low, high


def _cell(boxes: Boxes, others: Boxes) -> float:
    """Side of a cell: at least twice the median size of the first set."""
    sizes = (boxes.upper - boxes.lower).max(axis=1)
    # Points only: the median size is 0, so any cell will do.
    cell = 2.0 * float(np.median(sizes)) or 1.0
    # The median ignores outliers, so one huge box among small ones could fill millions of cells.
    # Larger cells bound the memory.
    enough = _MAX_CELLS_PER_BOX * (len(boxes) + len(others))
    while _entries(boxes, cell) + _entries(others, cell) > enough:
        cell *= 2.0
    return cell


def _entries(boxes: Boxes, cell: float) -> float:
    low, high = _cells(boxes, cell)
    wide = (high - low + 1).astype(np.float64)
    # As floats: a box may span 2^62 cells, and the sum of several would overflow an integer.
    return float((wide[:, 0] * wide[:, 1]).sum())


def _in_one_cell(boxes: _Entries, others: _Entries) -> tuple[Rows, Rows]:
    """Pairs of entries in the same cell."""
    # A join by cell: sort one side, then find the range of equal keys for each entry of the other.
    keys = others.keys
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    begin, end = (np.searchsorted(keys, boxes.keys, side) for side in ("left", "right"))
    counts = end - begin
    first = np.repeat(np.arange(len(counts)), counts)
    nth = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    return first, order[begin[first] + nth]


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
