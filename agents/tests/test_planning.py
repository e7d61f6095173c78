"""Grid planning: legal moves, Dijkstra's search as reference, MovingAI benchmarks.

The benchmarks (https://movingai.com/benchmarks, Sturtevant 2012) list the optimal length of each
problem under the same moves. `pytest -m slow` solves all of them, the quick suite a sample.
"""

import math
from heapq import heappop, heappush
from itertools import pairwise
from pathlib import Path as File

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_agents.robot import planning
from minerva_agents.robot.grid import MapError, clearance, inflate
from minerva_agents.robot.planning import GridPath, nearest, shortest_path

BENCHMARKS = File(__file__).parents[2].parent / "shared" / "data" / "movingai"
NAMES = ("32room_000", "Berlin_0_256", "maze512-8-0")
ROOT2 = math.sqrt(2.0)


def grid(*rows):
    """A grid from rows of text: # is blocked."""
    return np.array([[mark == "#" for mark in row] for row in rows])


def can_move(blocked, cell, to):
    """Whether a move is legal; an independent implementation of the rules."""
    rows, columns = blocked.shape
    if not (0 <= to[0] < rows and 0 <= to[1] < columns) or blocked[to]:
        return False
    return not (blocked[cell[0], to[1]] or blocked[to[0], cell[1]])


def distances(blocked, start):
    """Dijkstra's search over the whole grid, in its simplest form."""
    best = {start: 0.0}
    queue = [(0.0, start)]
    while queue:
        distance, cell = heappop(queue)
        if distance > best[cell]:
            continue
        for down in (-1, 0, 1):
            for across in (-1, 0, 1):
                to = (cell[0] + down, cell[1] + across)
                length = distance + math.hypot(down, across)
                if can_move(blocked, cell, to) and length < best.get(to, math.inf) - 1e-9:
                    best[to] = length
                    heappush(queue, (length, to))
    return best


def check_path(blocked, path, start):
    """Check that the path begins at the start, has only legal moves and the stated length."""
    assert path.cells[0] == start
    assert all(can_move(blocked, cell, other) for cell, other in pairwise(path.cells))
    lengths = [math.dist(cell, other) for cell, other in pairwise(path.cells)]
    assert all(length in (1.0, ROOT2) for length in lengths)
    diagonals = sum(length > 1 for length in lengths)
    assert path.length == len(lengths) - diagonals + ROOT2 * diagonals


# --- unit cases ---------------------------------------------------------------------------------


def test_open_ground_is_crossed_diagonally():
    path = shortest_path(grid("....", "....", "...."), (0, 0), (2, 3))
    assert path == GridPath(((0, 0), (1, 1), (2, 2), (2, 3)), 1 + 2 * ROOT2)


def test_no_corner_is_cut():
    path = shortest_path(grid("..", "#."), (0, 0), (1, 1))
    assert path == GridPath(((0, 0), (0, 1), (1, 1)), 2.0)


def test_two_corners_that_touch_are_a_wall():
    assert shortest_path(grid(".#", "#."), (0, 0), (1, 1)) is None


def test_start_is_goal():
    assert shortest_path(grid(".."), (0, 1), (0, 1)) == GridPath(((0, 1),), 0.0)


@pytest.mark.parametrize(("start", "goal"), [((0, 0), (0, 2)), ((0, 2), (0, 0)), ((0, 2), (0, 2))])
def test_a_blocked_end_has_no_path(start, goal):
    assert shortest_path(grid("..#"), start, goal) is None


@pytest.mark.parametrize("cell", [(-1, 0), (0, -1), (1, 0), (0, 3), (0.5, 0)])
def test_a_cell_outside_is_an_error_that_names_it(cell):
    with pytest.raises(MapError, match=r"shortest_path: goal .* is outside the grid; expected"):
        shortest_path(grid("..."), (0, 0), cell)
    with pytest.raises(MapError, match=r"shortest_path: start"):
        shortest_path(grid("..."), cell, (0, 0))
    with pytest.raises(MapError, match=r"nearest: start"):
        nearest(grid("..."), cell, grid("###"))


