"""Selection of the next search target: a pure function of the robot's knowledge."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_agents.robot.exploration import (
    DARK,
    NEWS,
    NOTHING,
    RAYS,
    REST,
    WALL,
    WORTH,
    Prospects,
    SearchState,
    kinds_of,
    news_ahead,
    news_at,
    next_goal,
)
from minerva_agents.robot.grid import FREE, SEEN, UNKNOWN, inflate, look, obstacles
from minerva_agents.robot.planning import STEP, Wave, shortest_path
from minerva_agents.robot.pose import GridPose
from minerva_bus import portable

CELL = 0.1


def room(rows=80, columns=80, code=SEEN):
    """A room with walls around it, by default entirely seen."""
    grid = np.full((rows, columns), 9, np.int16)
    grid[1:-1, 1:-1] = code
    return grid


def known(grid, row=40.5, column=40.5, angle=0.0, **more):
    return SearchState(
        grid, inflate(obstacles(grid), 2.5), GridPose(row, column, angle), CELL, **more
    )


def goal_of(state):
    """The next goal of a search that has one."""
    goal = next_goal(state)
    assert goal is not None
    return goal


def test_an_empty_view():
    assert next_goal(known(room())) is None


def test_a_turn_reveals_the_area_behind():
    grid = room(code=FREE)
    look(grid, GridPose(40.5, 40.5, 0.0), 60.0, 50.0)
    goal = goal_of(known(grid))
    assert goal.cells == ()
    assert abs(goal.heading) > 30
    assert goal.news > 3


def test_agents_move_towards_targets_out_of_reach():
    grid = room(200, 40)
    grid[150:199, 1:-1] = FREE
    goal = goal_of(known(grid, row=20.5, column=20.5))
    assert goal.cells[0] == (20, 20)
    assert goal.cells[-1][0] > 90
    assert goal.news > 3


def test_an_unreachable_cell_is_no_goal():
    grid = room(200, 40)
    grid[100] = 9
    grid[150:199, 1:-1] = FREE
    assert next_goal(known(grid, row=20.5, column=20.5)) is None


def test_the_own_cell_is_no_place_to_go_to():
    """A robot on the frontier has to move on, not to stay."""
    grid = np.full((200, 200), UNKNOWN, np.int16)
    grid[60:100, 60:140] = SEEN
    goal = goal_of(known(grid, row=99.5, column=100.5, angle=180.0))
    assert goal.cells == () or len(goal.cells) > 1
    dull = goal_of(known(grid, row=99.5, column=100.5, angle=180.0, dull=[(99, 100)]))
    assert len(dull.cells) > 1


def test_no_place_is_gone_to_twice():
    grid, been = room(200, 40), []
    grid[150:199, 1:-1] = FREE
    while goal := next_goal(known(grid, row=20.5, column=20.5, been=been)):
        blocks = {(row // 5, column // 5) for row, column in been}
        row, column = goal.cells[-1]
        assert (row // 5, column // 5) not in blocks
        been.append(goal.cells[-1])
    assert been


@pytest.mark.parametrize(("side", "is_first"), [(7, True), (5, False)])
def test_a_corner_that_is_left_over_is_inspected_on_the_way_unless_it_is_tiny(side, is_first):
    """It is near, and to return for it later would cost a journey of its own."""
    grid = room(200, 60)
    grid[30 : 30 + side, 1 : 1 + side] = FREE
    grid[120:199, 1:-1] = FREE

    def goal():
        return goal_of(known(grid, row=60.5, column=30.5, angle=0.0, dull=[(60, 30)]))

    assert (goal().cells[-1][0] <= 60) is is_first
    # Once nothing larger is left, the tiny corner has its turn.
    grid[120:199, 1:-1] = SEEN
    assert goal().cells[-1][0] <= 60


@pytest.mark.parametrize("shift", [0, 7, 33])
def test_the_choice_does_not_depend_on_where_the_grid_begins(shift):
    grid = room(120, 120)
    grid[60:119, 1:-1] = FREE
    wide = np.zeros((200, 200), np.int16)
    wide[5 * shift // 5 * 5 : 5 * shift // 5 * 5 + 120, :120] = 0
    goal = next_goal(known(grid, row=20.5, column=20.5))
    bigger = np.pad(grid, ((0, 50), (0, 50)))
    assert next_goal(known(bigger, row=20.5, column=20.5)) == goal


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 0.1))
def test_a_goal_is_reached_by_steps_that_cut_no_corner(seed, share):
    random = np.random.default_rng(seed)
    grid = random.choice([FREE, SEEN], (70, 70)).astype(np.int16)
    grid[random.random(grid.shape) < share] = 9
    grid[random.integers(70), random.integers(70)] = UNKNOWN
    what = known(grid, row=35.5, column=35.5, angle=float(random.uniform(-180, 180)))
    goal = next_goal(what)
    assert goal == next_goal(what)
    if goal is None or not goal.cells:
        return
    assert goal.cells[0] == (35, 35)
    for (row, column), (down, across) in zip(goal.cells, goal.cells[1:], strict=False):
        assert max(abs(row - down), abs(column - across)) == 1
        assert not what.closed[down, across]
        assert not what.closed[down, column] or (down, column) == (35, 35)
        assert not what.closed[row, across] or (row, across) == (35, 35)


def with_narrow_shadow(random, width):
    """A seen room with another robot in it, and an unseen strip of `width` columns across it."""
    grid = room(60, 60)
    row, column = random.integers(6, 54, 2)
    angle = random.uniform(0.0, 2.0 * math.pi)
    for dist in np.arange(0.0, 80.0, 0.5):
        down, across = row + dist * math.cos(angle), column + dist * math.sin(angle)
        if 1 <= down < 59 and 1 <= across < 60 - width:
            grid[int(down), int(across) : int(across) + width] = FREE
    rows, columns = np.ogrid[:60, :60]
    grid[(rows - row) ** 2 + (columns - column) ** 2 <= 4] = 9
    return grid


def search(grid, pose, **more):
    """Drive and turn to the goals of a search until there are none; the grid shows what is seen."""
    been, dull = [], []
    while goal := next_goal(known(grid, *pose, been=been, dull=dull, **more)):
        if goal.cells:
            row, column = goal.cells[-1]
            been.append((row, column))
            pose = row + 0.5, column + 0.5, pose[2]
        else:
            pose = pose[0], pose[1], goal.heading
        look(grid, GridPose(*pose), 60.0, 50.0)
        here = math.floor(pose[0]), math.floor(pose[1])
        # A turn that reveals too little is not repeated, as in `astar`.
        if not goal.cells and news_ahead(known(grid, **more), here, goal.heading) > goal.news / 2:
            dull.append(here)


@pytest.mark.parametrize("width", [1, 2])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_thorough_search_leaves_nothing_unseen(width, seed):
    """A marker may stand in the narrow shadow of another robot."""
    random = np.random.default_rng(seed)
    grid = with_narrow_shadow(random, width)
    rows, columns = np.nonzero(~known(grid).closed)
    index = random.integers(len(rows))
    search(grid, (rows[index] + 0.5, columns[index] + 0.5, 0.0), is_thorough=True)
    assert not (grid == FREE).any()


def test_a_first_search_ignores_specks():
    grid = with_narrow_shadow(np.random.default_rng(0), 2)
    assert next_goal(known(grid)) is None
    assert next_goal(known(grid, is_thorough=True)) is not None


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 0.4))
def test_a_wave_reaches_reachable_cells_with_about_the_path_length(seed, share):
    random = np.random.default_rng(seed)
    blocked = random.random((30, 30)) < share
    blocked[3, 3] = False
    wave = Wave(~blocked, (3, 3))
    wave.grow(10_000)
    assert wave.is_over
    for row, column in random.integers(0, 30, (10, 2)).tolist():
        path = shortest_path(blocked, (3, 3), (row, column))
        steps = int(wave.steps[row, column])
        assert (path is None) == (steps < 0)
        if path is not None:
            assert path.length / 1.2 - 1 <= steps <= 1.42 * path.length + 1
            assert wave.path_to((row, column))[-1] == (row, column)
            assert len(wave.path_to((row, column))) == steps + 1
    assert 1.0 < STEP < 1.13


def test_a_view_counts_square_metres_up_to_the_walls():
    views = Prospects(kinds_of(room(60, 60, FREE), CELL), 50.0, CELL).views(
        np.array([30]), np.array([30])
    )
    assert views.shape == (1, RAYS)
    assert views.sum() == pytest.approx(5.8 * 5.8, rel=0.1)
    disc = Prospects(kinds_of(room(160, 160, FREE), CELL), 50.0, CELL).views(
        np.array([80]), np.array([80])
    )
    assert disc.sum() == pytest.approx(math.pi * 25, rel=0.1)


def news_on_ray(kinds, row, column, ray, sight, most_dark):
    """News on a ray from a cell, step by step, in cells: each step is as wide as its sector."""
    angle, news, dark = math.radians(ray * 360.0 / RAYS), 0, 0
    for step in range(1, math.ceil(sight)):
        at = (
            row + math.floor(step * portable.cos(angle) + 0.5),
            column + math.floor(step * portable.sin(angle) + 0.5),
        )
        inside = 0 <= at[0] < kinds.shape[0] and 0 <= at[1] < kinds.shape[1]
        kind = int(kinds[at]) if inside else WALL
        dark += kind == DARK
        if kind == WALL or dark > most_dark:
            break
        news += (kind & WORTH) * step
    return news


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    walls=st.sampled_from([0.0, 0.01, 0.1]),
    dark=st.sampled_from([0.1, 0.6, 1.0]),
    sight=st.sampled_from([2.5, 7.5, 14.0]),
    count=st.integers(0, 3),
)
def test_a_view_is_that_of_each_ray_by_itself(seed, walls, dark, sight, count):
    random = np.random.default_rng(seed)
    kinds = random.choice([NOTHING, NEWS, REST], (20, 16)).astype(np.uint8)
    kinds[random.random(kinds.shape) < dark] = DARK
    kinds[random.random(kinds.shape) < walls] = WALL
    rows, columns = random.integers(0, 20, count), random.integers(0, 16, count)
    # A ray passes 4 m of unknown space, which are 5 cells.
    cell, most_dark = 0.8, 5
    views = Prospects(kinds, sight, cell).views(rows, columns)
    unit = 2.0 * math.pi / RAYS * cell * cell
    assert views.tolist() == [
        [news_on_ray(kinds, row, column, ray, sight, most_dark) * unit for ray in range(RAYS)]
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
    ]


def test_a_view_ends_at_walls_with_gaps_between_beams():
    grid = room(120, 120, FREE)
    grid[70] = SEEN
    grid[70, ::3] = 9
    grid[:70, 1:-1] = np.where(grid[:70, 1:-1] == FREE, SEEN, grid[:70, 1:-1])
    assert news_at(grid_known := known(grid, row=40.5, column=60.5), (40, 60)) == 0
    grid[70] = SEEN
    assert news_at(grid_known, (40, 60)) > 5


def test_news_ahead_is_in_the_cameras_view():
    grid = room(160, 160)
    grid[81:, 1:-1] = np.where(grid[81:, 1:-1] == SEEN, FREE, 9)
    what = known(grid, row=80.5, column=80.5)
    assert news_ahead(what, (80, 80), 0.0) == pytest.approx(math.pi * 25 / 6, rel=0.2)
    assert news_ahead(what, (80, 80), 180.0) == 0
