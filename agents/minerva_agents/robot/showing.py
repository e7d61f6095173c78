"""Parts of a robot's picture: its path, and its objective."""

from __future__ import annotations

from typing import TYPE_CHECKING

from minerva_agents.robot.motion import centre_of
from minerva_agents.robot.vocabulary import PGoal, PObjective, PPath, TPlace
from minerva_bus import EMPTY, Scene

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot


def way_shown(robot: ARobot) -> Scene:
    """The path from the robot's position over the remaining corners; empty without a path."""
    if not robot.plan_rows:
        return EMPTY
    points = [robot.metres(position) for position in (robot.position, *robot.way)]
    return PPath(tuple([x for x, _ in points]), tuple([y for _, y in points]))


def goal_shown(robot: ARobot) -> Scene:
    """The objective's name, and its place if it is known; empty without an objective."""
    if not robot.objective:
        return EMPTY
    marked, place = PObjective(robot.objective), robot.objective_cell()
    if place is None:
        return marked
    return marked + TPlace(*robot.metres(centre_of(place)))(PGoal())
