"""The camera: from metres to pixels, and back."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from minerva_services.views.opengl.camera import OrbitCamera

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
