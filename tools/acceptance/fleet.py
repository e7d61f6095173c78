"""Robots on a grid that go to their goals without collisions.

The robots are agents: each has a cell, a goal, and the number of frames since it last was there.
`Control` is a traffic control that all of them obey: it perceives their view, and computes the next
cell of each by priority inheritance with backtracking (PIBT), with the exchange of two robots in a
corridor. A view shows the frame before, so it remembers where it has sent them since.

Keisuke Okumura, Manao Machida, Xavier Défago, Yasumasa Tamura (2022): Priority inheritance with
backtracking for iterative multi-agent path finding. Artificial Intelligence 310.
Keisuke Okumura (2023): Improving LaCAM for scalable eventually optimal multi-agent pathfinding.
IJCAI (the exchange).
"""

# numba has no types of its own.
# pyright: basic

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from minerva_bus import (
    Agent,
    Device,
    Event,
    EventType,
    Generator,
    Primitive,
    Scene,
    Tick,
    View,
    World,
    on,
    service,
    view,
)
from minerva_services.physics.neighbours.spots import Names, SpotReader, Spots

Ints = NDArray[Any]
NOBODY, NOWHERE, UNREACHABLE = -1, -1, 30_000
PATIENCE, SHAKEN = 64, 0.1
"""A robot that is later than this number of frames is restless in this part of them."""

PRobot = Primitive("PRobot", who=str, x=int, y=int, goal_x=int, goal_y=int, late=int)
eWhere = EventType("eWhere", visual=True)
eMove = EventType("eMove", x=int, y=int)


class Robot(Agent, symbol="ARobot"):
    """Goes where the traffic control sends it.

    `late` is one more after a frame away from the goal, and one less after a frame there: a robot
    that others have driven from its goal does not lose its right of way when it is back.
    """

    x: int
    y: int
    goal_x: int
    goal_y: int
    late: int = 0

    @on("eMove", population=True)
    def move(self, move: Event, moment: Any) -> None:
        self.x, self.y = move.x, move.y
        away = (self.x != self.goal_x) | (self.y != self.goal_y)
        self.late = np.where(away, self.late + 1, np.maximum(self.late - 1, 0))

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return PRobot(self.id, self.x, self.y, self.goal_x, self.goal_y, self.late)


class Control(
    Device, Generator, events=("eMove",), draws=("eWhere",), coupled=True, when="each frame"
):
    """Sends each robot to its next cell.

    Args:
        rows: the map, with "." and "G" for free cells.

    """

    def __init__(self, rows: list[str]) -> None:
        self.reader = SpotReader("control", Names())
        self.robots: Spots | None = None
        free = np.array([[cell in ".G" for cell in row] for row in rows])
        self.y, self.x = free.nonzero()
        self.number = np.full(free.shape, NOWHERE)
        self.number[free] = np.arange(len(self.x))
        wide = np.pad(self.number, 1, constant_values=NOWHERE)
        sides = wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]
        self.beside = np.stack([side[free] for side in sides], axis=1)
        self.goals, self.ways = np.empty(0, int), np.empty((0, 0), np.int16)
        self.sent = np.empty(0, int)

    def lengths(self, starts: Ints, goals: Ints) -> Ints:
        """Lengths of the shortest paths between pairs of positions, each of shape (n, 2)."""
        at, to = (self.number[places[:, 1], places[:, 0]] for places in (starts, goals))
        return ways(to, self.beside)[np.arange(len(at)), at]

    def show(self, view: View) -> None:
        self.robots = self.reader.read(view.scene)

    def generate(self, tick: Tick) -> Iterator[Event]:
        robots = self.robots
        if robots is None:
            return
        goals = self.number[robots.shown["goal_y"], robots.shown["goal_x"]]
        if not np.array_equal(goals, self.goals):
            self.goals, self.ways = goals, ways(goals, self.beside)
        late = robots.shown["late"]
        at = self.sent if len(self.sent) else self.number[robots.y, robots.x]
        chance = tick.random.random((len(at), 5))
        # Those that wait longest come first; of these, those of the largest random number.
        order = np.lexsort((-chance[:, 4], -late))
        now, then = np.full((2, len(self.x)), NOBODY)
        now[at] = np.arange(len(at))
        target = np.full(len(at), NOWHERE)
        grid = Grid(at, goals, late, chance, self.ways, self.beside, now, then, target)
        self.sent = next_cells(order, grid)
        yield eMove(x=self.x[self.sent], y=self.y[self.sent], receivers=robots.ids)

    def save(self) -> Mapping[str, Any]:
        return {"sent": self.sent.tolist()}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.sent = np.array(saved["sent"], int)


class Grid(NamedTuple):
    """A frame of the robots; cells are numbers.

    Attributes:
        at: cells where robots are.
        goals: cells where they go.
        late: see `Robot`.
        chance: random numbers that decide between cells of the same distance, shape (robots, 5).
        ways: lengths of paths to each goal, shape (robots, cells).
        beside: the four cells beside each cell, or NOWHERE.
        now: the robot in each cell, or NOBODY.
        then: the robot that will be there, or NOBODY.
        target: the next cell of each robot, or NOWHERE.

    """

    at: Ints
    goals: Ints
    late: Ints
    chance: NDArray[Any]
    ways: Ints
    beside: Ints
    now: Ints
    then: Ints
    target: Ints


