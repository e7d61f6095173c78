"""A planner of your own: the option `planner = "module:function"` of the robot's world.

The function gets what the robot knows and the moment, and returns the corners of a way, pairs of x
and y in metres; none to wait. It is called when the robot has an objective but no way, or when its
way has ended or an obstacle has come into view. The robot drives along the way, and has arrived
when it is at the marker. See docs/howto/planner.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from minerva_agents.robot.approach import is_open, step
from minerva_agents.robot.clearance import is_clear
from minerva_agents.robot.grid import UNKNOWN, holds
from minerva_agents.robot.pose import STAY, Move, Position, cell_of, centre_of
from minerva_bus import Context
from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.launch.specs import load

if TYPE_CHECKING:
    from minerva_agents.robot.state import RobotState

Way: TypeAlias = Iterable[tuple[float, float]]


class Knowledge:
    """What a robot knows; lengths are in metres of the world.

    Attributes:
        x, y: its position.
        angle: its heading in degrees, counter-clockwise from the x axis.
        objective: the name of the marker to find.
        place: the position of that marker; None while it has not been seen.

    """

    def __init__(self, robot: RobotState) -> None:
        self._robot = robot
        self.x, self.y = robot.metres(robot.position)
        self.angle = robot.angle
        self.objective = robot.objective
        cell = robot.objective_cell()
        self.place: Position | None = None if cell is None else robot.metres(centre_of(cell))

    def seen(self, x: float, y: float) -> bool:
        """Whether the map has anything at a place; False outside of the map."""
        cell = cell_of(self._robot.in_cells(x, y))
        return holds(self._robot.grid, cell) and self._robot.grid[cell] != UNKNOWN

    def clear(self, x: float, y: float) -> bool:
        """Whether no known obstacle is too close to the straight line from the robot to there."""
        robot, end = self._robot, self._robot.in_cells(x, y)
        return holds(robot.grid, cell_of(end)) and is_clear(
            robot.grid, (robot.position, end), robot.room
        )

    def drive(self, way: Way, planner: str) -> None:
        """Set the robot's way. Raises MisuseError if it is none."""
        try:
            corners = [self._robot.in_cells(float(x), float(y)) for x, y in way]
            outside = [each for each in corners if not holds(self._robot.grid, cell_of(each))]
        except (TypeError, ValueError, OverflowError):  # cells of infinity and of no number
            raise MisuseError(
                f"the planner {planner} returned {way!r:.60}; expected corners in metres, such as"
                " [(2.0, 3.5)], or none to wait"
            ) from None
        if outside:
            x, y = self._robot.metres(outside[0])
            raise MisuseError(
                f"the planner {planner} returned the corner ({x:g}, {y:g}), in metres, which is not"
                " on the map"
            )
        self._robot.set_way(corners, planner)


@cache
def own_planner(spec: str) -> Callable[[Any, Context], Move]:
    """The planner of a `module:function`. Raises WorldFileError if there is none."""
    function = load(spec, Path.cwd())
    try:
        signature(function).bind(None, None)
    except TypeError as error:
        raise WorldFileError(
            f"the planner {spec}: {error}; it is called with (known, moment)"
        ) from None

    def next_move(robot: RobotState, moment: Context) -> Move:
        if not is_open(robot):
            robot.forget_plan()
            known = Knowledge(robot)
            known.drive(function(known, moment), spec)
        return step(robot, moment.dt) if is_open(robot) else STAY

    return next_move
