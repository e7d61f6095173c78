"""Baselines for the robot's exploration: the nearest frontier, and a random walk."""

from __future__ import annotations

import math
from functools import partial
from typing import cast

import numpy as np

from minerva_agents.robot.control import PLANNERS, search_and_approach
from minerva_agents.robot.exploration import Goal, SearchState
from minerva_agents.robot.grid import FREE, UNKNOWN, Mask, expanses, free, grown_to_sides
from minerva_agents.robot.planning import Wave
from minerva_bus import Cells


def frontier(grid: Cells) -> Mask:
    """Free cells adjacent to unknown ones.

    Gaps between two beams do not count as unknown.
    """
    return free(grid) & grown_to_sides(expanses(grid == UNKNOWN))


def out_of_view(grid: Cells) -> Mask:
    """Free cells that the camera has not seen, without specks."""
    return expanses(grid == FREE)


def nearest(known: SearchState) -> Goal | None:
    """The nearest cell on the frontier or out of view, by path length [Yamauchi 1997]."""
    grid = known.grid
    here = math.floor(known.pose.row), math.floor(known.pose.column)
    news = (frontier(grid) | out_of_view(grid)) & ~known.closed
    news[here] = False
    for cell in known.been:
        news[max(0, cell[0] - 1) : cell[0] + 2, max(0, cell[1] - 1) : cell[1] + 2] = False
    wave = Wave(~known.closed & ~expanses(grid == UNKNOWN) & (free(grid) | (grid == 0)), here)
    rows, columns = wave.grow(grid.size)
    hits = np.flatnonzero(news[rows, columns])
    if not hits.size:
        return None
    cell = int(rows[hits[0]]), int(columns[hits[0]])
    return Goal(tuple(wave.path_to(cell)), 0.0, 0.0)


def use(strategy: str) -> None:
    """Register a strategy as one of the robot's planners."""
    planners = cast("dict[str, object]", PLANNERS)
    if strategy == "nearest":
        planners["nearest"] = partial(search_and_approach, choose=nearest)


__all__ = ["nearest", "use"]