def test_a_grid_that_is_not_bool_is_an_error():
    for wrong in (np.zeros((3, 3)), np.zeros(3, np.bool_)):
        with pytest.raises(MapError, match="expected a 2-D array of bool"):
            shortest_path(wrong, (0, 0), (0, 0))
        with pytest.raises(MapError, match="clearance: obstacles"):
            clearance(wrong)


def test_cells_may_be_numpy_integers():
    rows = np.argwhere(np.ones((200, 1)))
    blocked = np.zeros((200, 1), np.bool_)
    assert shortest_path(blocked, tuple(rows[0]), tuple(rows[-1])).length == 199.0


def test_the_same_question_has_the_same_answer():
    blocked = np.random.default_rng(1).random((60, 60)) < 0.2
    blocked[0, 0] = blocked[59, 59] = False
    assert len({shortest_path(blocked.copy(), (0, 0), (59, 59)) for _ in range(5)}) == 1


def test_nearest_is_nearest_by_path_not_by_air():
    path = nearest(grid("..#.", "..#.", "...."), (0, 1), grid("...#", "....", "#..."))
    assert path.cells[-1] == (2, 0)


def test_nearest_takes_the_start_itself():
    assert nearest(grid(".."), (0, 0), grid("#.")) == GridPath(((0, 0),), 0.0)


@pytest.mark.parametrize("targets", [grid("..."), grid(".#."), grid("..#")])
def test_nearest_without_a_target_in_reach(targets):
    assert nearest(grid(".#."), (0, 0), targets) is None


def test_nearest_wants_grids_of_one_shape():
    with pytest.raises(MapError, match=r"targets is \(1, 2\), expected .* \(1, 3\)"):
        nearest(grid("..."), (0, 0), grid(".."))


def test_inflate_grows_a_disc():
    dot = np.zeros((5, 5), np.bool_)
    dot[2, 2] = True
    assert np.array_equal(inflate(dot, 0), dot)
    assert np.array_equal(inflate(dot, 1), grid(".....", "..#..", ".###.", "..#..", "....."))
    assert np.array_equal(inflate(dot, 1.5), grid(".....", ".###.", ".###.", ".###.", "....."))
    assert np.array_equal(inflate(dot, 2), grid("..#..", ".###.", "#####", ".###.", "..#.."))


def test_inflate_with_a_radius_beyond_the_grid_fills_it():
    assert inflate(grid("#..", "...", "..."), 1e6).all()
    assert not inflate(grid("...", "..."), 1e6).any()


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    share=st.sampled_from([0.0, 0.002, 0.05, 0.5]),
    radius=st.one_of(st.floats(0.0, 12.0), st.sampled_from([1.0, math.sqrt(2.0), math.sqrt(5.0)])),
)
def test_inflate_is_all_within_the_radius_wherever_on_the_grid_obstacles_lie(
    seed, shape, share, radius
):
    """The result is the same with a wide margin without obstacles, which `inflate` skips."""
    obstacles = np.random.default_rng(seed).random(shape) < share
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    expected = np.zeros(shape, np.bool_)
    for row, column in np.argwhere(obstacles).tolist():
        squares = (rows - row) ** 2 + (columns - column) ** 2
        expected |= squares.astype(np.float64) <= radius * radius
    before = obstacles.copy()
    assert np.array_equal(inflate(obstacles, radius), expected)
    assert np.array_equal(obstacles, before)
    around = np.pad(obstacles, ((30, 17), (5, 60)))
    assert np.array_equal(inflate(around, radius)[30:-17, 5:-60], expected)


@pytest.mark.parametrize("radius", [-1, math.nan, math.inf])
def test_inflate_wants_a_radius(radius):
    with pytest.raises(MapError, match="inflate: radius_cells is"):
        inflate(grid("."), radius)


def test_clearance_without_obstacles_is_infinite():
    assert np.isinf(clearance(grid("..", ".."))).all()


