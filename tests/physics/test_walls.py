"""Walls are exactly the edges between free and solid cells, with free space on their left."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.walls import Segments, wall_segments
from tests.counting import calls

Cells = NDArray[np.int16]
Edge = tuple[tuple[float, float], tuple[float, float]]

MATRICES = hnp.arrays(
    np.int16,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=7),
    elements=st.sampled_from([0, 0, 100, -1]),
)


def unit_edges(cells: Cells) -> set[Edge]:
    """The sides between free and solid cells, free on the left, found cell by cell."""
    rows, columns = cells.shape
    edges: set[Edge] = set()
    for i, j in np.argwhere(cells == 0).tolist():
        corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1), (i, j)]
        beyond = [(i, j - 1), (i + 1, j), (i, j + 1), (i - 1, j)]
        for (start, end), (k, m) in zip(pairwise(corners), beyond, strict=True):
            if not (0 <= k < rows and 0 <= m < columns and cells[k, m] == 0):
                edges.add((start, end))
    return edges


def cut(segments: Segments) -> list[Edge]:
    """Segments on the integer grid, split into sides of cells."""
    edges: list[Edge] = []
    for ax, ay, bx, by in segments.tolist():
        count = round(abs(bx - ax) + abs(by - ay))
        dx, dy = (bx - ax) / count, (by - ay) / count
        points = [(ax + k * dx, ay + k * dy) for k in range(count + 1)]
        edges.extend(pairwise(points))
    return edges


@given(MATRICES)
def test_each_side_of_a_free_cell_next_to_a_solid_one_is_covered_once(cells: Cells) -> None:
    edges = cut(wall_segments(cells, 1.0))
    assert len(edges) == len(set(edges))
    assert set(edges) == unit_edges(cells)


@given(MATRICES)
def test_no_segment_continues_another(cells: Cells) -> None:
    segments = wall_segments(cells, 1.0).tolist()
    begins = {(ax, ay, bx == ax) for ax, ay, bx, _ in segments}
    assert not [s for s in segments if (s[2], s[3], s[2] == s[0]) in begins]


def test_a_free_room_has_four_walls_counter_clockwise() -> None:
    segments = wall_segments(np.zeros((40, 20), np.int16), 0.05, x=1.0, y=-2.0)
    expected = {(1, -2, 3, -2), (3, -2, 3, -1), (3, -1, 1, -1), (1, -1, 1, -2)}
    assert {tuple(row) for row in segments.round(12).tolist()} == expected


def test_walls_turn_about_the_lower_left_corner() -> None:
    cells = np.array([[0, 100, 0], [0, 0, -1]], np.int16)
    plain = wall_segments(cells, 0.5)
    turned = wall_segments(cells, 0.5, x=3, y=4, angle=30)
    turn = complex(math.cos(math.radians(30)), math.sin(math.radians(30)))
    for a in (0, 2):
        expected = (plain[:, a] + 1j * plain[:, a + 1]) * turn + complex(3, 4)
        assert np.allclose(turned[:, a] + 1j * turned[:, a + 1], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("value", [100, -1, 50])
def test_a_solid_matrix_has_no_walls(value: int) -> None:
    assert wall_segments(np.full((3, 4), value, np.int16), 0.1).shape == (0, 4)


def test_an_empty_matrix_has_no_walls() -> None:
    assert wall_segments(np.zeros((0, 0), np.int16), 0.1).shape == (0, 4)


def test_numbers_that_cannot_be_used_are_refused() -> None:
    cells = np.zeros((2, 2), np.int16)
    for resolution in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(PhysicsError, match="resolution"):
            wall_segments(cells, resolution)
    with pytest.raises(PhysicsError, match="rows and columns"):
        wall_segments(cells[0], 0.1)
    with pytest.raises(PhysicsError, match="corner"):
        wall_segments(cells, 0.1, x=math.nan)


def test_the_calls_do_not_grow_with_the_number_of_cells() -> None:
    cells = np.random.default_rng(0).choice(np.array([0, 100, -1], np.int16), (600, 300))
    few, many = (calls(lambda rows=rows: wall_segments(cells[:rows], 0.05)) for rows in (150, 600))
    assert few == many
