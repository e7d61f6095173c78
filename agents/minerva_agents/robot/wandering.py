"""The random planner: straight in random directions until the marker is in sight.

The paper's first algorithm (4.2.5). It plans nothing: the robot notices obstacles when it meets
them, and drives to its objective once a straight path is clear.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from minerva_agents.robot.arriving import APPROACH, STOP
from minerva_agents.robot.following import is_open, step
from minerva_agents.robot.ground import is_clear
from minerva_agents.robot.knowledge import holds
from minerva_agents.robot.motion import Move, Position, at_distance, cell_of, centre_of
from minerva_bus import Context, portable

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

WANDER: Final = "wander"

# Length of a straight path in metres.
_MIN_LEG: Final = 0.3
_MAX_LEG: Final = 6.0
_MAX_TRIES: Final = 12


def wander(robot: ARobot, moment: Context) -> Move:
    """Next move of a robot that wanders."""
    if not _go_straight_there(robot) and not is_open(robot):
        robot.forget_plan()
        way = _random_way(robot, moment)
        if way is not None:
            robot.set_way([way], WANDER)
    return step(robot, moment.dt)


def _go_straight_there(robot: ARobot) -> bool:
    """Follow the straight path to the marker if it is clear; True while the robot is on it."""
    place = robot.objective_cell()
    if place is None:
        return False
    if robot.purpose == APPROACH and is_open(robot):
        return True
    marker = centre_of(place)
    part = 1.0 - STOP / (portable.dist(marker, robot.position) * robot.cell)
    # Closer than STOP already, so the path would lead backwards.
    if part <= 0.0:
        return False
    row, column = robot.position
    end = row + part * (marker[0] - row), column + part * (marker[1] - column)
    if not is_clear(robot.grid, (robot.position, end), robot.room):
        return False
    robot.set_way([end], APPROACH)
    return True


def _random_way(robot: ARobot, moment: Context) -> Position | None:
    """The end of a random straight path, or None if no free one was drawn.

    Draws a length, then headings until that length is free; halves the length after `_MAX_TRIES`
    failures.
    """
    length = float(moment.random.uniform(_MIN_LEG, _MAX_LEG))
    while length >= _MIN_LEG:
        for heading in moment.random.uniform(-180.0, 180.0, _MAX_TRIES).tolist():
            end = at_distance(robot.row, robot.column, heading, length / robot.cell)
            if holds(robot.grid, cell_of(end)) and is_clear(
                robot.grid, (robot.position, end), robot.room
            ):
                return end
        length /= 2
    return None
