"""λ for eDecide, 4.2.3 and 4.2.5: pose, action, and the two decision methods."""

import math

import numpy as np
import pytest
from robot_steps import PAPER, after, changed, emitted, robot

from minerva_agents.robot.approach import MAKE_WAY
from minerva_agents.robot.clearance import blocked, is_clear, room_of, sees, straightened
from minerva_agents.robot.grid import FREE, MARKER, obstacles
from minerva_agents.robot.planning import shortest_path
from minerva_agents.robot.pose import (
    STAY,
    TURNING,
    GridPose,
    Move,
    action_of,
    cell_of,
    move_of,
    towards,
)
from minerva_agents.robot.vocabulary import eDecide, eObjective, eReached
from minerva_bus import EMPTY

STANDING = {"action": action_of(STAY, "r", 0.18)}


def floor(*walls, free=FREE):
    """Free ground of 40 x 40 cells; walls are (first row, last row, first column, last column)."""
    grid = np.full((40, 40), free, np.int16)
    for top, bottom, left, right in walls:
        grid[top : bottom + 1, left : right + 1] = 9
    return grid


def with_marker(grid, row, column, marker=0):
    grid[row, column] = MARKER + marker
    return grid


def seeking(grid, **state):
    return robot(grid, speed=0.5, objective="kitchen", **(STANDING | state))


def drive(scene, frames):
    """The robot after the given number of decisions, and the cells it has visited."""
    now = after(scene, eDecide(), frame=0)
    places = [now.position]
    for frame in range(1, frames):
        now = after(now.string, eDecide(), frame=frame)
        places.append(now.position)
    return now, places


# --- the timeline -------------------------------------------------------------------------------


def test_the_first_decision_is_to_stay():
    scene = robot(speed=0.5, objective="kitchen")
    now = after(scene, eDecide())
    assert str(now.action) == 'PRobot<name="r", radius=0.18>'
    assert changed(scene, now) == ["action"]


def test_the_pose_is_where_the_action_leads():
    scene = robot(angle=80.0, action=action_of(Move(10.0, 0.5), "r", 0.18))
    now = after(scene, eDecide())
    assert (now.row, now.column, now.angle) == pytest.approx((20.5, 25.5, 90.0))
    assert move_of(now.action) == STAY


def test_a_robot_with_nothing_to_do_stays_the_very_same():
    scene = robot(speed=0.5, **STANDING)
    assert after(scene, eDecide()).string.nodes[0] is scene.nodes[0]


def test_of_the_papers_attributes_grid_speed_and_objective_stay():
    scene = seeking(with_marker(floor(), 30, 20))
    now = after(scene, eDecide())
    assert [name for name in changed(scene, now) if name in PAPER] == ["action"]
    now = after(now.string, eDecide())
    assert [name for name in changed(scene, now) if name in PAPER] == ["row", "action"][::-1]


def test_without_speed_it_stays():
    scene = robot(with_marker(floor(), 30, 20), objective="kitchen", **STANDING)
    assert move_of(after(scene, eDecide()).action) == STAY


def test_off_its_grid_it_is_lost_and_stays():
    scene = seeking(with_marker(floor(), 30, 20), row=-3.0)
    assert move_of(after(scene, eDecide()).action) == STAY


# --- moves --------------------------------------------------------------------------------------


def test_an_action_gives_its_move():
    for move in (STAY, Move(10.0, 0.0), Move(-20.0, 0.3), Move(0.0, 0.1)):
        assert move_of(action_of(move, "r", 0.18)) == move
    assert move_of(EMPTY) == STAY


def test_a_turn_comes_before_the_way():
    pose = GridPose(2.0, 3.0, 170.0).after(Move(20.0, 0.2), 0.1)
    turned = math.radians(190.0)
    assert (pose.row, pose.column) == pytest.approx(
        (2 + 2 * math.cos(turned), 3 + 2 * math.sin(turned))
    )
    assert pose.angle == pytest.approx(-170.0)


def test_it_turns_on_the_spot_until_it_faces_its_way():
    pose, turns = GridPose(0.5, 0.5, 0.0), 0
    while not (move := towards(pose, 0.5, 9.5, 0.1, 0.05, 0.1)).dist:
        assert 0 < move.turn <= TURNING * 0.1
        pose, turns = pose.after(move, 0.1), turns + 1
    assert turns == 4
    assert (move.turn, move.dist) == (pytest.approx(18.0), 0.05)


