"""Walls from matrices, and the other solids: only outer surfaces are visible."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

pytest.importorskip("viser")

from minerva_bus import Line
from minerva_bus.semantics.picture import Polyline
from minerva_services.views.line_segments import segments
from minerva_services.views.solids import arrow, cylinder, flat, pin, ring, walls

masks = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=7))


def triangles(solid):
    return solid.vertices[solid.faces].astype(float)


def normals(solid):
    """The normals, with twice the triangle's area as length."""
    a, b, c = np.moveaxis(triangles(solid), 1, 0)
    return np.cross(b - a, c - a)


def area(solid):
    return np.linalg.norm(normals(solid), axis=1).sum() / 2


@given(masks)
def test_a_floor_covers_its_cells_and_is_seen_from_above(mask):
    ground = flat(mask, 0.5, 0.25)
    assert area(ground) == pytest.approx(0.25 * mask.sum(), abs=1e-5)
    assert (normals(ground)[:, 2] >= 0).all()
    assert not len(ground.vertices) or set(ground.vertices[:, 2].tolist()) == {0.25}


@given(masks)
def test_walls_have_a_side_for_each_edge_and_are_seen_from_outside(mask):
    built = walls(mask, 1.0, 2.0)
    padded = np.pad(mask, 1).astype(int)
    edges = sum(np.abs(np.diff(padded, axis=axis)).sum() for axis in (0, 1))
    assert area(built) == pytest.approx(mask.sum() + 2.0 * edges, abs=1e-4)
    upright = normals(built)
    standing = np.abs(upright[:, 2]) < 1e-9
    middles = triangles(built)[standing].mean(axis=1)
    ways = upright[standing] / np.linalg.norm(upright[standing], axis=1, keepdims=True)
    for middle, way in zip(middles, ways, strict=True):
        for step, solid in ((0.1, False), (-0.1, True)):
            row, column = np.floor((middle + step * way)[:2]).astype(int) + 1
            assert bool(padded[row, column]) == solid


@pytest.mark.parametrize("solid", [cylinder(8), cylinder(32), pin()])
def test_round_solids_are_seen_from_outside(solid):
    middles = triangles(solid).mean(axis=1) - (0.0, 0.0, 0.5)
    ways = normals(solid)
    upright = np.abs(ways[:, 2]) < 1e-6
    assert ((ways * middles)[upright, :2].sum(axis=1) > 0).all()
    assert solid.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert solid.vertices[:, 2].max() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("solid", [arrow(), ring()])
def test_marks_lie_flat_and_face_up(solid):
    assert (normals(solid)[:, 2] > 0).all()


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=2, max_size=6),
    st.booleans(),
)
def test_lines_and_their_dashes_lie_along_the_points(points, dashed):
    line = Polyline(np.array(points), Line("xs", "ys", dashed=dashed))
    length = np.hypot(*np.diff(line.points, axis=0).T).sum()
    drawn = segments(line)
    assert drawn.shape[1:] == (2, 3)
    parts = np.linalg.norm(np.diff(drawn.astype(float), axis=1)[:, 0], axis=1).sum()
    assert parts <= length + 1e-3
    if not dashed:
        assert parts == pytest.approx(length, abs=1e-3)
