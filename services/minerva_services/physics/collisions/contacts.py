"""Contacts in a view: from touching volumes to one contact per pair.

Between two agents with several volumes each, the deepest touch counts. With scenery, which may be
touched on several sides at once, a touch counts unless a deeper one explains it, that is, unless
moving out of the deeper one resolves both. A wall of many segments is then one wall, and a corner
two.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.volumes import Volumes
from minerva_services.physics.collisions.grid import Boxes, pairs_among, pairs_between
from minerva_services.physics.collisions.touching import TOLERANCE, Touches, touches

Rows = NDArray[np.intp]
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
