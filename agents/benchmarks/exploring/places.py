"""Expected ratio of a search over all places of a marker on a floor.

The ratio for one marker depends on luck: whichever wing of a building is explored last, a marker
there has a large ratio. So the robot searches for a marker that it never sees, until its camera has
seen every place. For each place on a lattice, the distance that a robot drives to a marker there is
the distance driven until the place is first seen, plus the shortest path from there.

The same expectation is computed for the tour of a robot that knows the floor (see `tours`), and a
lower bound for any robot: with a camera of range r, a path of d metres shows an area of at most
pi r² + 2 r d.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.benchmarks.exploring.driving import FOV, SIGHT, Drive, Floor, Noise
from agents.benchmarks.exploring.tours import lattice
from minerva_agents.robot.grid import Mask
from minerva_agents.robot.maps import MapPose, OccupancyMap, free_component
from minerva_agents.robot.planning import STEP, Wave
from minerva_agents.robot.robot import ARobot

Reals = NDArray[np.float64]

ARRIVED_M = 0.5
"""Distance from a marker at which the robot has arrived."""

_SPACING_M, _ACROSS = 0.5, 60
"""Spacing of the places in metres, and their maximum number along a large floor."""

_TOLERANCE_M = 0.05


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected ratios on a floor, for all places and for the far half of the places."""

    all: float
    far: float

    @staticmethod
    def of(metres: Reals, shortest: Reals) -> Expected:
        """Means over places of driven metres, by their shortest paths in metres."""
        ratios = metres / shortest
        return Expected(
            round(float(ratios.mean()), 3), round(float(ratios[_far(shortest)].mean()), 3)
        )


def _far(shortest: Reals) -> Mask:
    """The far half of the places."""
    return shortest > shortest.max() / 2.0


class Places:
    """Places of a marker that a robot of a radius in metres can reach from a start."""

    def __init__(self, floor: OccupancyMap, start: MapPose, radius: float) -> None:
        self._floor = floor
        self._open = free_component(floor, radius, start[:2])
        steps = self._steps_from(*start[:2])
        spacing = max(_SPACING_M, max(floor.cells.shape) * floor.resolution / _ACROSS)
        cells = lattice(self._open & (steps > 0), max(1, round(spacing / floor.resolution)))
        self.points: Reals = (cells + 0.5) * floor.resolution + (floor.x, floor.y)
        self.shortest: Reals = steps[cells[:, 0], cells[:, 1]] * STEP * floor.resolution
        self.cells = cells

    def metres_from(self, x: float, y: float, places: NDArray[np.intp]) -> Reals:
        """Driven distance in metres from a point to some of the places."""
        cells = self.cells[places]
        steps = self._steps_from(x, y)[cells[:, 0], cells[:, 1]]
        # The body may fit into its cell only just: then the straight line.
        straight = np.hypot(*(self.points[places] - (x, y)).T)
        way = np.where(steps > 0, steps * STEP * self._floor.resolution, straight)
        return np.maximum(way - ARRIVED_M, 0.0)

    def bound(self) -> Expected:
        """Ratios below those of any robot, with the mean area of a place in place of each area.

        A path of d metres shows at most (pi r² + 2 r d) / a places of area a. The mean ratio is
        smallest if near places are seen first, because a metre costs them more.
        """
        area = np.count_nonzero(self._open) * self._floor.resolution**2 / len(self.shortest)

        def mean(shortest: Reals) -> float:
            seen = (np.arange(1, len(shortest) + 1) * area - math.pi * SIGHT**2) / (2.0 * SIGHT)
            metres = np.maximum(np.sort(shortest) - ARRIVED_M, seen)
            return round(float((metres / np.sort(shortest)).mean()), 3)

        return Expected(mean(self.shortest), mean(self.shortest[_far(self.shortest)]))

    def _steps_from(self, x: float, y: float) -> NDArray[np.integer]:
        cell = self._floor.cell_at(x, y)
        if not self._open[cell]:
            return np.zeros(self._open.shape, np.int64)
        wave = Wave(self._open, cell)
        wave.grow(self._open.size)
        return wave.steps


class Watched(Drive):
    """A robot that never sees its marker, and the metres driven to a marker at each place."""

    def __init__(
        self, floor: Floor, places: Places, robot: ARobot, noise: Noise, seed: int
    ) -> None:
        super().__init__(floor, (), robot, noise, seed)
        self._places = places
        self.metres: Reals = np.full(len(places.points), np.nan)

    def see_all(self, frames: int) -> None:
        """Drive until all places have been seen, or the robot gives up; at most `frames`."""
        run = self.run
        while run.frames < frames and not run.reported and np.isnan(self.metres).any():
            self._frame()
            run.frames += 1

    def _sightings(self, x: float, y: float) -> Iterator[tuple[str, float, float]]:
        unseen = np.flatnonzero(np.isnan(self.metres))
        away = self._places.points[unseen] - (x, y)
        dist = np.hypot(*away.T)
        bearing = np.degrees(np.arctan2(away[:, 1], away[:, 0]))
        angle = (bearing - self._true.angle + 180.0) % 360.0 - 180.0
        ahead = (dist <= SIGHT) & (np.abs(angle) <= FOV / 2)
        lengths = self._floor.cast(x, y, bearing[ahead], SIGHT)
        seen = unseen[ahead][lengths >= dist[ahead] - _TOLERANCE_M]
        if seen.size:
            self.metres[seen] = self.run.metres + self._places.metres_from(x, y, seen)
        return iter(())
