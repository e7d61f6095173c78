"""Decisions by A*: straight to the objective where it is known, else in search of it.

A plan is kept until it ends or is contradicted by something that has turned up, for most frames
need no new one. Where no way is found, mostly because another robot stands in it, the robot waits
for a random while, so that of two robots one moves first; if that does not help it steps aside.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from minerva_agents.robot.arriving import APPROACH, NEAR, PATIENCE, good_places, is_near
from minerva_agents.robot.following import is_open, step
from minerva_agents.robot.ground import (
    blocked,
    cell_of,
    centre_of,
    straightened,
)
from minerva_agents.robot.knowledge import Cell, Mask, doubt
from minerva_agents.robot.looking import forget_looks, is_news
from minerva_agents.robot.motion import STAY, Move
from minerva_agents.robot.planning import Path, nearest, shortest_path
from minerva_agents.robot.searching import path_to_news
from minerva_bus import Moment, portable

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

SEARCH: Final = "search"
ASIDE: Final = "aside"


def decide(robot: ARobot, moment: Moment) -> Move:
    """The next move on the way to the objective, or in search of it."""
    if robot.pause > 0:
        robot.pause -= 1
        return STAY
    place = robot.objective_cell()
    if not (_holds_good(robot, place) and is_open(robot)):
        robot.forget_plan()
        _make_plan(robot, place, moment)
    return step(robot, moment.dt)


def _holds_good(robot: ARobot, place: Cell | None) -> bool:
    """Whether the way still leads where the robot wants to go."""
    if not robot.plan_rows:
        return False
    if robot.purpose == ASIDE:
        return True
    if robot.purpose not in (APPROACH, SEARCH):
        return False
    end = robot.plan_rows[-1], robot.plan_columns[-1]
    if robot.purpose == APPROACH:
        return place is not None and portable.dist(end, centre_of(place)) * robot.cell <= NEAR
    return place is None and is_news(robot.grid, cell_of(end))


def _make_plan(robot: ARobot, place: Cell | None, moment: Moment) -> None:
    closed = blocked(robot.grid, robot.position, robot.room)
    here = cell_of(robot.position)
    if place is not None:
        path, purpose = _path_to(robot, closed, here, place), APPROACH
    else:
        path, purpose = path_to_news(robot.grid, closed, robot.pose, robot.cell), SEARCH
    if path is not None:
        robot.set_way(straightened(robot.grid, robot.position, path.cells, robot.room), purpose)
    if is_open(robot):
        robot.failures = 0
    elif place is not None and is_near(robot, place):
        robot.set_way([], APPROACH)  # the way ends here
    else:
        _do_without(robot, closed, here, moment)


def _path_to(robot: ARobot, closed: Mask, here: Cell, place: Cell) -> Path | None:
    if not closed[place]:
        path = shortest_path(closed, here, place)
        if path is not None:
            return path
    paths = (nearest(closed, here, targets) for targets in good_places(robot, place))
    return next((path for path in paths if path is not None), None)


def _do_without(robot: ARobot, closed: Mask, here: Cell, moment: Moment) -> None:
    """There is no way: wait for a while, step aside, or begin the search again."""
    robot.forget_plan()
    robot.failures += 1
    doubt(robot.writable("grid"))
    robot.pause = int(moment.random.integers(3, 12)) * min(robot.failures, 10)
    if robot.failures % PATIENCE:
        return
    if robot.objective_cell() is None:
        forget_looks(robot.writable("grid"))
        robot.searches += 1
    path = _path_aside(robot, closed, here, moment)
    if path is not None:
        robot.pause = 0
        robot.set_way(straightened(robot.grid, robot.position, path.cells, robot.room), ASIDE)


def _path_aside(robot: ARobot, closed: Mask, here: Cell, moment: Moment) -> Path | None:
    """A path to a random place about a metre or two away."""
    rows, columns = np.ogrid[: closed.shape[0], : closed.shape[1]]
    squares = (rows - here[0]) ** 2 + (columns - here[1]) ** 2
    least, most = 1.0 / robot.cell, 2.0 / robot.cell
    ring = np.argwhere(~closed & (squares >= least * least) & (squares <= most * most))
    if not len(ring):
        return None
    row, column = ring[int(moment.random.integers(len(ring)))].tolist()
    return shortest_path(closed, here, (row, column))
