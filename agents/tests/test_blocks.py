"""Sums over blocks of cells, compared with sums item by item."""

import numpy as np
import pytest

from minerva_agents.robot.exploration import RAYS, _around
from minerva_agents.robot.grid import block_sums, box_sums

SHAPES = [(1, 1), (7, 5), (6, 9), (2, 30)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("side", [1, 3, 4])
def test_blocks_are_cut_off_at_the_far_edges(shape, side):
    mask = np.random.default_rng(1).random(shape) < 0.5
    rows, columns = (range(0, length, side) for length in shape)
    expected = [[mask[r : r + side, c : c + side].sum() for c in columns] for r in rows]
    assert block_sums(mask, side).tolist() == expected


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("reach", [0, 1, 9])
@pytest.mark.parametrize("unit", [1, 0.25])
def test_boxes_are_around_each_item(shape, reach, unit):
    numbers = np.random.default_rng(2).integers(0, 50, shape) * unit
    rows, columns = map(range, shape)
    expected = [
        [
            numbers[max(r - reach, 0) : r + reach + 1, max(c - reach, 0) : c + reach + 1].sum()
            for c in columns
        ]
        for r in rows
    ]
    sums = box_sums(numbers, reach)
    assert sums.tolist() == expected
    assert sums.dtype == numbers.dtype


@pytest.mark.parametrize("width", [1, 2, 7, RAYS - 1, RAYS])
def test_rays_around_a_ray_go_around_the_circle(width):
    views = np.random.default_rng(3).integers(0, 50, (3, RAYS)).astype(np.float64)
    before = width // 2
    expected = [
        [sum(view[(ray + k) % RAYS] for k in range(-before, width - before)) for ray in range(RAYS)]
        for view in views
    ]
    assert _around(views, width).tolist() == expected