def test_it_stops_where_it_wants_to_be():
    assert towards(GridPose(0.5, 0.5, 0.0), 0.9, 0.5, 0.1, 0.08, 0.1).dist == pytest.approx(0.04)
    assert towards(GridPose(0.5, 0.5, 0.0), 0.5, 0.5, 0.1, 0.08, 0.1) == STAY


# --- ground -------------------------------------------------------------------------------------


def test_a_way_keeps_its_distance():
    grid, room = floor((20, 20, 20, 20)), room_of(0.18, 0.1)
    assert is_clear(grid, [(10.5, 23.1), (30.5, 23.1)], room)
    assert not is_clear(grid, [(10.5, 22.9), (30.5, 22.9)], room)
    assert is_clear(grid, [(10.5, 22.0), (15.0, 22.0)], room)


def test_one_that_is_too_near_may_only_go_away():
    grid, room, at = floor((22, 22, 0, 39)), room_of(0.18, 0.1), (20.4, 20.5)
    assert not is_clear(grid, [at, (21.0, 20.5)], room)
    assert is_clear(grid, [at, (15.0, 20.5)], room)
    closed = blocked(grid, at, room)
    assert not closed[20, 20]
    assert not closed[19, 20]
    assert closed[21, 20]
    assert shortest_path(closed, cell_of(at), (5, 5)) is not None


@pytest.mark.parametrize("seed", range(20))
def test_straightened_ways_are_clear_and_lead_to_the_end(seed):
    random = np.random.default_rng(seed)
    grid, room = floor(), room_of(0.18, 0.1)
    grid[random.random(grid.shape) < 0.01] = 9
    free = np.argwhere(~blocked(grid, (0.5, 0.5), room))
    start, goal = (tuple(cell) for cell in random.choice(free, 2).tolist())
    at = start[0] + random.random(), start[1] + random.random()
    path = shortest_path(blocked(grid, at, room), start, goal)
    if path is not None:
        way = straightened(grid, at, path.cells, room)
        assert way[-1] == (goal[0] + 0.5, goal[1] + 0.5)
        assert len(way) <= len(path.cells)
        assert is_clear(grid, way, room)


def test_a_wall_hides_what_is_behind():
    walls = obstacles(floor((20, 20, 10, 20)))
    assert not sees(walls, (15.5, 15.5), (25.5, 15.5))
    assert sees(walls, (15.5, 25.5), (25.5, 25.5))
    assert sees(walls, (15.5, 15.5), (20.5, 15.5))


# --- A* -----------------------------------------------------------------------------------------


def test_it_goes_round_a_wall_to_a_marker_that_it_knows():
    grid = with_marker(floor((15, 15, 5, 39)), 5, 30)
    now, places = drive(seeking(grid, row=30.5, column=30.5, angle=180.0), 150)
    assert now.objective == ""
    assert math.dist(places[-1], (5.5, 30.5)) < 14
    assert (
        min(math.dist(place, (15.5, column + 0.5)) for place in places for column in range(5, 40))
        > 2.5
    )


def test_a_plan_is_kept_until_something_turns_up_on_it():
    grid = with_marker(floor(), 35, 20)
    now, _ = drive(seeking(grid, row=5.5), 3)
    assert now.way == [(35.5, 20.5)]
    later = after(now.string, eDecide())
    assert later.plan_rows is now.plan_rows
    grid = now.grid.copy()
    grid[20, 19] = 9
    later.grid = grid
    assert after(later.string, eDecide()).way != now.way


def test_it_announces_itself_once():
    scene = seeking(with_marker(floor(), 24, 20))
    assert emitted(scene, eDecide())[0].marker == "kitchen"
    assert emitted(scene, eDecide())[0].type == eReached.name
    now = after(scene, eDecide())
    assert now.objective == ""
    assert emitted(now.string, eDecide()) == ()


def test_behind_a_wall_is_not_there():
    scene = seeking(with_marker(floor((22, 22, 0, 30)), 24, 20))
    assert emitted(scene, eDecide()) == ()


def test_a_marker_within_a_wall_is_reached_before_it():
    grid = with_marker(floor((28, 32, 0, 39)), 30, 20)
    now, places = drive(seeking(grid), 200)
    assert now.objective == ""
    assert 24 < max(row for row, _ in places) < 26


