"""Geometry of the OpenGL view: from metres to pixels and back, and walls from cells."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from minerva_bus.semantics.poses import Pose
from minerva_services.views.opengl.camera import OrbitCamera
from minerva_services.views.opengl.solids import drum, pin, tops, upright
from minerva_services.views.solids import enclosed, sides

SIZE = 900, 600
PLACES = st.floats(-50, 50)
CAMERAS = st.builds(
    OrbitCamera,
    target=st.tuples(PLACES, PLACES, st.floats(0, 2)),
    azimuth=st.floats(-180, 180),
    elevation=st.floats(8, 90),
    distance=st.floats(0.5, 200),
)
PIXELS = st.tuples(st.floats(0, 900), st.floats(0, 600))


@given(CAMERAS, PIXELS)
def test_floor_points_are_drawn_at_their_pixel(camera, pixel):
    ground = camera.ground(*pixel, *SIZE)
    assume(ground is not None and np.hypot(*ground) < 1e4)
    assert camera.project(np.array([[*ground, 0.0]]), *SIZE)[0] == pytest.approx(pixel, abs=1e-3)


@given(CAMERAS, PLACES, PLACES, st.floats(0, 3))
def test_the_matrix_agrees_with_project(camera, x, y, z):
    clip = camera.matrix(900 / 600) @ [x, y, z, 1.0]
    assume(clip[3] > 1e-3)
    right, down = camera.project(np.array([[x, y, z]]), *SIZE)[0]
    assert (clip[0] / clip[3] + 1) * 450 == pytest.approx(right, abs=1e-3)
    assert (1 - clip[1] / clip[3]) * 300 == pytest.approx(down, abs=1e-3)


@given(CAMERAS)
def test_the_target_is_in_the_middle(camera):
    assert camera.project(np.array([camera.target]), *SIZE)[0] == pytest.approx([450, 300])


@given(CAMERAS, st.lists(st.tuples(PLACES, PLACES, st.floats(0, 3)), min_size=2, max_size=9))
def test_a_fitted_camera_shows_all_and_no_more_than_needed(camera, points):
    points = np.array(points)
    assume(np.ptp(points[:, :2], axis=0).max() > 1.0)
    fitted = camera.fitted(points, 1.5)
    seen = fitted.project(points, *SIZE)
    free = np.concatenate([seen / SIZE, 1 - seen / SIZE], axis=1)
    assert free.min() >= 0.059
    nearest = fitted.depths(points).min() / np.linalg.norm(np.ptp(points, axis=0))
    assert min(free.min() - 0.06, nearest - 0.5) == pytest.approx(0, abs=1e-3)


@given(CAMERAS, st.floats(-200, 200), st.floats(-200, 200))
def test_to_pan_moves_the_floor_with_the_mouse(camera, dx, dy):
    assume(camera.elevation > 15)
    panned = camera.panned(dx, 0.0, SIZE[1])
    at = panned.project(np.array([camera.target]), *SIZE)[0]
    assert at == pytest.approx([450 + dx, 300], abs=1e-3)
    down = camera.panned(0.0, dy, SIZE[1]).project(np.array([camera.target]), *SIZE)[0]
    assert np.isnan(down).any() or (down[1] - 300) * dy >= -1e-6


def test_it_looks_as_a_map_does_and_never_from_below():
    x, y = OrbitCamera(elevation=90).project(np.array([[1.0, 2.0, 0.0]]), *SIZE)[0]
    assert x > 450
    assert y < 300
    assert OrbitCamera().orbited(0, 500).elevation == 90
    assert OrbitCamera().orbited(0, -500).elevation == 8
    assert np.isnan(OrbitCamera().project(np.array([[0.0, -100.0, 0.0]]), *SIZE)).all()
    assert OrbitCamera(elevation=8).ground(450, 0, *SIZE) is None


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
