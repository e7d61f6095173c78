"""A matrix and its paths are the same picture."""

import gc
import re

import numpy as np
import pytest
from numpy.typing import NDArray

from minerva_services.views.svg.tracing import Tracer, trace

COLORS = ((-1, "#111111"), (0, ""), (1, "#222222"), (100, "#333333"))
_RECTANGLE = re.compile(r"M(\d+) (\d+)h(\d+)v(\d+)h-(\d+)z")


def painted(paths: tuple[tuple[str, str], ...], shape: tuple[int, ...]) -> NDArray[np.object_]:
    """The colour of each cell; fails if two rectangles overlap."""
    cells = np.full(shape, "", object)
    for color, data in paths:
        assert _RECTANGLE.sub("", data) == ""
        for rectangle in _RECTANGLE.findall(data):
            row, column, rows, columns, back = map(int, rectangle)
            assert rows == back
            area = cells[row : row + rows, column : column + columns]
            assert area.shape == (rows, columns)
            assert (area == "").all()
            area[:] = color
    return cells


def expected(cells: NDArray[np.int16]) -> NDArray[np.object_]:
    def color(value: int) -> str:
        return next((color for least, color in reversed(COLORS) if value >= least), "")

    return np.array([[color(value) for value in row] for row in cells], object)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (7, 5), (12, 110), (120, 11)])
@pytest.mark.parametrize("seed", range(4))
def test_every_cell_has_its_colour_once(shape: tuple[int, int], seed: int):
    random = np.random.default_rng(seed)
    cells = random.choice([-2, -1, 0, 1, 99, 100], shape).astype(np.int16)
    cells[:, shape[1] // 2 :] = cells[:1, :1]
    assert (painted(trace(cells, COLORS), shape) == expected(cells)).all()


def test_a_plain_area_is_one_rectangle():
    assert trace(np.full((600, 300), 5, np.int16), COLORS) == (("#222222", "M0 0h600v300h-600z"),)


def test_rectangles_that_only_touch_are_not_merged():
    cells = np.zeros((3, 4), np.int16)
    cells[2, 0:2] = cells[0, 2:4] = 1
    assert (painted(trace(cells, COLORS), cells.shape) == expected(cells)).all()


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
def test_an_empty_matrix_has_no_paths(shape: tuple[int, int]):
    assert trace(np.empty(shape, np.int16), COLORS) == ()


def test_values_without_colour_have_no_paths():
    assert trace(np.zeros((3, 3), np.int16), COLORS) == ()
    assert trace(np.full((3, 3), -9, np.int16), COLORS) == ()
    assert trace(np.ones((3, 3), np.int16), ()) == ()


def test_a_matrix_of_reals_is_traced_too():
    assert trace(np.array([[0.5, 1.5]]), COLORS) == (("#222222", "M0 1h1v1h-1z"),)


def test_a_read_only_matrix_is_traced_once_while_it_lives():
    tracer = Tracer()
    cells = np.ones((3, 3), np.int16)
    cells.flags.writeable = False
    first = tracer.paths(cells, COLORS)
    assert tracer.paths(cells, COLORS) is first
    assert tracer.paths(cells, ((1, "#999999"),)) != first
    del cells
    gc.collect()
    assert tracer._known == {}  # pyright: ignore[reportPrivateUsage]


def test_a_writable_matrix_is_traced_again():
    tracer = Tracer()
    cells = np.ones((3, 3), np.int16)
    first = tracer.paths(cells, COLORS)
    cells[0, 0] = 100
    assert tracer.paths(cells, COLORS) != first