def test_then_it_makes_way_and_stands_still():
    now, places = drive(seeking(with_marker(floor(), 24, 20)), 80)
    assert math.dist(places[-1], (24.5, 20.5)) > 5
    assert places[-1][0] > 24
    assert places[-1] == places[-10]
    assert move_of(now.action) == STAY
    again = after(now.string, eObjective("store"), eDecide())
    assert again.objective == "store"


def test_a_blocked_way_out_of_the_way_is_replaced():
    """Beside the marker, the robot would hide it from others."""
    now, frame = after(seeking(with_marker(floor(), 24, 20)), eDecide()), 0
    while math.dist(now.position, (24.5, 20.5)) > 2 or now.purpose != MAKE_WAY:
        frame += 1
        now = after(now.string, eDecide(), frame=frame)
        assert frame < 60
    now.writable("grid")[27:29] = 9
    now, places = drive(now.string, 60)
    assert math.dist(now.position, (24.5, 20.5)) > 5
    assert places[-1] == places[-10]


@pytest.mark.parametrize("approach", [45.0, 20.0, 70.0])
def test_in_a_corner_it_makes_way_to_the_side(approach):
    """Behind the marker is no space, and in front of it the robot would hide it from others."""
    grid = with_marker(floor((28, 39, 0, 39), (0, 39, 28, 39)), 23, 23)
    slope = math.radians(approach)
    begin = {"row": 23.5 - 12.0 * math.cos(slope), "column": 23.5 - 12.0 * math.sin(slope)}
    now, places = drive(seeking(grid, **begin), 120)
    assert now.objective == ""
    down, across = now.row - 23.5, now.column - 23.5
    aside = abs(down * math.sin(slope) - across * math.cos(slope))
    assert aside > 2 * now.radius / now.cell
    assert 5 < math.hypot(down, across) < 12
    assert places[-1] == places[-10]


def test_it_looks_for_a_marker_that_it_has_not_seen():
    grid = floor(free=0)
    grid[10:31, 10:31] = FREE
    now = after(seeking(grid), eDecide())
    assert now.purpose in ("search", "look")
    assert now.news > 1
    assert move_of(now.action) != STAY


def test_a_place_where_it_has_been_and_a_turn_that_shows_nothing_are_not_tried_again():
    """Without a laser the unknown area beyond stays unknown, and the search still ends."""
    grid = floor((14, 14, 14, 26), (26, 26, 14, 26), (14, 26, 14, 14), free=0)
    grid[15:26, 15:27] = FREE
    now, _ = drive(seeking(grid), 900)
    assert now.objective == ""


def test_a_way_that_leads_nowhere_is_none():
    """The robot's own cell is the only one it may go to."""
    grid = with_marker(
        floor((18, 18, 0, 39), (23, 23, 0, 39), (0, 39, 18, 18), (0, 39, 23, 23)), 35, 35
    )
    now = after(seeking(grid), eDecide())
    assert now.failures == 1
    assert not now.way


def test_without_a_path_it_waits_and_tries_again():
    grid = with_marker(floor((10, 30, 10, 30)), 35, 35)
    grid[14:27, 14:27] = FREE
    now = after(seeking(grid, row=20.5), eDecide())
    assert (now.failures, now.way) == (1, [])
    assert now.pause > 0
    assert move_of(now.action) == STAY


# --- random -------------------------------------------------------------------------------------


def test_random_ways_differ_by_seed_and_not_otherwise():
    scene = seeking(floor(), planner="random")
    ways = [after(scene, eDecide(), seed=seed).way for seed in (1, 1, 2)]
    assert ways[0] == ways[1] != ways[2]


def test_random_goes_straight_to_a_marker_in_sight():
    now, _ = drive(seeking(with_marker(floor(), 35, 33), planner="random"), 60)
    assert now.objective == ""


def test_random_touches_nothing():
    grid = floor((0, 0, 0, 39), (39, 39, 0, 39), (0, 39, 0, 0), (0, 39, 39, 39), (10, 12, 8, 30))
    _, places = drive(seeking(grid, planner="random"), 400)
    walls = np.argwhere(obstacles(grid)) + 0.5
    assert min(np.hypot(*(walls - place).T).min() for place in places) > 2.5
    assert max(math.dist(places[0], place) for place in places) > 8
