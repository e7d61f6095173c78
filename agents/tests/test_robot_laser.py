"""λ for eLaser, 4.2.3: the grid contains an obstacle where the laser beam ends."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robot_steps import after, changed, robot

from minerva_agents.robot import grid as evidence
from minerva_agents.robot.grid import (
    FREE,
    MARKER,
    OBSTACLE,
    SEEN,
    SURE,
    UNKNOWN,
    after_passing,
    all_behind,
    behind,
    doubt,
    mark_obstacle,
    mark_scan,
)
from minerva_agents.robot.pose import at_distance, at_distances
from minerva_agents.robot.vocabulary import eClear, eLaser
from minerva_agents.robot.world import vocabulary


def marked(grid):
    return [tuple(cell) for cell in np.argwhere((grid >= OBSTACLE) & (grid <= SURE)).tolist()]


@pytest.mark.parametrize("ang", [0.0, 37.0, 90.0, -135.0, 180.0])
@pytest.mark.parametrize("angle", [0.0, 4.0, -90.0, 123.0])
@pytest.mark.parametrize("dist", [0.05, 0.4, 1.72])
def test_the_cell_is_that_of_the_papers_formula(ang, angle, dist):
    r, c, cell = 20.3, 19.8, 0.1
    seen = after(robot(row=r, column=c, angle=ang), eLaser(dist, angle))
    turned = math.radians(ang + angle)
    row = r + dist / cell * math.cos(turned)
    column = c + dist / cell * math.sin(turned)
    assert marked(seen.grid) == [(math.floor(row), math.floor(column))]


def test_only_the_grid_changes():
    scene = robot(angle=30.0, speed=0.5, objective="store")
    assert changed(scene, after(scene, eLaser(1.0, 10.0))) == ["grid"]


def test_the_size_of_a_cell_counts():
    seen = after(robot(cell=0.25), eLaser(1.0, 0.0))
    assert marked(seen.grid) == [(24, 20)]


def test_the_beam_is_free_up_to_the_obstacle_and_unknown_behind():
    grid = after(robot(), eLaser(1.0, 0.0)).grid
    assert grid[20:30, 20].tolist() == [FREE] * 10
    assert grid[30, 20] >= OBSTACLE
    assert grid[31:, 20].tolist() == [UNKNOWN] * 9
    assert np.count_nonzero(grid) == 11


@given(st.floats(-180, 180), st.floats(0.0, 6.0), st.floats(0, 39.99), st.floats(0, 39.99))
def test_a_beam_leaves_no_gap_and_may_leave_the_grid(angle, dist, row, column):
    grid = after(robot(row=row, column=column), eLaser(dist, angle)).grid
    known = {tuple(cell) for cell in np.argwhere(grid).tolist()}
    end_row, end_column = at_distance(row, column, angle, dist / 0.1)
    on = behind(end_row - row), behind(end_column - column)
    start = math.floor(row + on[0]), math.floor(column + on[1])
    end = math.floor(end_row + on[0]), math.floor(end_column + on[1])
    inside = 0 <= end[0] < 40 and 0 <= end[1] < 40
    assert marked(grid) == ([end] if inside else [])
    for cell in known - {start}:
        around = {(cell[0] + down, cell[1] + over) for down in (-1, 0, 1) for over in (-1, 0, 1)}
        assert (around - {cell}) & known


@pytest.mark.parametrize("side", [3, 100_000, 250_000])
@pytest.mark.parametrize("beyond", [-0.5, 0.2, 4e6])
def test_a_beam_clears_the_longest_grid_to_its_end(side, beyond):
    end = side + beyond
    for grid, start, to in (
        (np.zeros((side, 1), np.int16), (0.0, 0.5), (end, 0.5)),
        (np.zeros((1, side), np.int16), (0.5, 0.0), (0.5, end)),
    ):
        mark_scan(grid, *start, *np.array([to]).T)
        assert np.count_nonzero(grid == FREE) == side - (beyond < 0)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@given(st.integers(0, 2**32), st.floats(1.5, 30.0), st.floats(1.5, 30.0))
def test_a_beam_that_ends_on_a_border_ends_behind_it(kind, seed, row, column):
    """Walls of a floor lie on borders of cells, and scans have 64 or 32 bits."""
    random = np.random.default_rng(seed)
    start, walls = np.array([[row], [column]]), random.integers(0, 32, (2, 90))
    angles = random.uniform(0, 2 * math.pi, 90)
    to = np.array([np.cos(angles), np.sin(angles)])
    far = walls - start
    for axis in (0, 1):
        dist = far[axis] / to[axis]
        met = (dist > 0) & (dist < 40) & (np.abs(far[axis]) > 0.01)
        metres, degrees = (dist[met] * 0.05).astype(kind), np.degrees(angles[met]).astype(kind)
        end = at_distances(row, column, degrees.astype(float), metres.astype(float) / 0.05)[axis]
        cells = np.floor(end + all_behind(end - start[axis]))
        assert cells.tolist() == (walls[axis] - (far[axis] < 0))[met].tolist()


def one_by_one(grid, row, column, ends, part):
    """The marks of a scan, beam by beam and cell by cell."""
    for to_row, to_column in ends:
        down, across = to_row - row, to_column - column
        # On a border, a beam is in the cell behind it.
        first = row + behind(down), column + behind(across)
        count = math.ceil(max(abs(down), abs(across)) - 1e-4)
        cells = [
            (
                math.floor(k * (down / count) + first[0]),
                math.floor(k * (across / count) + first[1]),
            )
            for k in range(count)
        ]
        end = math.floor(to_row + behind(down)), math.floor(to_column + behind(across))
        passed = count - (cells[-1:] == [end])
        inside = [c for c in cells[:passed] if 0 <= c[0] < len(grid) and 0 <= c[1] < len(grid)]
        before = grid.copy()
        for number, cell in enumerate(inside):
            grid[cell] = after_passing(int(before[cell]), number < math.ceil(part * passed))
        mark_obstacle(grid, *end)


places = st.floats(-3.0, 15.0)


@given(
    st.lists(st.tuples(places, places), max_size=25),
    st.tuples(st.floats(0, 11.9), st.floats(0, 11.9)),
    st.integers(0, 99),
    st.sampled_from([0.5, 1.0]),
)
def test_a_scan_gives_the_grid_of_one_beam_after_another(ends, start, seed, part):
    codes = [0, 1, 2, 3, 5, 9, 10, 11, 16, 18]
    whole = np.random.default_rng(seed).choice(codes, (12, 12)).astype(np.int16)
    beams = whole.copy()
    one_by_one(beams, *start, ends, part)
    mark_scan(whole, *start, *np.reshape(ends, (-1, 2)).T, part)
    assert whole.tolist() == beams.tolist()


@pytest.mark.parametrize("samples", [1, 50, 300])
def test_a_scan_of_many_samples_is_marked_in_parts(monkeypatch, samples):
    random = np.random.default_rng(1)
    whole = random.integers(0, SURE, (40, 40)).astype(np.int16)
    parts = whole.copy()
    ends = random.uniform(-5, 45, (2, 60))
    mark_scan(whole, 20.3, 19.8, *ends)
    monkeypatch.setattr(evidence, "_AT_ONCE", samples)
    mark_scan(parts, 20.3, 19.8, *ends)
    assert np.array_equal(parts, whole)
    mark_scan(parts, 20.3, 19.8, *ends[:, :0])
    assert np.array_equal(parts, whole)


def test_a_robot_clears_a_literal_grid_of_any_length_to_the_end():
    side = 150_000
    scene = vocabulary.read(
        f"ARobot#r<grid=1x{side}[0*{side}], row=0.5, column=0.5, angle=90deg>()"
    )
    grid = after(scene, eLaser(side * 0.1 - 0.1, 0.0)).grid
    assert (grid[0, :-1] == FREE).all()
    assert grid[0, -1] >= OBSTACLE


def test_evidence_rises_by_three_up_to_nine():
    scene, evidence = robot(), []
    for _ in range(4):
        now = after(scene, eLaser(1.0, 0.0))
        evidence.append(int(now.grid[30, 20]))
        scene = now.string
    assert evidence == [4, 7, 9, 9]


def test_beams_that_pass_take_the_evidence_away():
    scene, evidence = after(robot(), eLaser(0.4, 0.0)).string, []
    for _ in range(4):
        now = after(scene, eLaser(1.5, 0.0))
        evidence.append(int(now.grid[24, 20]))
        scene = now.string
    assert evidence == [3, 2, FREE, FREE]


def test_the_farther_half_of_a_beam_counts_in_every_eighth_frame():
    known = after(robot(), eLaser(1.2, 0.0)).string
    assert after(known, eLaser(1.5, 0.0), frame=7).grid[32, 20] == 4
    assert after(known, eLaser(1.5, 0.0), frame=8).grid[32, 20] == 3


@pytest.mark.parametrize("dist", [0.5, 1.5])
def test_a_marker_stays_a_marker(dist):
    grid = np.zeros((40, 40), np.int16)
    grid[25, 20] = MARKER + 1
    assert after(robot(grid), eLaser(dist, 0.0)).grid[25, 20] == MARKER + 1


def test_observed_cells_stay_observed_until_an_obstacle_appears():
    grid = np.full((40, 40), SEEN, np.int16)
    assert after(robot(grid), eLaser(1.5, 0.0)).grid[25, 20] == SEEN
    assert after(robot(grid), eLaser(0.5, 0.0)).grid[25, 20] == 4


def test_the_events_of_a_frame_add_up():
    angles = [0.0, 90.0, 180.0, -90.0]
    grid = after(robot(), *(eLaser(0.5, angle) for angle in angles)).grid
    assert sorted(marked(grid)) == [(15, 20), (20, 15), (20, 25), (25, 20)]


def test_a_beam_without_hit_clears_its_cells():
    grid = after(robot(), eClear(1.0, 90.0)).grid
    assert (grid[20, 20:30] == FREE).all()
    assert grid[20, 30] == UNKNOWN
    assert not marked(grid)


def test_a_beam_without_hit_counts_up_to_a_known_obstacle():
    """A missing return may be an error, so the cells behind the obstacle stay unknown."""
    known = after(robot(), eLaser(0.6, 0.0)).string
    grid = after(known, eClear(1.5, 0.0)).grid
    assert grid[26, 20] == 3
    assert not grid[27:, 20].any()


def test_a_removed_obstacle_is_cleared_by_beams_without_return():
    scene = after(robot(), eLaser(0.6, 0.0)).string
    for _ in range(4):
        scene = after(scene, eClear(1.5, 0.0)).string
    assert (scene.nodes[0].state["grid"][20:35, 20] == FREE).all()


def test_the_farther_half_of_an_open_beam_counts_in_every_eighth_frame():
    known = after(robot(), eLaser(1.2, 0.0)).string
    assert after(known, eClear(1.5, 0.0), frame=7).grid[32, 20] == 4
    assert after(known, eClear(1.5, 0.0), frame=8).grid[32, 20] == 3


def test_the_string_of_the_frame_is_left_as_it_is():
    scene = robot()
    after(scene, eLaser(1.0, 0.0))
    assert not scene.nodes[0].state["grid"].any()


def test_doubt_lowers_the_evidence_and_nothing_else():
    codes = np.array([[UNKNOWN, FREE, 2, 3, 9, SEEN, MARKER]], np.int16)
    doubt(codes)
    assert codes.tolist() == [[UNKNOWN, FREE, FREE, 2, 8, SEEN, MARKER]]