# --- against the simple implementation ----------------------------------------------------------


@st.composite
def problems(draw):
    """A grid with walls of a drawn density, a free start, and any goal."""
    rows, columns = draw(st.integers(1, 14)), draw(st.integers(1, 14))
    density = draw(st.sampled_from([0.0, 0.1, 0.25, 0.4, 0.6]))
    seed = draw(st.integers(0, 2**32 - 1))
    blocked = np.random.default_rng(seed).random((rows, columns)) < density
    start, goal = (
        (draw(st.integers(0, rows - 1)), draw(st.integers(0, columns - 1))) for _ in range(2)
    )
    blocked[start] = False
    return blocked, start, goal


@settings(max_examples=100, deadline=None)
@given(problems())
def test_paths_are_as_short_as_dijkstra_finds(problem):
    blocked, start, goal = problem
    best = distances(blocked, start)
    path = shortest_path(blocked, start, goal)
    if goal not in best:
        assert path is None
        return
    check_path(blocked, path, start)
    assert path.cells[-1] == goal
    assert path.length == pytest.approx(best[goal], abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(problems(), st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.1, 0.5]))
def test_nearest_targets_are_as_near_as_dijkstra_finds(problem, seed, density):
    blocked, start, _ = problem
    targets = np.random.default_rng(seed).random(blocked.shape) < density
    best = distances(blocked, start)
    near = min((best[cell] for cell in best if targets[cell]), default=None)
    path = nearest(blocked, start, targets)
    if near is None:
        assert path is None
        return
    check_path(blocked, path, start)
    assert targets[path.cells[-1]]
    assert path.length == pytest.approx(near, abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(problems(), st.floats(0, 6))
def test_clearance_and_inflate_agree_with_every_pair_of_cells(problem, radius):
    obstacles, _, _ = problem
    cells = np.argwhere(np.ones(obstacles.shape))
    walls = np.argwhere(obstacles)
    squared = ((cells[:, None] - walls[None]) ** 2).sum(axis=2).min(axis=1, initial=10**9)
    squared = squared.reshape(obstacles.shape)
    exact = np.where(squared == 10**9, np.inf, np.sqrt(squared))
    assert np.array_equal(clearance(obstacles), exact)
    assert np.array_equal(inflate(obstacles, radius), squared <= radius * radius)


@settings(max_examples=100, deadline=None)
@given(problems(), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_small_windows_change_no_length(problem, margin, seed):
    blocked, start, goal = problem
    targets = np.random.default_rng(seed).random(blocked.shape) < 0.05
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "_MARGIN", margin)
        patch.setattr(planning, "_GROWTH", 2)
        paths = shortest_path(blocked, start, goal), nearest(blocked, start, targets)
    expected = shortest_path(blocked, start, goal), nearest(blocked, start, targets)
    assert [path and path.length for path in paths] == [path and path.length for path in expected]


@pytest.mark.parametrize("length", [253, 254, 255, 256, 509, 1000])
@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_rays_of_any_length_end_where_they_should(length, turn):
    """A corridor with one turn, in each orientation; table entries are bytes."""
    blocked = np.ones((length + 1, length + 1), np.bool_)
    blocked[0, :] = blocked[:, length] = False
    blocked = np.ascontiguousarray(np.rot90(blocked, turn))
    ends = [(0, 0), (length, length)]
    for _ in range(turn):
        ends = [(length - column, row) for row, column in ends]
    path = shortest_path(blocked, ends[0], ends[1])
    assert path.length == 2 * length
    check_path(blocked, path, ends[0])


@pytest.mark.parametrize("size", [254, 255, 256, 700])
def test_diagonals_of_any_length_end_where_they_should(size):
    blocked = np.zeros((size + 1, size + 1), np.bool_)
    for ends in (((0, 0), (size, size)), ((size, 0), (0, size)), ((size, size), (0, 0))):
        assert shortest_path(blocked, *ends) == nearest(blocked, ends[0], only(blocked, ends[1]))
        assert shortest_path(blocked, *ends).length == size * ROOT2


def test_a_near_goal_needs_no_table_of_the_whole_grid(monkeypatch):
    sizes = []

    def counted(blocked, targets):
        sizes.append(blocked.size)
        return made(blocked, targets)

    made = planning.jumps_of
    monkeypatch.setattr(planning, "jumps_of", counted)
    blocked = np.random.default_rng(2).random((1500, 1500)) < 0.2
    blocked[700, 700] = blocked[740, 730] = False
    assert shortest_path(blocked, (700, 700), (740, 730)).cells[-1] == (740, 730)
    assert nearest(blocked, (700, 700), only(blocked, (740, 730))).cells[-1] == (740, 730)
    assert sum(sizes) < 200_000


def only(blocked, cell):
    """A grid with one target."""
    targets = np.zeros(blocked.shape, np.bool_)
    targets[cell] = True
    return targets


# --- MovingAI -----------------------------------------------------------------------------------


def read_benchmark(name):
    """The map as blocked[x, y], and its problems as (start, goal, optimal length)."""
    if not (BENCHMARKS / f"{name}.map").exists():
        pytest.skip(f"no MovingAI benchmark {name}.map in {BENCHMARKS}")
    lines = (BENCHMARKS / f"{name}.map").read_text().splitlines()
    assert lines[0] == "type octile"
    assert lines[3] == "map"
    height, width = int(lines[1].split()[1]), int(lines[2].split()[1])
    blocked = np.array([[mark not in ".GS" for mark in line] for line in lines[4 : 4 + height]]).T
    assert blocked.shape == (width, height)
    problems = []
    for line in (BENCHMARKS / f"{name}.map.scen").read_text().splitlines()[1:]:
        _, _, _, _, x, y, goal_x, goal_y, optimum = line.split("\t")
        problems.append(((int(x), int(y)), (int(goal_x), int(goal_y)), float(optimum)))
    return np.ascontiguousarray(blocked), problems


def solve(blocked, problems):
    for start, goal, optimum in problems:
        path = shortest_path(blocked, start, goal)
        check_path(blocked, path, start)
        assert path.cells[-1] == goal
        assert path.length == pytest.approx(optimum, rel=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_a_sample_of_the_benchmarks_has_the_listed_lengths(name):
    blocked, problems = read_benchmark(name)
    solve(blocked, [*problems[:: max(1, len(problems) // 60)], *problems[-5:]])


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", NAMES)
def test_all_of_the_benchmarks_have_the_listed_lengths(name):
    solve(*read_benchmark(name))


@pytest.mark.parametrize("name", NAMES)
def test_parts_of_the_benchmarks_agree_with_dijkstra(name):
    blocked, problems = read_benchmark(name)
    start = problems[-1][0]
    window = tuple(slice(max(0, at - 40), at + 40) for at in start)
    part = np.ascontiguousarray(blocked[window])
    inside = tuple(at - cut.start for at, cut in zip(start, window, strict=True))
    best = distances(part, inside)
    for goal in sorted(best)[:: max(1, len(best) // 40)]:
        assert shortest_path(part, inside, goal).length == pytest.approx(best[goal], abs=1e-9)


@pytest.mark.parametrize("shape", [(2100, 40), (40, 2100), (1, 500), (500, 1), (300, 280)])
@pytest.mark.parametrize("density", [0.0001, 0.01, 0.5])
def test_clearance_of_large_grids_is_that_of_scipy(shape, density):
    scipy = pytest.importorskip("scipy.ndimage")
    obstacles = np.random.default_rng(3).random(shape) < density
    obstacles[0, 0] = True
    assert np.array_equal(clearance(obstacles), scipy.distance_transform_edt(~obstacles))


def test_clearance_is_exact_where_squares_of_distances_need_64_bits():
    obstacles = np.zeros((47_000, 2), np.bool_)
    obstacles[0, 0] = True
    rows = np.arange(47_000.0)
    assert np.array_equal(clearance(obstacles), np.sqrt([rows**2, rows**2 + 1]).T)
