"""The way to a marker: following a path, arriving, making way, and giving up.

A robot has arrived when it is within 0.5 m of the marker and nothing stands between them. A marker
may hang on a wall, or another robot may block it. Where 0.5 m is impossible, the robot approaches
as closely as it can and has arrived where its path ends or is blocked, at most 1.2 m away.

After arriving, a robot clears the way: it moves behind the marker, as seen from its approach, so
that it blocks neither the door nor the marker. Where walls leave no space behind, as in a corner,
it moves to the side: a robot that stays in front also hides the marker from the cameras of others.

The paper's robot searches forever: if its marker lies outside the walls, inside a pillar or does
not exist, or if no camera recognises it, the robot would drive until its battery is empty without
reporting a reason. This one gives up.

A search ends when no viewpoint is left, and is restarted `MAX_SEARCHES` times. The time of all
searches is limited, too, because an erroneous laser may show single new cells forever. Time counts
against the robot's patience, and each square metre pays for some driving in each search: once when
it becomes known, once when the camera inspects it. On a grid of A m², a search of a robot that
drives at s m/s ends after at most

  patience + 2 A METRES_PER_NEWS / s

Once the marker has been seen, the robot has its full patience again, and news pay for nothing: it
arrives, or gives up after `MAX_FAILURES` failed plans in a row or after `patience`. Plans that are
made and abandoned by turns, as where an obstacle comes and goes on its map, count as no failures.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from minerva_agents.robot import errands
from minerva_agents.robot.clearance import (
    all_that_see,
    blocked,
    is_clear,
    is_passable,
    sees,
    straightened,
)
from minerva_agents.robot.grid import MARKER, SEEN, UNKNOWN, Mask, free, obstacles
from minerva_agents.robot.planning import STEP, Wave
from minerva_agents.robot.pose import STAY, Cell, Move, cell_of, centre_of, towards
from minerva_agents.robot.state import RobotState
from minerva_agents.robot.vocabulary import eUnreachable
from minerva_bus import Context, portable

# A corner at this distance, in cells, has been reached.
_TOLERANCE: Final = 1e-4


def pass_corners(robot: RobotState) -> None:
    """Drop the corners that the robot has reached."""
    way = robot.way
    while way and portable.dist(way[0], robot.position) < _TOLERANCE:
        way.pop(0)
    if len(way) != len(robot.plan_rows):
        robot.set_way(way, robot.purpose, robot.is_narrow)


def is_open(robot: RobotState) -> bool:
    """True if the robot has a path and no new obstacle blocks it."""
    way = (robot.position, *robot.way)
    if len(way) == 1:
        return False
    if robot.is_narrow:
        return is_passable(robot.grid, way, robot.radius, robot.cell)
    return is_clear(robot.grid, way, robot.room)


def step(robot: RobotState, dt: float) -> Move:
    """Next move along the path."""
    if not robot.plan_rows:
        return STAY
    corner = robot.plan_rows[0], robot.plan_columns[0]
    return towards(robot.pose, *corner, robot.cell, robot.speed * dt, dt)


# --- arriving and making way ----------------------------------------------------------------------


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


def has_arrived(robot: RobotState, place: Cell) -> bool:
    """True if the robot is at the marker, or as close to it as it can get."""
    dist = portable.dist(robot.position, centre_of(place)) * robot.cell
    # The path has ended: the robot can come no closer.
    if robot.purpose == APPROACH and not robot.plan_rows and dist <= NEAR:
        return True
    return dist <= REACH and _sees(robot, place)


def is_near(robot: RobotState, place: Cell) -> bool:
    """True if the robot is close enough given that it can come no closer."""
    dist = portable.dist(robot.position, centre_of(place)) * robot.cell
    return dist <= NEAR and (_sees(robot, place) or robot.failures >= RELAX_FAILURES)


def good_places(robot: RobotState, place: Cell) -> Iterator[Mask]:
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


def make_way(robot: RobotState, place: Cell) -> None:
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


def make_way_again(robot: RobotState) -> None:
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


def _sees(robot: RobotState, place: Cell) -> bool:
    return sees(obstacles(robot.grid), robot.position, centre_of(place))


# --- giving up ------------------------------------------------------------------------------------


MAX_SEARCHES: Final = 2
"""Number of restarts of an exhausted search."""

MAX_FAILURES: Final = 12
"""Consecutive failed attempts to plan a path to a known marker."""

METRES_PER_NEWS: Final = 2.0
"""Metres of driving that a square metre of news pays for.

In blind corridors a metre wide, a search drives one metre per square metre of news.
"""

COUNT_FRAMES: Final = 20
"""Frames between two counts of known cells."""

_MIN_SECONDS: Final = 300.0
_CROSSINGS: Final = 10.0
_MIN_SPEED: Final = 0.01


def gives_up(robot: RobotState, moment: Context) -> bool:
    """Give up the objective, report why and clear it, if there is no prospect left."""
    why = _why(robot, moment)
    if not why:
        return False
    if robot.target:
        errands.give_up(robot, why, moment)
    else:
        moment.emit(eUnreachable(robot.objective, why))
        robot.seek("")
    return True


def restart_search(robot: RobotState) -> None:
    """Begin another search for the same objective: its news pay for driving again."""
    robot.been = robot.dull = ()
    robot.searches += 1
    robot.most_known = 0
    robot.stale = 0.0


def patience(robot: RobotState) -> float:
    """Seconds without news, or without arriving at a marker that is known, before giving up.

    They are ten crossings of the grid, in the first search five minutes more.

    A repeated search inspects single cells. Where a wall lies between two rows of cells, the laser
    shows them as obstacles and as free by turns, so there is always one to inspect.
    """
    across = portable.hypot(*robot.grid.shape) * robot.cell
    crossings = _CROSSINGS * across / max(robot.speed, _MIN_SPEED)
    return crossings if robot.searches else _MIN_SECONDS + crossings


def _why(robot: RobotState, moment: Context) -> str:
    if robot.objective_cell() is not None:
        if robot.failures >= MAX_FAILURES:
            return f"no way to it after {robot.failures} attempts"
        robot.stale += moment.dt
        if robot.stale > patience(robot):
            return f"seen, but not reached for {robot.stale:.0f} s"
        return ""
    if robot.searches > MAX_SEARCHES:
        return (
            "not found, though the robot has looked everywhere it could reach"
            f" {robot.searches} times"
        )
    _count_news(robot, moment)
    if robot.stale > patience(robot):
        return f"not found, and hardly anything new seen for {robot.stale:.0f} s"
    return ""


def _count_news(robot: RobotState, moment: Context) -> None:
    """Count the time, less what newly known and newly inspected cells pay for."""
    robot.stale += moment.dt
    if moment.number % COUNT_FRAMES:
        return
    known = np.count_nonzero(robot.grid != UNKNOWN) + np.count_nonzero(robot.grid >= SEEN)
    # Only more than ever before counts: an error may hide and show the same cell any number of
    # times.
    news = max(0, int(known) - robot.most_known) * robot.cell * robot.cell
    robot.stale = max(0.0, robot.stale - news * METRES_PER_NEWS / max(robot.speed, _MIN_SPEED))
    robot.most_known = max(robot.most_known, int(known))