def world(rows: list[str], starts: Ints, goals: Ints) -> World:
    """The world of robots on a map, with their positions and goals, arrays of shape (n, 2)."""
    (x, y), (goal_x, goal_y) = starts.T, goals.T
    robots = Robot.many("r", len(starts), x=x, y=y, goal_x=goal_x, goal_y=goal_y)
    return World(robots, services=[service(Control, rows=rows)], name="fleet")


@njit(cache=True)
def ways(goals: Ints, beside: Ints) -> Ints:
    """Lengths of the shortest paths to each goal, shape (goals, cells)."""
    result = np.full((len(goals), len(beside)), UNREACHABLE, np.int16)
    queue = np.empty(len(beside), np.int32)
    for robot in range(len(goals)):
        way = result[robot]
        queue[0], known, way[goals[robot]] = goals[robot], 1, 0
        for place in range(len(beside)):
            if place == known:
                break
            cell = queue[place]
            for other in beside[cell]:
                if other != NOWHERE and way[other] == UNREACHABLE:
                    way[other] = way[cell] + 1
                    queue[known] = other
                    known += 1
    return result


@njit(cache=True)
def next_cells(order: Ints, grid: Grid) -> Ints:
    """The next cell of each robot: no two have the same one, and no two change places.

    Args:
        order: robots, with the first in the right of way first.
        grid: the frame, with `then` and `target` empty.

    """
    for robot in order:
        if grid.target[robot] == NOWHERE:
            decide(robot, grid)
    return grid.target


@njit(cache=True)
def decide(robot: int, grid: Grid) -> bool:
    """Choose the next cell of a robot; whether it need not stay for want of another one.

    A robot that is in the chosen cell decides next, and inherits the right of way.
    """
    here, way, chance, now = grid.at[robot], grid.ways[robot], grid.chance[robot], grid.now
    # Groups that block each other for long come loose if one of them now and then goes anywhere.
    restless = grid.late[robot] > PATIENCE and chance[4] < SHAKEN
    cells, cost = np.empty(5, np.int64), np.empty(5)
    count = 0
    for side in range(5):
        cell = here if side == 4 else grid.beside[here, side]
        if cell == NOWHERE:
            continue
        price = chance[side]
        if not restless:
            # An occupied cell only if no free one is as near.
            occupied = now[cell] != NOBODY and cell != here
            price = way[cell] + 0.5 * occupied + 0.4 * price
        place = count
        while place > 0 and cost[place - 1] > price:
            cells[place], cost[place] = cells[place - 1], cost[place - 1]
            place -= 1
        cells[place], cost[place] = cell, price
        count += 1
    partner = exchange(robot, cells[0], grid)
    for place in range(count):
        cell = cells[place] if partner == NOBODY else cells[count - 1 - place]
        other = now[cell]
        if grid.then[cell] != NOBODY or (other != NOBODY and grid.target[other] == here):
            continue
        grid.then[cell], grid.target[robot] = robot, cell
        asks = other != NOBODY and other != robot and grid.target[other] == NOWHERE
        if asks and not decide(other, grid):
            continue
        follows = place == 0 and partner != NOBODY and grid.target[partner] == NOWHERE
        if follows and grid.then[here] == NOBODY:
            grid.then[here], grid.target[partner] = partner, here
        return True
    grid.then[here], grid.target[robot] = robot, here
    return False


@njit(cache=True)
def exchange(robot: int, best: int, grid: Grid) -> int:
    """The robot with which this one must change places, so that it draws back; or NOBODY."""
    here, now = grid.at[robot], grid.now
    if best == here or not has_room(best, here, grid):
        return NOBODY
    other = now[best]
    undecided = other != NOBODY and grid.target[other] == NOWHERE
    if undecided and wants_past(robot, other, here, best, grid):
        return other
    for cell in grid.beside[here]:
        follower = NOBODY if cell in (NOWHERE, best) else now[cell]
        if follower != NOBODY and wants_past(follower, robot, here, best, grid):
            return follower
    return NOBODY


@njit(cache=True)
def wants_past(pusher: int, puller: int, behind: int, cell: int, grid: Grid) -> bool:
    """Whether two robots in a corridor want to pass each other: `pusher` follows `puller`."""
    towards, away = grid.ways[pusher], grid.ways[puller]
    while towards[cell] < towards[behind]:
        count, out = onward(behind, cell, grid)
        if count >= 2:
            return False
        if count == 0:
            break
        behind, cell = cell, out
    meets = towards[behind] == 0 or towards[cell] < towards[behind]
    return meets and away[behind] < away[cell]


@njit(cache=True)
def has_room(start: int, cell: int, grid: Grid) -> bool:
    """Whether a robot that draws back from `start` by `cell` comes where it can be passed."""
    behind = start
    while cell != start:
        count, out = onward(behind, cell, grid)
        if count >= 2:
            return True
        if count == 0:
            return False
        behind, cell = cell, out
    return False


@njit(cache=True)
def onward(behind: int, cell: int, grid: Grid) -> tuple[int, int]:
    """Number of ways out of a cell without that to `behind`, and the last of them.

    A dead end whose robot is at its goal is no way out.
    """
    count, out = 0, NOWHERE
    for other in grid.beside[cell]:
        if other in (NOWHERE, behind):
            continue
        robot = grid.now[other]
        dead_end = (grid.beside[other] != NOWHERE).sum() == 1
        if dead_end and robot != NOBODY and grid.goals[robot] == other:
            continue
        count, out = count + 1, other
    return count, out
