"""Decisions of a robot (section 4.2.5) and the registry of planners.

The paper leaves the algorithm open and gives two examples: `random` (module `wandering`) and
`astar`. To add another, register a function in `PLANNERS`. It is called with the robot at the
position where its next move begins, and returns that move; it may store a plan in the robot's
state.

A robot gives up an objective without prospect (see `patience`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from minerva_agents.robot import errand
from minerva_agents.robot.arriving import MAKE_WAY, has_arrived, make_way, make_way_again
from minerva_agents.robot.astar import search_and_approach
from minerva_agents.robot.following import is_open, pass_corners, step
from minerva_agents.robot.knowledge import holds
from minerva_agents.robot.looking import look
from minerva_agents.robot.motion import STAY, Move, cell_of
from minerva_agents.robot.patience import gives_up
from minerva_agents.robot.vocabulary import eReached
from minerva_agents.robot.wandering import wander
from minerva_bus import Context

if TYPE_CHECKING:
    from minerva_agents.robot.robot import ARobot

PLANNERS: Final[Mapping[str, Callable[[ARobot, Context], Move]]] = {
    "astar": search_and_approach,
    "random": wander,
}


def notice(robot: ARobot) -> None:
    """Record what the camera sees in this frame while the robot searches for its objective."""
    if robot.objective and robot.objective_cell() is None:
        look(robot.writable("grid"), robot.pose, robot.fov, robot.sight / robot.cell)


def next_move(robot: ARobot, moment: Context) -> Move:
    """The robot's next move.

    At the objective it emits eReached once and clears the objective; on an errand it performs the
    errand's step instead. A robot that gives up its objective stops.
    """
    if not holds(robot.grid, cell_of(robot.position)):
        robot.forget_plan()  # off its own map: no plan can be valid
        if robot.objective and robot.speed > 0:
            gives_up(robot, moment)
        return STAY
    pass_corners(robot)
    if not robot.objective:
        return _stand_or_make_way(robot, moment.dt)
    place = robot.objective_cell()
    if place is not None and has_arrived(robot, place):
        if not errand.attend(robot, place, moment):
            moment.emit(eReached(robot.objective))
            robot.objective, robot.stale = "", 0.0
        # On an errand, the robot has the next stop as its objective and leaves anyway.
        if not robot.objective:
            make_way(robot, place)
        return STAY
    # Time in which the robot is stopped does not count as a search without news.
    if robot.speed <= 0 or gives_up(robot, moment):
        return STAY
    return PLANNERS[robot.planner](robot, moment)


def _stand_or_make_way(robot: ARobot, dt: float) -> Move:
    if robot.purpose == MAKE_WAY and robot.plan_rows and not is_open(robot):
        make_way_again(robot)
    if robot.purpose != MAKE_WAY or not is_open(robot):
        if robot.plan_rows:
            robot.forget_plan()
        return STAY
    return step(robot, dt)
