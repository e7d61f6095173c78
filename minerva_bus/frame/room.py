"""How many agents each host has room for, and a population divided over hosts with little room."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from minerva_bus.frame.composition import Fragment, shares
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import Scene, agents


class Room:
    """What is left of the `most` agents that a host takes; 0: there is always room."""

    def __init__(self, hosts: Iterable[str], most: int) -> None:
        self._left = dict.fromkeys(hosts, float(most) if most else math.inf)

    def left(self, host: str) -> float:
        """For how many agents more there is room."""
        return self._left[host]

    def of(self, hosts: Iterable[str], count: int) -> list[str]:
        """Those hosts that have room for so many agents."""
        return [host for host in hosts if self._left[host] >= count]

    def take(self, host: str, count: int) -> None:
        """So many agents live there now."""
        self._left[host] -= count


def agents_in(fragment: Fragment) -> int:
    """How many agents a fragment consists of, those in the scope of others too."""
    if isinstance(fragment, Columns):
        return fragment.count
    return sum(1 for _ in agents(Scene((fragment,))))


def divided(rows: int, weights: Sequence[float], rooms: Sequence[float]) -> list[int]:
    """How many of some rows each host gets, by weight, but no more than it has room for.

    What is left over when all are full is one number more at the end.
    """
    sizes = shares(rows, weights)
    over = 0
    for place, room in enumerate(rooms):
        if sizes[place] > room:
            over += sizes[place] - int(room)
            sizes[place] = int(room)
    for place, room in enumerate(rooms):
        more = min(over, room - sizes[place])
        sizes[place] += int(more)
        over -= int(more)
    return [*sizes, over] if over else sizes


def fit(counts: Sequence[int], sizes: Sequence[int], rooms: Sequence[float]) -> bool:
    """Whether parts may stay as they are, although `sizes` would be another division.

    Each must have its room, and what lies beside must be what no host has room for.
    """
    inside = all(count <= room for count, room in zip(counts, rooms, strict=False))
    return inside and (len(counts) <= len(rooms) or list(counts) == list(sizes))
