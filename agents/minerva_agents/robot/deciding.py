"""How a robot decides what to do next: section 4.2.5.

The paper leaves the algorithm to the user and shows two: `random` (module `wandering`) and `astar`.
A third one is a function in `PLANNERS`. It finds the robot, with all that it knows, at the place
where the next move begins, and returns that move; it may leave a plan in the robot's state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from minerva_agents.robot import astar, errand, wandering
from minerva_agents.robot.arriving import MAKE_WAY, has_arrived, make_way
from minerva_agents.robot.following import is_open, pass_corners, step
from minerva_agents.robot.giving_up import gives_up
from minerva_agents.robot.ground import cell_of
from minerva_agents.robot.knowledge import holds
from minerva_agents.robot.looking import look
from minerva_agents.robot.motion import STAY, Move
from minerva_agents.robot.vocabulary import eReached
from minerva_bus import Context

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

PLANNERS: Final[Mapping[str, Callable[[ARobot, Context], Move]]] = {
    "astar": astar.decide,
    "random": wandering.decide,
}


def notice(robot: ARobot) -> None:
    """Remember what the camera has had in view in this frame, while looking for the objective."""
    if robot.objective and robot.objective_cell() is None:
        look(robot.writable("grid"), robot.pose, robot.fov, robot.sight / robot.cell)


def decide(robot: ARobot, moment: Context) -> Move:
    """The robot's next move; at its objective it says so, once, and has none any more.

    On an errand it does there what the errand asks for. A robot that gives its objective up stays.
    """
    if not holds(robot.grid, cell_of(robot.position)):
        robot.forget_plan()  # it has lost its way, and its map with it
        return STAY
    pass_corners(robot)
    if not robot.objective:
        return _stand_or_make_way(robot, moment.dt)
    place = robot.objective_cell()
    if place is not None and has_arrived(robot, place):
        if not errand.attend(robot, place, moment):
            moment.emit(eReached(robot.objective))
            robot.objective = ""
        if not robot.objective:
            make_way(robot, place)
        return STAY
    if robot.speed <= 0 or gives_up(robot, moment):
        return STAY
    return PLANNERS[robot.planner](robot, moment)


def _stand_or_make_way(robot: ARobot, dt: float) -> Move:
    if robot.purpose != MAKE_WAY or not is_open(robot):
        if robot.plan_rows:
            robot.forget_plan()
        return STAY
    return step(robot, dt)
