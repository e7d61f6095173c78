"""When a robot gives up its objective: everything searched, or nothing new observed.

The paper's robot searches forever. If its marker lies outside the walls, inside a pillar or does
not exist, it would drive until its battery is empty without reporting a reason.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from minerva_agents.robot import errand
from minerva_agents.robot.knowledge import SEEN, UNKNOWN
from minerva_agents.robot.vocabulary import eUnreachable
from minerva_bus import Context, portable

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

SEARCHES: Final = 2
"""Number of restarts of an exhausted search."""

FAILURES: Final = 12
"""Consecutive failed attempts to plan a path to a known marker."""

_COUNTED_EVERY: Final = 20
"""Frames between two counts of known cells."""

_LEAST_SECONDS: Final = 300.0
_CROSSINGS: Final = 10.0
"""Time without news before giving up: five minutes, plus ten crossings of the grid."""


def gives_up(robot: ARobot, moment: Context) -> bool:
    """Give up the objective, report why and clear it, if there is no prospect left."""
    why = _why(robot, moment)
    if not why:
        return False
    if robot.target:
        errand.give_up(robot, why, moment)
    else:
        moment.emit(eUnreachable(robot.objective, why))
        robot.seek("")
    return True


def _why(robot: ARobot, moment: Context) -> str:
    if robot.objective_cell() is not None:
        robot.stale = 0.0
        return f"no way to it after {robot.failures} attempts" if robot.failures >= FAILURES else ""
    if robot.searches > SEARCHES:
        return f"not found, though the robot has looked everywhere {robot.searches} times"
    _count_news(robot, moment)
    if robot.stale > _patience(robot):
        return f"not found, and nothing new seen for {robot.stale:.0f} s"
    return ""


def _count_news(robot: ARobot, moment: Context) -> None:
    """Update the time since the number of known or inspected cells last grew."""
    robot.stale += moment.dt
    if moment.number % _COUNTED_EVERY:
        return
    known = np.count_nonzero(robot.grid != UNKNOWN) + np.count_nonzero(robot.grid >= SEEN)
    if known > robot.most_known:
        robot.most_known, robot.stale = int(known), 0.0


def _patience(robot: ARobot) -> float:
    across = portable.hypot(*robot.grid.shape) * robot.cell
    return _LEAST_SECONDS + _CROSSINGS * across / max(robot.speed, 0.01)
