"""Baseline of a search: a tour for a robot that knows the floor but not the marker.

The tour provides a view of the complete floor. It uses knowledge that other robots must explore, so
its length shows how much of a ratio is due to the floor itself. The tour is good but not optimal:
greedy set cover selects its stops, and 2-opt orders them. The robot has a full view at each stop,
and no view between stops.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from agents.benchmarks.exploring.driving import SIGHT
from minerva_agents.robot.maps import MapPose, OccupancyMap, free_component
from minerva_agents.robot.planning import STEP, Wave
from minerva_agents.robot.pose import Cell

Mask = NDArray[np.bool_]
Places = NDArray[np.intp]

_FINEST_M = 0.5
_ACROSS = 120
"""Spacing in metres of the points to see, and their maximum number along a large floor."""


class Tour:
    """The tour of a floor from a start, for a robot of a radius in metres."""

    def __init__(self, floor: OccupancyMap, start: MapPose, radius: float) -> None:
        self._floor, self._reach = floor, SIGHT / floor.resolution
        self._open = free_component(floor, radius, start[:2])
        self._start = floor.cell_at(start[0], start[1])
        spacing = max(_FINEST_M, max(floor.cells.shape) * floor.resolution / _ACROSS)
        self._spacing = max(1, round(spacing / floor.resolution))
        stops = self._stops()
        metres = self._between(stops)
        self._order = [stops[index] for index in _shortened(metres)]

    def metres_to(self, x: float, y: float) -> float:
        """Length in metres of the tour until the marker is in view, plus the way to the marker."""
        return float(self.metres_to_each(np.array([self._floor.cell_at(x, y)]))[0])

    def metres_to_each(self, cells: Places) -> NDArray[np.float64]:
        """`metres_to` of n cells, (n, 2); (n,)."""
        driven, here, wave = 0.0, self._start, self._wave_from(self._start)
        metres, unseen = np.zeros(len(cells)), np.arange(len(cells))
        for stop in (*self._order, None):
            seen = self._sees(np.broadcast_to(here, (len(unseen), 2)), cells[unseen])
            # A cell out of view from all stops counts as seen from the last one.
            now = unseen[seen] if stop is not None else unseen
            metres[now] = [driven + self._way(wave, (row, col)) for row, col in cells[now].tolist()]
            if stop is None or len(now) == len(unseen):
                break
            unseen = unseen[~seen]
            driven += self._way(wave, stop)
            here, wave = stop, self._wave_from(stop)
        return metres

    def _stops(self) -> list[Cell]:
        """Stops with a view of all points by greedy set cover; the first one is the start."""
        points = lattice(self._open, self._spacing)
        places = np.concatenate(([self._start], lattice(self._open, 2 * self._spacing)))
        views = np.array([self._view(place, points) for place in places])
        unseen, chosen = ~views[0], [0]
        while True:
            gains = (views & unseen).sum(axis=1)
            best = int(np.argmax(gains))
            if not gains[best]:
                break
            chosen.append(best)
            unseen &= ~views[best]
        return [(int(row), int(column)) for row, column in places[chosen]]

    def _view(self, place: Places, points: Places) -> Mask:
        """Which of the points are in view from a place."""
        squares = ((points - place) ** 2).sum(axis=1)
        near = np.flatnonzero(squares <= self._reach * self._reach)
        seen = np.zeros(len(points), np.bool_)
        seen[near] = self._sees(np.repeat(place[np.newaxis], len(near), axis=0), points[near])
        return seen

    def _sees(self, places: Places, points: Places) -> Mask:
        """Whether the lines of sight between places and points are short enough and free."""
        is_near = ((points - places) ** 2).sum(axis=1) <= self._reach * self._reach
        parts = np.linspace(0.0, 1.0, math.ceil(self._reach) + 1)[:, np.newaxis]
        cells = [
            np.rint(places[:, axis] + parts * (points - places)[:, axis]).astype(np.intp)
            for axis in (0, 1)
        ]
        inside = [np.clip(c, 0, n - 1) for c, n in zip(cells, self._open.shape, strict=True)]
        return is_near & ~self._floor.obstacles[tuple(inside)].any(axis=0)

    def _between(self, stops: list[Cell]) -> NDArray[np.float64]:
        """Distances in metres between all stops, (n, n)."""
        waves = [self._wave_from(stop) for stop in stops]
        return np.array([[self._way(wave, other) for other in stops] for wave in waves])

    def _wave_from(self, cell: Cell) -> Wave:
        wave = Wave(self._open, cell)
        wave.grow(self._open.size)
        return wave

    def _way(self, wave: Wave, cell: Cell) -> float:
        return max(0, int(wave.steps[cell])) * STEP * self._floor.resolution


@lru_cache(maxsize=1)
def tour_of(floor: OccupancyMap, start: MapPose, radius: float) -> Tour:
    """The tour of a floor, with a cache of one entry."""
    return Tour(floor, start, radius)


def lattice(mask: Mask, spacing: int) -> Places:
    """The first cell of the mask in each square of `spacing` by `spacing` cells, (n, 2)."""
    cells = np.argwhere(mask)
    squares = cells // spacing
    firsts = np.unique(squares[:, 0] * mask.shape[1] + squares[:, 1], return_index=True)[1]
    return cells[firsts]


def _shortened(metres: NDArray[np.float64]) -> list[int]:
    """A short order of the stops after the first: nearest neighbour, then 2-opt."""
    order, left = [0], set(range(1, len(metres)))
    while left:
        order.append(min(left, key=lambda stop: (metres[order[-1], stop], stop)))
        left.remove(order[-1])
    while _two_opt(order, metres):
        pass
    return order[1:]


def _two_opt(order: list[int], metres: NDArray[np.float64]) -> bool:
    """Reverse parts of the order that become shorter; returns whether any has."""
    is_shorter = False
    for first in range(1, len(order) - 1):
        for last in range(first + 1, len(order)):
            before, begin, end = order[first - 1], order[first], order[last]
            gain = metres[before, begin] - metres[before, end]
            if last + 1 < len(order):
                gain += metres[end, order[last + 1]] - metres[begin, order[last + 1]]
            if gain > 1e-9:
                order[first : last + 1] = order[first : last + 1][::-1]
                is_shorter = True
    return is_shorter
