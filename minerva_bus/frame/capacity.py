"""Capacity of hosts, and the apportionment of populations to hosts of limited capacity."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from minerva_bus.frame.fragments import Fragment, shares
from minerva_bus.grammar.traversal import kind_counts


class Capacity:
    """Remaining capacity of hosts that take up to `limit` agents each; 0: no limit."""

    def __init__(self, hosts: Iterable[str], limit: int) -> None:
        self._left = dict.fromkeys(hosts, float(limit) if limit else math.inf)

    def left(self, host: str) -> float:
        """Remaining capacity of a host in agents."""
        return self._left[host]

    def with_room(self, hosts: Iterable[str], count: int) -> list[str]:
        """The hosts with capacity for `count` further agents."""
        return [host for host in hosts if self._left[host] >= count]

    def take(self, host: str, count: int) -> None:
        """Assign `count` agents to a host."""
        self._left[host] -= count


def agents_in(fragment: Fragment) -> int:
    """Number of agents in a fragment, including agents in the scope of others."""
    return kind_counts(fragment).total()


def apportion(rows: int, weights: Sequence[float], capacities: Sequence[float]) -> list[int]:
    """Number of rows for each host, by weight and within its capacity.

    Rows that exceed the capacity of all hosts are one more number at the end.
    """
    sizes = shares(rows, weights)
    excess = 0
    for place, capacity in enumerate(capacities):
        # Only a finite capacity can be exceeded, so `int` cannot fail.
        if sizes[place] > capacity:
            excess += sizes[place] - int(capacity)
            sizes[place] = int(capacity)
    # In the order of the hosts, so that every run gives the excess to the same ones.
    for place, capacity in enumerate(capacities):
        more = min(excess, capacity - sizes[place])
        sizes[place] += int(more)
        excess -= int(more)
    return [*sizes, excess] if excess else sizes


def fit(counts: Sequence[int], sizes: Sequence[int], capacities: Sequence[float]) -> bool:
    """Whether parts of these row counts may stay, although `sizes` would be apportioned now.

    Each part must fit its host; a surplus part must contain the rows that exceed all capacities.
    """
    inside = all(count <= limit for count, limit in zip(counts, capacities, strict=False))
    return inside and (len(counts) <= len(capacities) or list(counts) == list(sizes))
