"""Pairs of points: cell lists, the k-d tree and brute force find the same ones, bit by bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from minerva_services.physics.neighbours import cells, search
from minerva_services.physics.neighbours.cells import Candidates
from minerva_services.physics.neighbours.search import Pairs, near

Point = tuple[float, float]
Size = tuple[float, float]

eighths = st.integers(-40, 120).map(lambda number: number / 8)
anywhere = st.floats(-30.0, 30.0)
edges = st.sampled_from([-1e-18, 0.0, 9.0, math.nextafter(9.0, 0.0), 12.0, 3.0, 0.1 + 0.2, 1e-160])
far = st.floats(-1e300, 1e300)
radii = st.one_of(
    st.integers(1, 23).map(lambda number: number / 8), st.floats(1e-3, 4.4), st.just(1e-170)
)


@st.composite
def crowds(draw: Any, coordinate: Any) -> list[Point]:
    """Points, some of them close to others, and some twice."""
    points: list[Point] = draw(st.lists(st.tuples(coordinate, coordinate), max_size=30))
    if points:
        shifts = st.tuples(st.sampled_from(points), anywhere, anywhere)
        for (x, y), dx, dy in draw(st.lists(shifts, max_size=20)):
            points.append((x + dx / 100, y + dy / 100))
        points += draw(st.lists(st.sampled_from(points), max_size=5))
    return points


inner = crowds(eighths | anywhere | edges)
outer = crowds(eighths | edges | far)


def brute_force(points: list[Point], radius: float, size: Size | None) -> list[tuple[Any, ...]]:
    """(first, second, dx, dy, squared distance) of all pairs, in order."""
    if size is not None:
        # A number just below 0 is the far edge after `%`, which is 0.
        points = [(x % size[0] % size[0], y % size[1] % size[1]) for x, y in points]
    pairs: list[tuple[Any, ...]] = []
    for i, (x, y) in enumerate(points):
        for j in range(i + 1, len(points)):
            dx, dy = points[j][0] - x, points[j][1] - y
            if size is not None:
                dx -= round(dx / size[0]) * size[0]
                dy -= round(dy / size[1]) * size[1]
            if dx * dx + dy * dy <= radius * radius:
                pairs.append((i, j, dx, dy, dx * dx + dy * dy))
    return pairs


def rows(pairs: Pairs) -> list[tuple[Any, ...]]:
    columns = (pairs.first, pairs.second, pairs.dx, pairs.dy, pairs.squared)
    return [*zip(*(column.tolist() for column in columns), strict=True)]


def exact(pairs: list[tuple[Any, ...]]) -> list[str]:
    """With the bits of all numbers."""
    return [repr(pair) for pair in pairs]


def check(points: list[Point], radius: float, size: Size | None, block: int, few: int) -> None:
    expected = exact(brute_force(points, radius, size))
    x, y = (np.array([point[axis] for point in points], float) for axis in (0, 1))
    with pytest.MonkeyPatch.context() as patch:
        assert exact(rows(near(x, y, radius, size))) == expected
        patch.setattr(cells, "_BLOCK", block)
        patch.setattr(cells, "_FEW", few)
        for choice in (True, False):
            patch.setattr(Candidates, "win", lambda _, choice=choice: choice)
            assert exact(rows(near(x, y, radius, size))) == expected


blocks = st.sampled_from([1, 2, 7, 1 << 14])
fews = st.sampled_from([1, 5, 64, 4096])


@given(inner, radii, blocks, fews)
@example([(0.0, 0.0), (9.0, 12.0), (4.5, 3.0)], 3.0, 1, 64)
def test_a_torus_has_the_pairs_of_brute_force(
    points: list[Point], radius: float, block: int, few: int
) -> None:
    check(points, radius, (9.0, 12.0), block, few)


@given(outer, radii, blocks, fews)
@example([(-1e308, 0.0), (1e308, 0.0), (1e308, 1.0)], 1.0, 1, 64)
@example([(-1e308, 0.0), (1e308, 0.0), (1e308, 1.0)], math.inf, 1, 64)
@example([(-1e160, 0.0), (1e160, 0.0), (1e154, 1e300)], 1e154, 1, 64)
@example([(1e16, 0.0), (1e16 + 2, 0.0), (-1e16, 0.0)], 2.0, 7, 4096)
@example([(0.0, 0.0), (1e-170, 0.0)], 1e-175, 7, 64)
def test_a_plane_has_the_pairs_of_brute_force(
    points: list[Point], radius: float, block: int, few: int
) -> None:
    check(points, radius, None, block, few)


@given(st.integers(0, 3), st.booleans(), st.sampled_from([0.9, 1.0, 1.9, 3.9]))
def test_a_crowd_on_a_lattice_has_the_pairs_of_brute_force(
    seed: int, periodic: bool, radius: float
) -> None:
    # Distances of the radius, but rounded; the sides of the torus are 2 to 10 radii.
    points = np.random.default_rng(seed).integers(0, 80, (150, 2)) / 10
    size = (8.0, 9.0) if periodic else None
    check([(x, y) for x, y in points.tolist()], radius, size, 100, 64)


def test_uniform_crowds_need_no_tree_and_uneven_ones_do(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    tree = search.tree
    monkeypatch.setattr(search, "tree", lambda: calls.append(1) or tree())
    x, y = np.random.default_rng(1).uniform(0, 40, (2, 2000))
    for radius in (1e-6, 0.1, 1.0, 10.0):
        near(x, y, radius)
        near(x, y, radius, (40.0, 40.0))
    assert not calls
    x[0] = 1e9  # the others share one cell
    near(x, y, 1.0)
    assert calls


def test_a_grid_has_few_cells_however_far_points_are() -> None:
    for far in (1e3, 1e9, 1e300):
        for x, y in ((far, far), (far, 0.0), (0.0, far)):
            axes = cells.grid(np.array([0.0, x]), np.array([0.0, y]), 1e-3, None)
            assert axes is not None
            assert axes[0].count * axes[1].count <= 64
    axes = cells.grid(np.zeros(100), np.zeros(100), 1e-3, (1e9, 1e-2))
    assert axes is not None
    assert min(axis.count for axis in axes) >= 3
    assert axes[0].count * axes[1].count <= 200
