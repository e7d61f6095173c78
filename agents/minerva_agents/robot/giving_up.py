"""When a robot gives its objective up: it has looked everywhere, or sees nothing new.

The paper's robot searches for ever. One whose marker hangs outside the walls, stands in a pillar or
does not exist would drive until its battery is empty, and nobody would know why.
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
"""So often it begins a search again that has come to its end."""

FAILURES: Final = 12
"""So many attempts in a row to find a way to a marker that it has seen."""

_COUNTED_EVERY: Final = 20
"""Frames from one count of what it knows to the next."""

_LEAST_SECONDS: Final = 300.0
_CROSSINGS: Final = 10.0
"""It searches without news for five minutes, and for as long as it drives ten times across."""


def gives_up(robot: ARobot, moment: Context) -> bool:
    """Give the objective up, and say why, if there is no hope left; the robot has none then."""
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
    """Note for how long it has neither learnt of a cell nor looked at one, in more than ever."""
    robot.stale += moment.dt
    if moment.number % _COUNTED_EVERY:
        return
    known = np.count_nonzero(robot.grid != UNKNOWN) + np.count_nonzero(robot.grid >= SEEN)
    if known > robot.most_known:
        robot.most_known, robot.stale = int(known), 0.0


def _patience(robot: ARobot) -> float:
    across = portable.hypot(*robot.grid.shape) * robot.cell
    return _LEAST_SECONDS + _CROSSINGS * across / max(robot.speed, 0.01)
