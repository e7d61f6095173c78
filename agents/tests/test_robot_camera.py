"""λ for eCamera, 4.2.3: the grid contains a marker where the camera detects one."""

import math

import numpy as np
import pytest
from robot_steps import after, changed, robot

from agents.benchmarks.exploring.strategies import frontier, out_of_view
from minerva_agents.robot.grid import (
    FREE,
    MARKER,
    SEEN,
    UNKNOWN,
    forget_looks,
    look,
)
from minerva_agents.robot.pose import GridPose
from minerva_agents.robot.vocabulary import eCamera

KITCHEN, STORE = MARKER, MARKER + 1


@pytest.mark.parametrize("ang", [0.0, 37.0, 90.0, -135.0])
@pytest.mark.parametrize("dist", [0.3, 1.2])
def test_without_an_angle_the_cell_is_that_of_the_papers_formula(ang, dist):
    r, c = 20.3, 19.8
    grid = after(robot(row=r, column=c, angle=ang), eCamera("store", dist)).grid
    row = r + dist * 10 * math.cos(math.radians(ang))
    column = c + dist * 10 * math.sin(math.radians(ang))
    assert np.argwhere(grid == STORE).tolist() == [[math.floor(row), math.floor(column)]]


def test_the_angle_is_from_the_heading():
    grid = after(robot(angle=60.0), eCamera("kitchen", 1.0, 30.0)).grid
    assert np.argwhere(grid).tolist() == [[20, 30]]
    assert grid[20, 30] == KITCHEN


def test_only_the_grid_changes():
    scene = robot(objective="store", speed=1.0)
    assert changed(scene, after(scene, eCamera("store", 1.0))) == ["grid"]


def test_a_marker_has_one_place():
    now = after(robot(), eCamera("store", 1.0))
    now = after(now.string, eCamera("store", 0.5))
    assert np.argwhere(now.grid == STORE).tolist() == [[25, 20]]
    assert now.grid[30, 20] == FREE


def test_an_unannounced_marker_gets_a_code_too():
    now = after(robot(), eCamera("attic", 1.0))
    assert now.markers == ("kitchen", "store", "attic")
    assert now.grid[30, 20] == MARKER + 2


def test_a_marker_beyond_the_grid_is_passed_over():
    assert not after(robot(), eCamera("store", 5.0)).grid.any()


# --- the camera's field of view -----------------------------------------------------------------


def room():
    """Free ground with a wall across, at row 30."""
    grid = np.full((40, 40), FREE, np.int16)
    grid[30] = 9
    return grid


def test_free_cells_ahead_are_seen_up_to_the_wall():
    grid = room()
    look(grid, GridPose(20.5, 20.5, 0.0), 60.0, 15.0)
    assert (grid[21:30, 20] == SEEN).all()
    assert (grid[31:] == FREE).all()
    assert (grid[30] == 9).all()
    assert (grid[:20] == FREE).all()
    seen = np.argwhere(grid == SEEN) - 20
    seen = seen[seen[:, 0] > 4]
    assert (np.abs(np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))) <= 35).all()


def test_looking_leaves_specks_at_most():
    grid = np.full((60, 60), FREE, np.int16)
    look(grid, GridPose(5.5, 30.5, 0.0), 60.0, 50.0)
    rows, columns = np.ogrid[:60, :60]
    bearings = np.degrees(np.arctan2(columns - 30, rows - 5))
    near = np.hypot(columns - 30, rows - 5) <= 48
    view = (np.abs(bearings) <= 28) & near
    assert not out_of_view(grid)[view].any()
    assert (grid[view] == SEEN).mean() > 0.9


def test_looking_off_the_grid_does_no_harm():
    grid = room()
    look(grid, GridPose(0.5, 0.5, -135.0), 60.0, 50.0)
    assert (grid[1:30, 1:] == FREE).all()


def test_changes_that_are_news():
    grid = room()
    grid[:10] = UNKNOWN
    assert np.argwhere(frontier(grid))[:, 0].tolist() == [10] * 38 + [10, 10]
    grid[10:] = np.where(grid[10:] == FREE, SEEN, grid[10:])
    assert not out_of_view(grid).any()
    grid[20:23, 5:8] = FREE
    assert out_of_view(grid).sum() == 9
    forget_looks(grid)
    assert (grid != SEEN).all()


def test_specks_are_no_news():
    grid = np.full((20, 20), SEEN, np.int16)
    grid[5:7, 5:9] = UNKNOWN
    grid[12:14, 5:9] = FREE
    assert not frontier(grid).any()
    assert not out_of_view(grid).any()
