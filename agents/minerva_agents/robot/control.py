"""Decisions of a robot (section 4.2.5) and the registry of planners.

The paper leaves the algorithm open and gives two examples: `random` and `astar`. A function of
`PLANNERS` is called with the robot at the position where its next move begins, and returns that
move; it may store a plan in the robot's state. `own_planner` is for functions of users.

`astar` drives to a known objective, otherwise searches for it, from one viewpoint to the next (see
`exploration`). Viewpoints already visited and turns that revealed nothing are not chosen again;
when no candidate is left, the search starts over and is thorough from then on. A plan is kept until
it ends or a new observation contradicts it, so most frames need no planning. If no path exists, the
planner tries paths with minimal clearance (see `clearance.Narrows`). If that fails too, usually
because another robot is in the way, the robot waits for a random time, which breaks the symmetry
between two robots, and then steps aside.

`random`, the paper's first algorithm, drives straight in random directions until the marker is in
sight. It plans nothing: the robot notices obstacles when it meets them, and drives to its objective
once a straight path is clear.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from minerva_agents.robot import errands
from minerva_agents.robot.approach import (
    APPROACH,
    MAKE_WAY,
    NEAR,
    RELAX_FAILURES,
    STOP,
    gives_up,
    good_places,
    has_arrived,
    is_near,
    is_open,
    make_way,
    make_way_again,
    pass_corners,
    restart_search,
    step,
)
from minerva_agents.robot.clearance import Narrows, blocked, is_clear, straightened
from minerva_agents.robot.exploration import Goal, SearchState, news_ahead, news_at, next_goal
from minerva_agents.robot.grid import UNKNOWN, Mask, doubt, forget_looks, holds, look, reopen
from minerva_agents.robot.own_planner import own_planner
from minerva_agents.robot.planning import GridPath, nearest, shortest_path
from minerva_agents.robot.pose import (
    STAY,
    Cell,
    Move,
    Position,
    at_distance,
    cell_of,
    centre_of,
    turn_to,
    wrapped,
)
from minerva_agents.robot.state import RobotState
from minerva_agents.robot.vocabulary import eReached
from minerva_bus import Context, portable


def notice(robot: RobotState) -> None:
    """Record what the camera sees in this frame while the robot searches for its objective."""
    if robot.objective and robot.objective_cell() is None:
        look(robot.writable("grid"), robot.pose, robot.fov, robot.sight / robot.cell)


def next_move(robot: RobotState, moment: Context) -> Move:
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
        if not errands.attend(robot, place, moment):
            moment.emit(eReached(robot.objective))
            robot.objective, robot.stale = "", 0.0
        # On an errand, the robot has the next stop as its objective and leaves anyway.
        if not robot.objective:
            make_way(robot, place)
        return STAY
    # Time in which the robot is stopped does not count as a search without news.
    if robot.speed <= 0 or gives_up(robot, moment):
        return STAY
    own = ":" in robot.planner
    return (own_planner(robot.planner) if own else PLANNERS[robot.planner])(robot, moment)


def _stand_or_make_way(robot: RobotState, dt: float) -> Move:
    if robot.purpose == MAKE_WAY and robot.plan_rows and not is_open(robot):
        make_way_again(robot)
    if robot.purpose != MAKE_WAY or not is_open(robot):
        if robot.plan_rows:
            robot.forget_plan()
        return STAY
    return step(robot, dt)


# --- the planner astar ----------------------------------------------------------------------------


SEARCH: Final = "search"
LOOK: Final = "look"
ASIDE: Final = "aside"

_REVIEW: Final = 5
"""Frames between checks that the current viewpoint is still worth reaching."""

_FACING: Final = 0.01
"""Heading tolerance for a look, in degrees."""


def search_and_approach(
    robot: RobotState, moment: Context, choose: Callable[[SearchState], Goal | None] = next_goal
) -> Move:
    """Next move towards the objective or in search of it; `choose` selects the next viewpoint."""
    if robot.pause > 0:
        robot.pause -= 1
        return STAY
    place = robot.objective_cell()
    if place is None:
        _record_look(robot)
    if not _holds_good(robot, place, moment):
        robot.forget_plan()
        _make_plan(robot, place, moment, choose)
    if robot.purpose == LOOK:
        return turn_to(robot.pose, robot.heading, moment.dt)
    return step(robot, moment.dt)


def _record_look(robot: RobotState) -> None:
    """Record the outcome of a finished look, or of the path to one."""
    if robot.plan_rows or robot.purpose not in (SEARCH, LOOK):
        return
    cell = cell_of(robot.position)
    number = cell[0] * robot.grid.shape[1] + cell[1]
    if robot.purpose == SEARCH:
        robot.been = (*robot.been, number)
    elif abs(wrapped(robot.heading - robot.angle)) > _FACING:
        return
    # More than half of what the turn promised is still news, so it cannot be seen from here and
    # another turn would reveal nothing, either.
    elif news_ahead(_search_state(robot), cell, robot.heading) > robot.news / 2:
        robot.dull = (*robot.dull, number)
    robot.forget_plan()


def _holds_good(robot: RobotState, place: Cell | None, moment: Context) -> bool:
    """True if the plan still leads to the goal and its path is clear."""
    if robot.purpose == LOOK:
        # A turn needs no clear path, and ends as soon as the marker has been seen.
        return place is None
    if not is_open(robot):
        return False
    if robot.purpose == ASIDE:
        return True
    end = robot.plan_rows[-1], robot.plan_columns[-1]
    # A marker that has been observed again may have moved to another cell.
    if robot.purpose == APPROACH:
        return place is not None and portable.dist(end, centre_of(place)) * robot.cell <= NEAR
    # A search ends as soon as the marker has been seen.
    if robot.purpose != SEARCH or place is not None:
        return False
    is_due = moment.number % _REVIEW == 0
    # Once half of what the viewpoint promised has been seen on the way, another may be better.
    return not is_due or news_at(_search_state(robot), cell_of(end)) >= robot.news / 2


def _make_plan(
    robot: RobotState,
    place: Cell | None,
    moment: Context,
    choose: Callable[[SearchState], Goal | None],
) -> None:
    closed = blocked(robot.grid, robot.position, robot.room)
    here = cell_of(robot.position)
    if place is None:
        is_made = _plan_look(robot, choose(replace(_search_state(robot), closed=closed)))
    else:
        is_made = _plan_approach(robot, closed, here, place)
    if is_made:
        robot.failures = 0
        return
    # Half cells make a plan four times as large, so they are the second choice.
    narrows = Narrows.around(robot.grid, robot.position, robot.radius, robot.cell)
    goal = None
    if place is None:
        goal = choose(replace(_search_state(robot), closed=narrows.closed_cells))
        is_made = _plan_narrow_look(robot, narrows, goal)
    else:
        is_made = _plan_narrow_approach(robot, narrows, place)
    if is_made:
        robot.failures = 0
    elif place is not None and is_near(robot, place):
        robot.set_way([], APPROACH)  # the path ends here
    else:
        _recover(robot, closed, here, goal, moment)


def _plan_look(robot: RobotState, goal: Goal | None) -> bool:
    """Plan to drive or turn to the next viewpoint; False if there is none."""
    if goal is None:
        return False
    robot.news = goal.news
    if goal.cells:
        return _set_out(robot, goal.cells, SEARCH)
    robot.set_way([], LOOK)
    robot.heading = goal.heading
    return True


def _plan_approach(robot: RobotState, closed: Mask, here: Cell, place: Cell) -> bool:
    path = _path_to(robot, closed, here, place)
    return path is not None and _set_out(robot, path.cells, APPROACH)


def _plan_narrow_approach(robot: RobotState, narrows: Narrows, place: Cell) -> bool:
    """Plan a path with minimal clearance to the objective."""
    ways = (narrows.way_to(targets) for targets in good_places(robot, place))
    way = next((way for way in ways if way is not None), None)
    return way is not None and _go_along(robot, way, APPROACH, is_narrow=True)


def _plan_narrow_look(robot: RobotState, narrows: Narrows, goal: Goal | None) -> bool:
    """Plan a path with minimal clearance to the next viewpoint."""
    if goal is None or not goal.cells:
        return _plan_look(robot, goal)
    robot.news = goal.news
    # The search has planned over whole cells; only the destination of its path counts here.
    way = narrows.way_to_cell(goal.cells[-1])
    return way is not None and _go_along(robot, way, SEARCH, is_narrow=True)


def _set_out(robot: RobotState, cells: Sequence[Cell], purpose: str) -> bool:
    """Follow a path of cells; False if it is empty or blocked."""
    way = straightened(robot.grid, robot.position, cells, robot.room)
    return _go_along(robot, way, purpose)


def _go_along(
    robot: RobotState, way: list[Position], purpose: str, is_narrow: bool = False
) -> bool:
    """Follow a path of positions; False if it is empty or blocked."""
    robot.set_way(way, purpose, is_narrow)
    pass_corners(robot)
    return is_open(robot)


def _search_state(robot: RobotState) -> SearchState:
    """Input of the search; no cell is closed until the caller replaces `closed`."""
    wide = robot.grid.shape[1]
    return SearchState(
        robot.grid,
        # No code is below UNKNOWN: a mask without closed cells.
        robot.grid < UNKNOWN,
        robot.pose,
        robot.cell,
        robot.fov,
        robot.sight,
        [divmod(cell, wide) for cell in robot.been],
        [divmod(cell, wide) for cell in robot.dull],
        robot.searches > 0,
    )


def _path_to(robot: RobotState, closed: Mask, here: Cell, place: Cell) -> GridPath | None:
    # The marker's own cell if it can be reached, otherwise a cell from which it counts as reached.
    if not closed[place]:
        path = shortest_path(closed, here, place)
        if path is not None:
            return path
    paths = (nearest(closed, here, targets) for targets in good_places(robot, place))
    return next((path for path in paths if path is not None), None)


def _recover(
    robot: RobotState, closed: Mask, here: Cell, goal: Goal | None, moment: Context
) -> None:
    """Handle a failed plan: wait, step aside, drop the viewpoint `goal` or restart the search."""
    robot.forget_plan()
    robot.failures += 1
    # An obstacle that is no longer there may be what blocks all paths.
    doubt(robot.writable("grid"))
    # Random, so that two robots that block each other do not go on at the same time.
    robot.pause = int(moment.random.integers(3, 12)) * min(robot.failures, 10)
    if robot.failures % RELAX_FAILURES:
        return
    reopen(robot.writable("grid"))
    if robot.objective_cell() is None:
        if goal is not None:
            # The search is not exhausted: only this viewpoint has no path.
            row, column = goal.cells[-1]
            robot.been = (*robot.been, row * robot.grid.shape[1] + column)
        else:
            forget_looks(robot.writable("grid"))
            restart_search(robot)
    path = _path_aside(robot, closed, here, moment)
    if path is not None:
        robot.pause = 0
        _set_out(robot, path.cells, ASIDE)


def _path_aside(robot: RobotState, closed: Mask, here: Cell, moment: Context) -> GridPath | None:
    """A path to a random cell one to two metres away."""
    rows, columns = np.ogrid[: closed.shape[0], : closed.shape[1]]
    squares = (rows - here[0]) ** 2 + (columns - here[1]) ** 2
    least, most = 1.0 / robot.cell, 2.0 / robot.cell
    ring = np.argwhere(~closed & (squares >= least * least) & (squares <= most * most))
    if not len(ring):
        return None
    row, column = ring[int(moment.random.integers(len(ring)))].tolist()
    return shortest_path(closed, here, (row, column))


# --- the planner random ---------------------------------------------------------------------------


WANDER: Final = "wander"

# Length of a straight path in metres.
_MIN_LEG: Final = 0.3
_MAX_LEG: Final = 6.0
_MAX_TRIES: Final = 12


def wander(robot: RobotState, moment: Context) -> Move:
    """Next move of a robot that wanders."""
    if not _go_straight_there(robot) and not is_open(robot):
        robot.forget_plan()
        way = _random_way(robot, moment)
        if way is not None:
            robot.set_way([way], WANDER)
    return step(robot, moment.dt)


def _go_straight_there(robot: RobotState) -> bool:
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


def _random_way(robot: RobotState, moment: Context) -> Position | None:
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


PLANNERS: Final[Mapping[str, Callable[[RobotState, Context], Move]]] = {
    "astar": search_and_approach,
    "random": wander,
}
