"""Arrival at a marker: when it counts, and which cells to aim for.

A robot has arrived when it is within 0.5 m of the marker and nothing stands between them. A marker
may hang on a wall, or another robot may block it. Where 0.5 m is impossible, the robot approaches
as closely as it can and has arrived where its path ends or is blocked, at most 1.2 m away.

After arriving, a robot clears the way: it moves behind the marker, as seen from its approach, so
that it blocks neither the door nor the marker. Where walls leave no space behind, as in a corner,
it moves to the side: a robot that stays in front also hides the marker from the cameras of others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from minerva_agents.robot.grids import Mask
from minerva_agents.robot.ground import all_that_see, blocked, sees, straightened
from minerva_agents.robot.knowledge import MARKER, free, obstacles
from minerva_agents.robot.motion import Cell, cell_of, centre_of
from minerva_agents.robot.wave import STEP, Wave
from minerva_bus import portable

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

# Metres to the marker of a robot that has arrived, and of one that can come no closer.
REACH: Final = 0.5
NEAR: Final = 1.2
APPROACH: Final = "approach"
MAKE_WAY: Final = "make way"

STOP: Final = 0.4
"""Distance from the marker to aim for, in metres.

Leaves a margin for errors of a few centimetres.
"""

# In metres, in the order in which they are tried.
_DISTANCES: Final = (STOP, 0.6, 0.8, 1.0, NEAR)
_MAX_DISTANCE: Final = 3.0
"""Maximum path length for clearing the way, in metres."""

RELAX_FAILURES: Final = 3
"""Consecutive failures after which a robot accepts a worse approach."""


def has_arrived(robot: ARobot, place: Cell) -> bool:
    """True if the robot is at the marker, or as close to it as it can get."""
    dist = portable.dist(robot.position, centre_of(place)) * robot.cell
    # The path has ended: the robot can come no closer.
    if robot.purpose == APPROACH and not robot.plan_rows and dist <= NEAR:
        return True
    return dist <= REACH and _sees(robot, place)


def is_near(robot: ARobot, place: Cell) -> bool:
    """True if the robot is close enough given that it can come no closer."""
    dist = portable.dist(robot.position, centre_of(place)) * robot.cell
    return dist <= NEAR and (_sees(robot, place) or robot.failures >= RELAX_FAILURES)


def good_places(robot: ARobot, place: Cell) -> Iterator[Mask]:
    """Masks of cells from which the marker counts as reached, best first.

    Cells without line of sight come last and only after `RELAX_FAILURES` failures, because they
    may lie in the next room.
    """
    walls = obstacles(robot.grid)
    # Masks are built on demand, because the tests of sight are slow and an early mask usually
    # suffices.
    for dist in _DISTANCES:
        yield cells_with_view(walls, place, dist / robot.cell)
    if robot.failures >= RELAX_FAILURES:
        for dist in _DISTANCES:
            yield _around(walls, place, dist / robot.cell)


def make_way(robot: ARobot, place: Cell) -> None:
    """Plan a path out of the way of other robots heading for the marker, if there is space."""
    robot.forget_plan()
    grid, cell = robot.grid, robot.cell
    closed = blocked(grid, robot.position, robot.room)
    wave = Wave(~closed, cell_of(robot.position))
    rows, columns = wave.grow(math.floor(_MAX_DISTANCE / (STEP * cell)))
    to_rows, to_columns = rows - place[0], columns - place[1]
    squares = to_rows * to_rows + to_columns * to_columns
    # Projected on the direction from the robot to the marker: positive is beyond the marker.
    down, across = place[0] + 0.5 - robot.row, place[1] + 0.5 - robot.column
    behind = to_rows * down + to_columns * across
    is_good = (squares > (REACH / cell) ** 2) & (squares <= (NEAR / cell) ** 2)
    is_good &= free(grid)[rows, columns]
    # As seen from the marker, a cell at least 60 degrees from the robot lies off the approach.
    is_good &= behind > -0.5 * np.sqrt(squares * (down * down + across * across))
    if is_good.any():
        best = int(np.argmax(np.where(is_good, behind, -math.inf)))
        path = wave.path_to((int(rows[best]), int(columns[best])))
        robot.set_way(straightened(grid, robot.position, path, robot.room), MAKE_WAY)


def make_way_again(robot: ARobot) -> None:
    """Plan another path out of the way: a robot that stops half-way may hide the nearest marker."""
    places = np.argwhere(robot.grid >= MARKER)
    squares = ((places + 0.5 - robot.position) ** 2).sum(axis=1)
    if not squares.size:
        return robot.forget_plan()
    row, column = places[int(np.argmin(squares))].tolist()
    return make_way(robot, (row, column))


def cells_with_view(walls: Mask, place: Cell, reach: float) -> Mask:
    """Cells at most `reach` cells from a place that see it."""
    visible = _around(walls, place, reach) & ~walls
    rows, columns = visible.nonzero()
    centres = (rows.astype(np.float64) + 0.5, columns.astype(np.float64) + 0.5)
    visible[rows, columns] = all_that_see(walls, *centres, centre_of(place))
    return visible


def _around(walls: Mask, place: Cell, reach: float) -> Mask:
    rows, columns = np.ogrid[: walls.shape[0], : walls.shape[1]]
    return (rows - place[0]) ** 2 + (columns - place[1]) ** 2 <= reach * reach


def _sees(robot: ARobot, place: Cell) -> bool:
    return sees(obstacles(robot.grid), robot.position, centre_of(place))
