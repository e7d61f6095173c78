"""Walls from cells: rectangles, sides and enclosed areas."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from minerva_bus.semantics.poses import Pose
from minerva_services.views.blocks import enclosed, sides
from minerva_services.views.opengl.solids import drum, pin, tops, upright

MASKS = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12))


@given(MASKS)
def test_sides_are_where_cells_end_and_nowhere_else(mask):
    expected = set()
    for row, column in np.argwhere(mask):
        for way, (dr, dc) in enumerate(((-1, 0), (1, 0), (0, -1), (0, 1))):
            r, c = row + dr, column + dc
            if not (0 <= r < mask.shape[0] and 0 <= c < mask.shape[1] and mask[r, c]):
                expected.add((way, row, column))
    cells = [cell for side in sides(mask) for cell in cells_of(side)]
    assert len(cells) == len(set(cells))
    assert set(cells) == expected


def cells_of(side):
    """The cells that a side belongs to; they must lie left of its direction."""
    row, column, end_row, end_column, way = map(int, side)
    dr, dc = np.sign(end_row - row), np.sign(end_column - column)
    for k in range(max(abs(end_row - row), abs(end_column - column))):
        middle = np.array([row, column]) + (k + 0.5) * np.array([dr, dc])
        cell = np.floor(middle + 0.5 * np.array([-dc, dr])).astype(int)
        yield way, *map(int, cell)


@given(MASKS, MASKS)
def test_an_enclosed_cell_has_no_path(hollow, wall):
    shape = tuple(map(min, hollow.shape, wall.shape))
    wall = wall[: shape[0], : shape[1]]
    hollow = hollow[: shape[0], : shape[1]] & ~wall
    assert np.array_equal(enclosed(hollow, wall), walled_in(hollow, wall))


def walled_in(hollow, wall):
    """The reference implementation of `enclosed`, cell by cell."""
    beside = np.pad(~(hollow | wall), 1, constant_values=True)
    out, edge = np.zeros(beside.shape, bool), list(map(tuple, np.argwhere(beside)))
    inner = np.pad(hollow, 1)
    while edge:
        row, column = edge.pop()
        for at in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
            within = 0 <= at[0] < inner.shape[0] and 0 <= at[1] < inner.shape[1]
            if within and inner[at] and not out[at]:
                out[at] = True
                edge.append(at)
    return hollow & ~out[1:-1, 1:-1]


@given(MASKS, st.floats(-180, 180))
def test_tops_have_the_cells_area_and_sides_their_outline(mask, angle):
    pose, cell, height = Pose(3.0, -2.0, angle), 0.5, 2.0
    areas = [area(mesh) for mesh in both(mask, cell, pose, height)]
    outline = sum(np.abs(s[:2] - s[2:4]).sum() for s in sides(mask))
    assert areas == pytest.approx([mask.sum() * cell**2, outline * cell * height], rel=1e-4)


def both(mask, cell, pose, height):
    return tops(mask, cell, pose, height), upright(mask, cell, pose, 0.0, height)


def area(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k], :3].astype(float) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@given(MASKS)
def test_triangles_face_their_normals(mask):
    for mesh in both(mask, 0.5, Pose(1.0, 2.0, 33.0), 1.0):
        a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
        facing = np.cross(b[:, :3] - a[:, :3], c[:, :3] - a[:, :3])
        assert ((facing * a[:, 3:]).sum(axis=1) > 0).all()


@pytest.mark.parametrize(("segments", "rounded"), [(6, False), (40, True)])
def test_drums_are_closed_except_for_their_base(segments, rounded):
    mesh = drum(segments, rounded)
    edges = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, times = np.unique(edges, axis=0, return_counts=True)
    ends = segments if rounded else 3 * segments  # a sharp edge has two rings of vertices
    assert (times == 1).sum() == ends
    assert times.max() == 2
    assert pin().triangles.max() == len(pin().vertices) - 1
