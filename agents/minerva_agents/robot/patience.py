"""When a robot gives up its objective.

The paper's robot searches forever: if its marker lies outside the walls, inside a pillar or does
not exist, or if no camera recognises it, the robot would drive until its battery is empty without
reporting a reason.

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

from typing import TYPE_CHECKING, Final

import numpy as np

from minerva_agents.robot import errand
from minerva_agents.robot.knowledge import SEEN, UNKNOWN
from minerva_agents.robot.vocabulary import eUnreachable
from minerva_bus import Context, portable

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

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


def begin_search(robot: ARobot) -> None:
    """Begin the first search for an objective, with full patience."""
    robot.failures = robot.searches = robot.most_known = 0
    robot.stale = 0.0
    robot.been = robot.dull = ()


def restart_search(robot: ARobot) -> None:
    """Begin another search for the same objective: its news pay for driving again."""
    robot.been = robot.dull = ()
    robot.searches += 1
    robot.most_known = 0
    robot.stale = 0.0


def patience(robot: ARobot) -> float:
    """Seconds without news, or without arriving at a marker that is known, before giving up.

    They are ten crossings of the grid, in the first search five minutes more.

    A repeated search inspects single cells. Where a wall lies between two rows of cells, the laser
    shows them as obstacles and as free by turns, so there is always one to inspect.
    """
    across = portable.hypot(*robot.grid.shape) * robot.cell
    crossings = _CROSSINGS * across / max(robot.speed, _MIN_SPEED)
    return crossings if robot.searches else _MIN_SECONDS + crossings


def _why(robot: ARobot, moment: Context) -> str:
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


def _count_news(robot: ARobot, moment: Context) -> None:
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
