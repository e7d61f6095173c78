"""What touches what in a view: from volumes to one contact for each two that meet.

Of two agents of several volumes each the deepest touch counts. With scenery, which may be on
several sides at once, a touch counts unless a deeper one accounts for it: the way out of that is a
way out of it too. So a wall of many pieces is one wall, and a corner two.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.volumes import Volumes
from minerva_services.physics.collisions.grid import Boxes, pairs_among, pairs_between
from minerva_services.physics.collisions.touching import SLACK, Touches, touches

Rows = NDArray[np.intp]
Pair = tuple[str, str]

ANYTHING: Final = "*"


@dataclass(frozen=True, slots=True)
class Owners:
    """Whose the volumes are, in numbers: `names` in the order of the string, -1 for scenery."""

    names: tuple[str, ...]
    of: Rows

    @staticmethod
    def among(volumes: Volumes) -> Owners:
        """The owners of some volumes."""
        owners: list[str] = volumes.owners.tolist()
        names = [one for one in dict.fromkeys(owners) if one]
        numbers = {name: number for number, name in enumerate(names)} | {"": -1}
        return Owners(tuple(names), np.array([numbers[one] for one in owners], np.intp))


def contacts(volumes: Volumes, owners: Owners, ignored: Iterable[Pair] = ()) -> Touches:
    """The contacts of each agent, seen from it: by agent, then by what it touches.

    Two agents that touch have one each. Scenery comes first, and agents in the order of the string.

    Args:
        volumes: what there is.
        owners: whose it is.
        ignored: pairs that do not count, of kinds of agents, primitives or `*`.

    """
    one, other = _near(volumes, owners.of)
    kept = np.flatnonzero(_counts(volumes, one, other, ignored))
    found = touches(volumes, one[kept], other[kept])
    scenery = owners.of[found.other] < 0
    walls = _outermost(found.take(np.flatnonzero(scenery)), owners.of)
    mine = _deepest(found.take(np.flatnonzero(~scenery)), owners.of)
    theirs = mine.turned(np.ones(len(mine.one), np.bool_))
    return _ordered(_joined(walls, mine, theirs), owners.of)


def _near(volumes: Volumes, owner: Rows) -> tuple[Rows, Rows]:
    """Pairs that may touch: an agent's volume, and a later agent's or scenery."""
    lower, upper = volumes.boxes()
    boxes = Boxes(lower - SLACK, upper + SLACK)
    moving, still = np.flatnonzero(owner >= 0), np.flatnonzero(owner < 0)
    one, other = pairs_among(boxes.take(moving))
    agent, thing = pairs_between(boxes.take(moving), boxes.take(still))
    one, other = moving[one], moving[other]
    apart = owner[one] != owner[other]
    one, other = one[apart], other[apart]
    first = owner[one] < owner[other]
    one, other = np.where(first, one, other), np.where(first, other, one)
    return np.concatenate((one, moving[agent])), np.concatenate((other, still[thing]))


def _counts(volumes: Volumes, one: Rows, other: Rows, ignored: Iterable[Pair]) -> NDArray[np.bool_]:
    counts = np.ones(len(one), np.bool_)
    for here, there in ignored:
        forth = _called(volumes, one, here) & _called(volumes, other, there)
        back = _called(volumes, one, there) & _called(volumes, other, here)
        counts &= ~(forth | back)
    return counts


def _called(volumes: Volumes, rows: Rows, name: str) -> NDArray[np.bool_]:
    if name == ANYTHING:
        return np.ones(len(rows), np.bool_)
    named = (volumes.kinds == name) | (volumes.symbols == name)
    return np.asarray(named, np.bool_)[rows]


def _deepest(found: Touches, owner: Rows) -> Touches:
    """One touch for each two agents."""
    one, other = owner[found.one], owner[found.other]
    order = np.lexsort((found.other, found.one, -found.depth, other, one))
    one, other = one[order], other[order]
    new = np.ones(len(order), np.bool_)
    new[1:] = (one[1:] != one[:-1]) | (other[1:] != other[:-1])
    return found.take(order[new])


def _outermost(found: Touches, owner: Rows) -> Touches:
    """The touches with scenery that no deeper one of the same agent accounts for."""
    agent = owner[found.one]
    order = np.lexsort((found.other, found.one, -found.depth, agent))
    found, agent = found.take(order), agent[order]
    kept: list[int] = []
    mine: list[int] = []
    for row in range(len(order)):
        if row and agent[row] != agent[row - 1]:
            mine = []
        if not any(_behind(found, row, deeper) for deeper in mine):
            mine.append(row)
            kept.append(row)
    return found.take(np.array(kept, np.intp))


def _behind(found: Touches, row: int, deeper: int) -> bool:
    """Whether a thing's surface, where it is touched, lies not above that of a deeper touch."""
    way = found.normal[deeper]
    here = found.point[row] + found.normal[row] * (found.depth[row] / 2)
    there = found.point[deeper] + way * (found.depth[deeper] / 2)
    step = here - there
    return bool(step[0] * way[0] + step[1] * way[1] <= SLACK)


def _joined(*parts: Touches) -> Touches:
    return Touches(
        np.concatenate([part.one for part in parts]),
        np.concatenate([part.other for part in parts]),
        np.concatenate([part.point for part in parts]),
        np.concatenate([part.normal for part in parts]),
        np.concatenate([part.depth for part in parts]),
    )


def _ordered(found: Touches, owner: Rows) -> Touches:
    return found.take(np.lexsort((found.other, owner[found.other], owner[found.one])))
