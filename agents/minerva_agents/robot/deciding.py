"""Decisions of a robot (section 4.2.5) and the registry of planners.

The paper leaves the algorithm open and gives two examples: `random` (module `wandering`) and
`astar`. To add another, register a function in `PLANNERS`. It is called with the robot at the
position where its next move begins, and returns that move; it may store a plan in the robot's
state.

A robot gives up its objective once everything is searched or nothing new is observed. The paper's
robot searches forever: if its marker lies outside the walls, inside a pillar or does not exist, it
would drive until its battery is empty without reporting a reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from minerva_agents.robot import astar, errand, wandering
from minerva_agents.robot.arriving import MAKE_WAY, has_arrived, make_way
from minerva_agents.robot.following import is_open, pass_corners, step
from minerva_agents.robot.ground import cell_of
from minerva_agents.robot.knowledge import holds
from minerva_agents.robot.looking import look
from minerva_agents.robot.motion import STAY, Move
from minerva_agents.robot.vocabulary import eReached
from minerva_bus import Context

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot


from typing import TYPE_CHECKING

import numpy as np

from minerva_agents.robot.knowledge import SEEN, UNKNOWN
from minerva_agents.robot.vocabulary import eUnreachable
from minerva_bus import portable

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot


MAX_SEARCHES: Final = 2
"""Number of restarts of an exhausted search."""

MAX_FAILURES: Final = 12
"""Consecutive failed attempts to plan a path to a known marker."""

_COUNT_FRAMES: Final = 20
"""Frames between two counts of known cells."""

_MIN_SECONDS: Final = 300.0
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
        # The marker has been seen; from here on, only failed attempts to reach it count.
        robot.stale = 0.0
        return (
            f"no way to it after {robot.failures} attempts"
            if robot.failures >= MAX_FAILURES
            else ""
        )
    if robot.searches > MAX_SEARCHES:
        return f"not found, though the robot has looked everywhere {robot.searches} times"
    _count_news(robot, moment)
    if robot.stale > _patience(robot):
        return f"not found, and nothing new seen for {robot.stale:.0f} s"
    return ""


def _count_news(robot: ARobot, moment: Context) -> None:
    """Update the time since the number of known or inspected cells last grew."""
    robot.stale += moment.dt
    if moment.number % _COUNT_FRAMES:
        return
    known = np.count_nonzero(robot.grid != UNKNOWN) + np.count_nonzero(robot.grid >= SEEN)
    if known > robot.most_known:
        robot.most_known, robot.stale = int(known), 0.0


def _patience(robot: ARobot) -> float:
    across = portable.hypot(*robot.grid.shape) * robot.cell
    return _MIN_SECONDS + _CROSSINGS * across / max(robot.speed, 0.01)


PLANNERS: Final[Mapping[str, Callable[[ARobot, Context], Move]]] = {
    "astar": astar.decide,
    "random": wandering.decide,
}


def notice(robot: ARobot) -> None:
    """Record what the camera sees in this frame while the robot searches for its objective."""
    if robot.objective and robot.objective_cell() is None:
        look(robot.writable("grid"), robot.pose, robot.fov, robot.sight / robot.cell)


def decide(robot: ARobot, moment: Context) -> Move:
    """The robot's next move.

    At the objective it emits eReached once and clears the objective; on an errand it performs the
    errand's step instead. A robot that gives up its objective stops.
    """
    if not holds(robot.grid, cell_of(robot.position)):
        robot.forget_plan()  # off its own map: no plan can be valid
        return STAY
    pass_corners(robot)
    if not robot.objective:
        return _stand_or_make_way(robot, moment.dt)
    place = robot.objective_cell()
    if place is not None and has_arrived(robot, place):
        if not errand.attend(robot, place, moment):
            moment.emit(eReached(robot.objective))
            robot.objective = ""
        # On an errand, the robot has the next stop as its objective and leaves anyway.
        if not robot.objective:
            make_way(robot, place)
        return STAY
    # Time in which the robot is stopped does not count as a search without news.
    if robot.speed <= 0 or gives_up(robot, moment):
        return STAY
    return PLANNERS[robot.planner](robot, moment)


def _stand_or_make_way(robot: ARobot, dt: float) -> Move:
    if robot.purpose != MAKE_WAY or not is_open(robot):
        if robot.plan_rows:
            robot.forget_plan()
        return STAY
    return step(robot, dt)
