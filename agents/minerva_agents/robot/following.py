"""Path following: corner by corner, while the path stays clear."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from minerva_agents.robot.ground import is_clear
from minerva_agents.robot.motion import STAY, Move, towards
from minerva_agents.robot.narrows import is_passable
from minerva_bus import portable

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

# A corner at this distance, in cells, has been reached.
_TOLERANCE: Final = 1e-4


def pass_corners(robot: ARobot) -> None:
    """Drop the corners that the robot has reached."""
    way = robot.way
    while way and portable.dist(way[0], robot.position) < _TOLERANCE:
        way.pop(0)
    if len(way) != len(robot.plan_rows):
        robot.set_way(way, robot.purpose, robot.is_narrow)


def is_open(robot: ARobot) -> bool:
    """True if the robot has a path and no new obstacle blocks it."""
    way = (robot.position, *robot.way)
    if len(way) == 1:
        return False
    if robot.is_narrow:
        return is_passable(robot.grid, way, robot.radius, robot.cell)
    return is_clear(robot.grid, way, robot.room)


def step(robot: ARobot, dt: float) -> Move:
    """Next move along the path."""
    if not robot.plan_rows:
        return STAY
    corner = robot.plan_rows[0], robot.plan_columns[0]
    return towards(robot.pose, *corner, robot.cell, robot.speed * dt, dt)
